import re

import numpy as np
import pytest

from belief.observation_model import calibration_of_stops, certified_stops, fit_observation_model
from belief.observation_model.registry import fits
from belief.observation_model.selection import log_posteriors_by_touch
from belief.statistics.stop_thresholds import CandidateStops, certified_thresholds, least_searches
from belief.synthetic import random_model
from belief.touch_batch import TouchBatch


def simulated(rng, number, honesty):
    """Searches with one to three candidates; the object is right with the power ``honesty[k]`` of what is stated."""
    touches = np.tile([1, 2, 3], (number, 1))
    probs = rng.uniform(0.7, 1.0, touches.shape)
    wrong = rng.random(touches.shape) > probs ** np.asarray(honesty)
    rows, columns = np.nonzero(touches > rng.integers(3, size=(number, 1)))
    return CandidateStops(rows, *(array[rows, columns] for array in (touches, probs, wrong)), number)


def test_promises_hold_as_often_as_stated_and_nearly_use_up_what_is_allowed():
    """The world is a large set of searches, so that true errors are known; calibration searches are drawn from it."""
    rng = np.random.default_rng(0)
    world, risk = simulated(rng, 30_000, (1.0, 2.0, 0.5)), 0.1
    broken, errors, stopped = 0, [], []
    for _ in range(60):
        made = certified_thresholds(world.of(rng.integers(30_000, size=3000)), risk, confidence=0.8)
        stops, wrong = world.counts(made.thresholds)
        broken += bool((wrong > risk * stops).any())
        errors.append(wrong.sum() / max(stops.sum(), 1))
        stopped.append(stops.sum() / 30_000)
    assert broken <= 20  # of 60; at most a share of 0.2 breaks the promise, so more have a probability below 0.01
    assert 0.05 < np.mean(errors) < risk
    assert np.median(stopped) > 0.6


def test_an_overconfident_number_of_touches_is_closed_and_the_others_stay_open():
    made = certified_thresholds(simulated(np.random.default_rng(1), 6000, (1.0, 40.0, 1.0)), 0.1)
    assert np.isfinite(made.thresholds[1])
    assert made.thresholds[2] == np.inf
    assert np.isfinite(made.thresholds[3])
    assert made.stops[0] == made.stops[2] == 0


def test_a_search_stops_at_its_first_candidate_above_the_threshold_of_its_touches():
    found = CandidateStops([0, 0, 0, 2], [1, 2, 9, 9], [0.9, 0.8, 0.7, 1.0], [True, False, True, False], 3)
    assert found.stops([0.0]).tolist() == [0, 3]
    assert found.stops([0.0, 0.95, 0.8, np.inf]).tolist() == [1]
    assert [counts.tolist() for counts in found.counts([0.0, 0.95, 0.9])] == [[0, 0, 1], [0, 0, 0]]
    again = found.of(np.array([2, 0, 1, 2]))
    assert (again.num_searches, again.searches.tolist()) == (4, [0, 1, 1, 1, 3])
    assert again.probs.tolist() == [1.0, 0.9, 0.8, 0.7, 1.0]


def test_too_few_searches_or_none_with_a_candidate_certify_nothing():
    empty = CandidateStops([], [], [], [], 10_000)
    assert certified_thresholds(empty, 0.05).thresholds == (np.inf,)
    few = least_searches(0.05, 0.9) - 2
    assert np.isinf(certified_thresholds(simulated(np.random.default_rng(0), few, (0, 0, 0)), 0.05).thresholds).all()


@pytest.mark.parametrize(
    "change",
    [
        {"probs": [0.5, np.nan]},
        {"probs": [0.5, 1.5]},
        {"touches": [1, -1]},
        {"touches": [1, 0.5]},
        {"searches": [1, 0]},
        {"searches": [0, 5]},
        {"is_wrong": [False]},
    ],
)
def test_candidates_that_are_none_are_refused(change):
    given = {"searches": [0, 1], "touches": [1, 2], "probs": [0.5, 0.5], "is_wrong": [False, True], "num_searches": 2}
    with pytest.raises(ValueError, match="must"):
        CandidateStops(**(given | change))


