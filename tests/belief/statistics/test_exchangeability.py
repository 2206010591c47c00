"""The alarm that searches have changed: its false alarms, its delay, and what it is given."""

import numpy as np
import pytest

from belief.statistics import clopper_pearson_interval
from belief.statistics.exchangeability import _p_values, log_e_values

ALARM = np.log(1 / 0.1)


def odd(rng, size):
    """Scores of a world in which some objects are odd, tails are heavy, and many scores are equal."""
    scores = np.maximum(rng.standard_t(1.1, size), 0.0)
    return np.where(rng.random(size) < 0.03, 50.0, 1.0) * scores.round(1)


def test_in_an_unchanged_world_the_share_of_set_ups_that_ever_have_an_alarm_is_bounded(rng):
    alarms = 0
    for seed in range(150):
        scores, groups = odd(rng, (150, 2)), rng.integers(3, size=150)
        scores[:, 1] += scores[:, 0]
        found = log_e_values(scores[:40], groups[:40], scores[40:], groups[40:], seed)
        alarms += found.max() >= ALARM
    assert clopper_pearson_interval(int(alarms), 150)[0] <= 0.1


def test_p_values_are_uniform_and_independent_although_they_share_the_calibration(rng):
    found = np.array([list(_p_values(odd(rng, 5).tolist(), [0] * 5, odd(rng, 4).tolist(), [0] * 4, rng.random(4)))
                      for _ in range(2000)])  # fmt: skip
    assert np.abs(np.sort(found, axis=0) - np.linspace(0, 1, 2000)[:, None]).max() < 0.05
    assert np.abs(np.corrcoef(found.T) - np.eye(4)).max() < 0.08


def test_a_change_is_found_also_after_a_long_time_and_in_both_directions(rng):
    usual = rng.normal(size=(1500, 1))
    for late, shift, most in ((0, 2.0, 5), (0, -2.0, 12), (1000, 2.0, 40)):
        since = np.concatenate([usual[500 : 500 + late], shift + rng.normal(size=(most, 1))])
        found = log_e_values(usual[:500], np.zeros(500), since, np.zeros(len(since)))
        assert (found[:late] < ALARM).all()
        assert found[-1] >= ALARM


def test_groups_are_compared_with_their_own_so_that_another_mixture_is_no_change(rng):
    groups, since = rng.integers(2, size=1000), np.ones(200, int)
    usual, later = rng.normal(5.0 * groups)[:, None], rng.normal(5.0 * since)[:, None]
    assert log_e_values(usual, groups, later, since).max() < ALARM
    assert log_e_values(usual, 0 * groups, later, 0 * since).max() > 2 * ALARM


def test_extreme_scores_have_finite_e_values_and_nan_is_refused():
    for usual, since in (([[np.inf]], [[np.inf]] * 3), ([[0.0]], [[-np.inf], [np.inf]]), (np.empty((0, 1)), [[1.0]])):
        found = log_e_values(usual, np.zeros(len(usual)), since, np.zeros(len(since)))
        assert np.isfinite(found).all()
    for wrong, told in (([[np.nan]], "NaN"), ([[1.0, 2.0]], r"\(m, S\)"), ([1.0], r"\(m, S\)")):
        with pytest.raises(ValueError, match=told):
            log_e_values([[0.0]], [0], wrong, [0])
    with pytest.raises(ValueError, match="group for each"):
        log_e_values([[0.0]], [0, 1], [[0.0]], [0])
