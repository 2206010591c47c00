"""Where touches in one pose repeat each other, stops under a model that prices repeats are right as often as claimed.

Touches of shape k are Gaussian about 1.5 e_k with unit covariance, of which all touches of an object in one pose share
the part ρ. Then exp(1.5 x_k), normalised, is the exact posterior of one touch, and n touches in a pose are worth
n / (1 + (n - 1) ρ) of their mean exactly, which is what :class:`RatioModel` says.
"""

import numpy as np
import pytest

from belief.bayes import target_information_gain
from belief.calibration import TemperatureScaling
from belief.observation_model import RatioModel
from belief.touch_batch import TouchBatch
from planners.probing import RepeatDiscount

NUM_SHAPES, NUM_POSES, MOST, SPREAD = 3, 3, 12, 1.5
CONFIRM, REJECT = 0.95, 0.05


def touches(number, rho, rng):
    """True shapes ``(S,)`` and what each repeat in each pose feels, ``(S, P, MOST, K)``."""
    shapes = rng.integers(NUM_SHAPES, size=number)
    shared = rng.normal(size=(number, NUM_POSES, 1, NUM_SHAPES))
    alone = rng.normal(size=(number, NUM_POSES, MOST, NUM_SHAPES))
    means = SPREAD * np.eye(NUM_SHAPES)[shapes][:, None, None]
    return shapes, means + np.sqrt(rho) * shared + np.sqrt(1.0 - rho) * alone


def model_of(rho, rng):
    # References stand for single touches; equally many of every shape.
    centres = SPREAD * np.eye(NUM_SHAPES)[np.arange(600) % NUM_SHAPES]
    references = centres + rng.normal(size=(NUM_POSES, 600, NUM_SHAPES))
    uniform = np.full(NUM_SHAPES, 1.0 / NUM_SHAPES)
    return RatioModel(("a", "b", "c"), TemperatureScaling(1.0 / SPREAD, "ok"), uniform, rho, references)


def stops(model, repeats, shapes, felt):
    """Claimed posterior of the target at every stop beyond a threshold, and whether the object was the target."""
    table, rows = model.outcome_table().probs, np.arange(len(shapes))
    poses, logits = np.empty((len(shapes), 0), np.int64), np.empty((len(shapes), 0, NUM_SHAPES))
    uses = np.zeros((len(shapes), NUM_POSES), np.int64)
    probs = np.full((len(shapes), NUM_SHAPES), 1.0 / NUM_SHAPES)
    claimed, going = np.full(len(shapes), np.nan), np.ones(len(shapes), bool)
    for _ in range(MOST):
        worth = target_information_gain(probs, table, 0) * repeats.weights(uses)
        pose = worth.argmax(axis=1)
        poses = np.column_stack([poses, pose])
        logits = np.concatenate([logits, felt[rows, pose, uses[rows, pose]][:, None]], axis=1)
        uses[rows, pose] += 1
        scores = model.log_likelihood_batch(TouchBatch(poses, logits))
        probs = np.exp(scores - np.logaddexp.reduce(scores, axis=1, keepdims=True))
        stopped = going & ((probs[:, 0] >= CONFIRM) | (probs[:, 0] <= REJECT))
        claimed[stopped] = probs[stopped, 0]
        going &= ~stopped
    return claimed[~going], shapes[~going] == 0


@pytest.mark.parametrize("rho", [0.3, 0.6, 0.9])
def test_stops_claim_and_are_right_within_a_hundredth(rho):
    # 9 000 objects: the standard error of the share that is right is below .004.
    rng = np.random.default_rng(7)
    shapes, felt = touches(9000, rho, rng)
    claimed, is_target = stops(model_of(rho, rng), RepeatDiscount(rho), shapes, felt)
    assert len(claimed) > 4000
    for beyond in (claimed >= CONFIRM, claimed <= REJECT, np.ones(len(claimed), bool)):
        assert claimed[beyond].mean() == pytest.approx(is_target[beyond].mean(), abs=0.01)


@pytest.mark.parametrize("rho", [0.6, 0.9])
def test_stops_that_take_repeats_for_fresh_claim_too_much(rho):
    rng = np.random.default_rng(7)
    shapes, felt = touches(9000, rho, rng)
    claimed, is_target = stops(model_of(0.0, rng), RepeatDiscount(0.0), shapes, felt)
    assert claimed[claimed >= CONFIRM].mean() > is_target[claimed >= CONFIRM].mean() + 0.02