@pytest.mark.parametrize("numbers", [(0.0, 0.9), (1.0, 0.9), (np.nan, 0.9), (0.05, 1.0)])
def test_a_risk_or_confidence_that_is_no_probability_is_refused(numbers):
    with pytest.raises(ValueError, match="must"):
        certified_thresholds(CandidateStops([], [], [], [], 10), *numbers)


def test_from_too_few_objects_arrays_promise_nothing():
    model, labels = random_model(np.random.default_rng(0), sharpness=0.0), [0, 0, 1, 1]
    assert set(certified_stops(model, np.zeros((4, 4)), labels, labels).thresholds) == {np.inf}
    with pytest.raises(ValueError, match="no object reaches"):
        calibration_of_stops(model, np.zeros((4, 4)), labels, labels)


def hard_objects(rng, number):
    """Three touches of each object; a fifth of the objects feel like one that is drawn at random, in all touches."""
    labels = np.arange(number) % 2
    strength = np.where(rng.random(number) < 0.2, 1.5 * rng.normal(size=number), 3.0)
    margin = ((2 * labels - 1) * strength)[:, None] + rng.normal(size=(number, 3))
    return np.stack([-margin, margin], axis=-1).reshape(-1, 2), np.repeat(labels, 3), np.repeat(np.arange(number), 3)


def test_stops_by_the_rule_that_arrays_promise_are_as_rarely_wrong_on_new_objects_after_every_number_of_touches():
    rng, number = np.random.default_rng(0), 20_000
    model = fit_observation_model(*hard_objects(rng, 400), candidates={"plda": fits()["plda"]}).model
    logits, labels, _ = hard_objects(rng, number)
    probs = np.exp(log_posteriors_by_touch(model, TouchBatch(np.zeros((number, 3), int), logits.reshape(number, 3, 2))))
    is_wrong, stated = probs.argmax(axis=2) != labels.reshape(number, 3), probs.max(axis=2)
    assert is_wrong[stated[:, 0] < 0.95, 1].mean() > 0.2  # who stopped at the second touch by itself would be wrong
    broken = used = 0
    for _ in range(20):
        made = certified_stops(model, *hard_objects(rng, 2000), risk=0.1).thresholds
        least = [made[min(touch, len(made)) - 1] for touch in (1, 2, 3)]
        stops = (stated >= least) & (np.cumsum(stated >= least, axis=1) == 1)
        used += stops[:, 0].sum() > 0.5 * number
        broken += any((is_wrong & stops).sum(axis=0) > 0.1 * stops.sum(axis=0))
    assert broken <= 5  # at most 0.1 of them break the promise, so more have a probability of 0.01
    assert used == 20


@pytest.mark.parametrize(
    ("stated", "wrong", "words"),
    [
        (0.9, 0.0, "with 60 searches: at least 144 are needed"),
        (
            0.98,
            0.02,
            r"of all 200 searches, 200 would stop where 0\.98 is stated, 4 of them wrongly\. Of these one half has 100 "
            r"\(2 wrong\), the other 100 \(2 wrong\); each half needs 72 stops if none is wrong",
        ),
        (0.98, 0.30, r"200 would stop where 0\.98 is stated, 60 of them wrongly\.$"),
    ],
)
def test_where_nothing_is_promised_the_reason_is_said(stated, wrong, words):
    number = 60 if wrong == 0.0 else 200
    is_wrong = np.arange(number) % 50 < 50 * wrong
    candidates = CandidateStops(np.arange(number), np.ones(number, int), np.full(number, stated), is_wrong, number)
    assert re.search(words, certified_thresholds(candidates, risk=0.05).note)


def test_any_number_of_touches_and_any_risk_is_certified_or_says_what_is_needed():
    right = np.zeros(400, bool)
    late = CandidateStops(np.arange(400), np.full(400, 10**12), np.ones(400), right, 400)
    assert certified_thresholds(late, 0.05).thresholds[-1] == 0.0
    soon = CandidateStops(np.arange(400), np.ones(400, int), np.ones(400), right, 400)
    assert "Nothing is promised with 400 searches" in certified_thresholds(soon, 5e-324).note
