"""A threshold that learns from reported outcomes: when it promises, that it keeps it, and how it regains it."""

import numpy as np
import pytest

from belief.errors import InvalidArgument
from belief.statistics.online_stops import GRID, OnlineStops, _enough


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


@pytest.mark.parametrize("risk", [0.02, 0.1, 0.5])
def test_a_wrong_threshold_is_ever_accepted_with_the_probability_that_its_chain_may_spend(risk):
    """All paths of 3000 outcomes, one outcome at a time, of which a share of the risk is wrong."""
    for fewest, spent in zip(_enough(risk, 0.9, 0), (0.1 / 12, 0.1 / 6, 0.1 / 12), strict=True):
        probs, accepted = np.zeros(500), 0.0
        probs[0] = 1.0
        for number in range(1, 3001):
            probs[1:], probs[0] = (1.0 - risk) * probs[1:] + risk * probs[:-1], (1.0 - risk) * probs[0]
            enough = fewest[:500] <= number
            accepted += probs[enough].sum()
            probs[enough] = 0.0
        assert 0.8 * spent < accepted <= spent * (1.0 + 1e-9)


def test_all_beginnings_together_spend_what_may_be_spent():
    shares = [1 / 3, 1 / 3, *(1 / (3 * b * (b - 1)) for b in range(2, 4000))]
    assert 0.999 < sum(shares) <= 1.0
    enough = [_enough(0.05, 0.9, beginnings)[1, 0] for beginnings in range(6)]
    assert enough == [np.ceil(np.log(0.05 * share * 0.19) / np.log(0.95)) for share in shares[:6]]


@pytest.mark.parametrize(("number", "most"), [(20, 4), pytest.param(60, 9, marks=pytest.mark.nightly)])
def test_too_many_wrong_answers_are_never_promised_whenever_one_looks(number, most):
    broken = 0
    for seed in range(number):
        _, count = told(
            OnlineStops(risk=0.1, confidence=0.9),
            0.11,  # more are promised less often
            300,
            np.random.default_rng(seed),
            lambda now: now.threshold < np.inf,
        )
        broken += count < 300
    assert broken <= most  # a tenth is expected at most


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


def test_answers_that_all_state_the_same_are_promised_at_the_entry_below_them_and_no_lower():
    found = {}
    for stated in (0.999, 0.98, 0.92):
        stops = OnlineStops(risk=0.1)
        for _ in range(200):
            stops = stops.after(stated, False)
        found[stated] = stops.threshold
    assert found == {0.999: 0.99, 0.98: 0.95, 0.92: 0.9}


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


@pytest.mark.parametrize("risk", [5e-324, 1e-300])
def test_a_risk_without_arithmetic_is_refused(risk):
    with pytest.raises(InvalidArgument, match=r"risk must be a number in \[1e-06, 1\)"):
        OnlineStops(risk=risk)
    assert OnlineStops(risk=1e-6).after(1.0, False).threshold == np.inf


@pytest.mark.parametrize("given", [None, "no", np.nan, 2])
def test_an_outcome_is_wrong_or_right(given):
    with pytest.raises(InvalidArgument, match="is_wrong must be True or False, got"):
        OnlineStops().after(0.9, given)
    assert OnlineStops().after(0.9, np.bool_(True)).num_wrong == 1
