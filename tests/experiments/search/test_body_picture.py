"""The picture of a body as believed is sharp for a known orientation, and blurred for an unknown one."""

import numpy as np
import pytest

from activetouch.distributions import quaternions
from activetouch.poses import WorldObject, turn
from activetouch.shapes import SHAPES
from activetouch.view import Bodies
from belief.observation_model import FixedHypotheses, RigidBodyModel
from belief.observation_model.outcome_mixture import log_means
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence

N = 512
BODIES = Bodies(SHAPES, [quaternions(N)], np.ones(N))


def evidence(log_weights):
    shape = (1, len(SHAPES), N, 1)
    model = RigidBodyModel(
        tuple(SHAPES),
        N,
        1.0,
        np.zeros((1, 1, 1)),
        np.zeros((1, 1, 4)),
        hypotheses=FixedHypotheses(np.zeros(shape, np.float32)),
    )
    return RigidBodyEvidence(model, log_weights, log_means(log_weights))


def test_an_unknown_orientation_is_blurred_and_a_known_one_is_sharp():
    flat, sure = np.zeros((4, N)), np.zeros((4, N))
    sure[:, 7] = 50.0
    probs = np.array([0.1, 0.6, 0.05, 0.25])
    for weights, sharp in ((flat, False), (sure, True)):
        found = BODIES.likeliest(evidence(weights), probs, 2)
        assert [(label, prob) for label, prob, _ in found] == [("cube", 0.6), ("cone", 0.25)]
        coverage = found[0][2][..., 1]
        partial = ((coverage > 0.02) & (coverage < 0.98)).mean()
        assert (partial == 0.0) == sharp
        assert np.isfinite(found[0][2]).all()
    sphere = BODIES.likeliest(evidence(flat), np.eye(4)[0], 1)[0][2][..., 1]
    assert set(np.unique(sphere)) == {0.0, 1.0}  # it looks alike from everywhere


@pytest.mark.parametrize("label", list(SHAPES))
def test_the_outline_of_a_known_body_covers_its_picture(label):
    index = list(SHAPES).index(label)
    weights = np.zeros((4, N))
    weights[:, 11] = 50.0
    [(_, _, picture)] = BODIES.likeliest(evidence(weights), np.eye(4)[index], 1)
    np.testing.assert_array_equal(picture[..., 1], BODIES.outline(label, WorldObject(index, 1.0, BODIES.rests[0][11])))
    turned = (WorldObject(index, size, turn("x", 0.3)) for size in (0.9, 0.7))
    larger, smaller = (BODIES.outline(label, body).sum() for body in turned)
    assert larger / smaller == pytest.approx((0.9 / 0.7) ** 2, rel=0.05)
