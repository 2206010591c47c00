"""Ranks of the truth are uniform under an exact posterior, for symmetric bodies too; spreads tell narrow from wide."""

import numpy as np
import pytest

from activetouch.hypotheses import quaternions
from activetouch.poses import random_orientation, to_matrices
from belief.observation_model import FixedHypotheses, RigidBodyModel
from benchmarks.orientation_ranks import LEAST_P, QUANTITIES, Touched, _ranks, rank_tests
from experiments.calibration.sequences import Rounds

N, P, OBJECTS, NOISE = 4096, 6, 300, 0.4
AXES = np.eye(3)[[0, 1, 2, 0, 1, 2]]  # of the body, one for each pose


def embedding(rotations, symmetric):
    """Of hypotheses in every pose, ``(P, N, D)``: log p(o | R) is f(o) · g(R) up to a constant of o.

    A touch measures where an axis of the body points, or, if the body looks alike after half a turn about each axis,
    its tensor square, with Gaussian noise.
    """
    found = []
    for axis in AXES:
        seen = rotations @ axis
        if symmetric:
            seen = (seen[:, :, None] * seen[:, None, :]).reshape(len(seen), -1)
        found.append(np.column_stack([seen, -0.5 * (seen**2).sum(axis=1)]))
    return np.stack(found)


def touched(rng, symmetric, noise=NOISE, objects=OBJECTS):
    """Objects of one shape in random orientations, touched once in every pose, and their model."""
    rests = np.stack([random_orientation(rng) for _ in range(objects)])
    true = embedding(to_matrices(rests), symmetric)[:, :, :-1]
    seen = true + noise * rng.normal(size=true.shape)
    features = np.concatenate([seen, np.ones((P, objects, 1))], axis=2) / NOISE**2
    features = features.swapaxes(0, 1)[:, None]
    table = embedding(to_matrices(quaternions(N)), symmetric)[:, None].astype(np.float32)
    depth = table.shape[-1]
    model = RigidBodyModel(
        ("body",), N, 1.0, np.zeros((P, 1, depth)), np.zeros((P, 1, 1)), hypotheses=FixedHypotheses(table)
    )
    rounds = Rounds(np.zeros((objects, 1, P, 1)), np.zeros(objects, int), features)
    return model, Touched(rounds, rests, rng.uniform(0.9, 1.1, objects))


def all_tests(rng, symmetric=False, noise=NOISE, objects=OBJECTS):
    model, rounds = touched(rng, symmetric, noise, objects)
    sizes = np.random.default_rng(1).uniform(0.9, 1.1, N)
    return rank_tests(model, quaternions(N), sizes, [rounds], rng)


@pytest.mark.parametrize("symmetric", [False, True])
def test_an_exact_posterior_passes_for_symmetric_bodies_too(symmetric, rng):
    found = all_tests(rng, symmetric)
    assert [test.num_touches for test in found] == [1, 2, 3, 6]
    for test in found:
        assert test.num_objects == OBJECTS
        assert set(test.ranks) == set(QUANTITIES)
        assert test.p_value > LEAST_P / 10  # four tests, each failing at this level once in a thousand


@pytest.mark.parametrize(("noise", "narrow"), [(2.0 * NOISE, True), (0.3 * NOISE, False)])
def test_a_posterior_that_is_too_narrow_or_too_wide_fails_with_that_spread(noise, narrow, rng):
    last = all_tests(rng, noise=noise)[-1]
    assert not last.passes
    assert (last.ranks["x component of the approach axis"].spread > 1.0) == narrow
    assert (last.ranks["angle to the likeliest"].mean > 0.5) == narrow


def test_a_truth_beyond_all_hypotheses_has_the_rank_one(rng):
    rotations, sizes = to_matrices(quaternions(N)), rng.uniform(0.9, 1.1, N)
    ranks = [_ranks(rng.normal(size=N), rotations, sizes, (rotations[0], 1.2), rng)["size"] for _ in range(50)]
    assert max(ranks) == 1.0  # the sum of all probabilities exceeds it by rounding for one in ten


def test_a_constant_in_all_log_weights_changes_no_rank(rng):
    rotations, sizes, logs = to_matrices(quaternions(N)), rng.uniform(0.9, 1.1, N), rng.normal(size=N)
    found = [
        list(_ranks(logs + constant, rotations, sizes, (rotations[3], 1.0), np.random.default_rng(0)).values())
        for constant in (0.0, -5000.0, 5000.0)
    ]
    np.testing.assert_allclose(found[1:], [found[0]] * 2, atol=1e-9)
    assert 0.0 < min(found[0]) < max(found[0]) < 1.0
