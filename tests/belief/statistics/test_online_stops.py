"""A threshold that learns from reported outcomes: when it promises, that it keeps it, and how it regains it."""

import numpy as np
import pytest

from belief.errors import InvalidArgument
from belief.statistics.online_stops import GRID, OnlineStops


def told(stops, share_wrong, number, rng, until=lambda stops: False):
    """The stops after outcomes of answers that state 0.96 or more, and how many there were."""
    for count in range(number):
        if until(stops):
            return stops, count
        stops = stops.after(float(rng.uniform(0.96, 0.999)), bool(rng.random() < share_wrong))
    return stops, number


def test_nothing_is_promised_before_there_is_evidence_and_then_the_lowest_threshold_that_has_some():
    stops = OnlineStops(risk=0.1)
    assert stops.threshold == np.inf
    stops, count = told(stops, 0.0, 200, np.random.default_rng(0), lambda now: now.threshold < np.inf)
    assert 30 < count < 120
    assert stops.threshold in GRID
    stops, _ = told(stops, 0.0, 300, np.random.default_rng(1))
    assert stops.threshold == 0.95  # no outcome below 0.96 speaks for less


def test_too_many_wrong_answers_are_never_promised_whenever_one_looks():
    broken = 0
    for seed in range(60):
        _, count = told(
            OnlineStops(risk=0.1, confidence=0.9),
            0.11,  # more are promised less often
            300,
            np.random.default_rng(seed),
            lambda now: now.threshold < np.inf,
        )
        broken += count < 300
    assert broken <= 9  # 6 are expected at most


def test_after_a_change_it_withdraws_and_regains_from_good_outcomes():
    rng, lost, regained = np.random.default_rng(1), [], []
    for _ in range(8):
        stops, _ = told(OnlineStops(), 0.0, 200, rng)
        assert stops.threshold < np.inf
        stops, count = told(stops, 0.5, 100, rng, lambda now: now.beginnings == 1)
        assert stops.threshold == np.inf
        lost.append(count)
        stops, count = told(stops, 0.0, 300, rng, lambda now: now.threshold < np.inf)
        regained.append(count)
    assert np.mean(lost) < 30
    assert max(regained) <= 200


def test_a_good_sensor_is_seldom_withdrawn():
    ends = [told(OnlineStops(), 0.01, 500, np.random.default_rng(seed))[0].beginnings for seed in range(20)]
    assert sum(ends) <= 2


def test_outcomes_below_a_threshold_say_nothing_about_it():
    stops = OnlineStops()
    for _ in range(300):
        stops = stops.after(0.55, False)
    assert stops.threshold == np.inf
    assert stops.num_outcomes == 300
    assert "never" in str(stops)


def test_numbers_out_of_range_are_refused():
    with pytest.raises(InvalidArgument, match="risk"):
        OnlineStops(risk=0.0)
    with pytest.raises(InvalidArgument, match="stated"):
        OnlineStops().after(1.5, False)
