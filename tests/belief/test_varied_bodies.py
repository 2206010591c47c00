"""Shapes whose proportions may be others than the nominal ones."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from belief import Touch
from belief.observation_model import FixedHypotheses, RigidBodyModel
from belief.observation_model.rigid_body import joint_model
from belief.observation_model.varied_bodies import VariedBodyModel

TABLE = np.array([[[[2.0, 0.0]], [[0.0, 2.0]]], [[[1.0, 0.0]], [[0.0, 1.0]]]], np.float32)
ONE = np.ones((2, 1, 2))
IMAGE = np.zeros((2, 2), np.uint8)


@dataclass
class Ratios:
    """Two hypotheses of other proportions of the second shape, with the same log ratios for every touch."""

    values: tuple[float, float]
    shapes = np.array([1])

    def log_ratios(self, touch):
        return None if touch.image is None else np.array([self.values])


def nominal(correlation=0.0):
    hypotheses = FixedHypotheses(TABLE)
    return RigidBodyModel(("mug", "cup"), 1, 1.0, ONE, ONE, correlation=correlation, hypotheses=hypotheses)


def touch(pose=0, x=1.0, image=IMAGE):
    return Touch(pose, features=np.array([x, 0.3]), image=image)


@pytest.mark.parametrize("share", [0.04, 0.5])
def test_the_likelihood_is_a_mixture_in_the_currency_of_single_touches(share):
    model = VariedBodyModel(nominal(), Ratios((3.0, -1.0)), share)
    touches = [touch(0), touch(1, -0.5)]
    found = model.start().updated(touches)
    scores = np.array([TABLE[one.pose, :, 0] @ one.features for one in touches])  # (n, K)
    usual = np.log(np.exp(scores).mean(axis=1)).sum()
    varied = usual + np.log(np.exp(2 * np.array([3.0, -1.0])).mean())
    mug, cup = scores.sum(axis=0)
    expected = mug, np.logaddexp(np.log(1 - share) + cup, np.log(share) + varied)
    assert np.ptp(found.log_likelihood - expected) == pytest.approx(0.0, abs=1e-5)


def test_repeats_count_less_for_other_proportions_too():
    once, twice = (
        VariedBodyModel(nominal(1.0), Ratios((3.0, 3.0)), 0.5).start().updated([touch()] * n) for n in (1, 2)
    )
    assert np.diff(twice.log_likelihood) == pytest.approx(np.diff(once.log_likelihood), abs=1e-5)


@pytest.mark.parametrize("images", [(None, IMAGE), (IMAGE, None), (None, None)])
def test_touches_that_are_not_read_are_of_nominal_proportions(images):
    model = VariedBodyModel(nominal(), Ratios((9.0, 9.0)))
    found, plain = model.start(), nominal().start()
    for image in images:
        found, plain = found.update(touch(image=image)), plain.update(touch())
    np.testing.assert_array_equal(found.log_likelihood, plain.log_likelihood)


def test_no_share_is_the_nominal_model():
    found = VariedBodyModel(nominal(), Ratios((9.0, 9.0)), 0.0).start().update(touch())
    np.testing.assert_array_equal(found.log_likelihood, nominal().start().update(touch()).log_likelihood)


def test_the_nominal_model_is_found_below_several():
    inner = nominal()
    assert joint_model(SimpleNamespace(nominal=VariedBodyModel(inner, Ratios((0.0, 0.0))))) is inner
