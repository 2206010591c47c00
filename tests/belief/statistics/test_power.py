"""How many episodes settle a difference: against simulation and exact sums."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from belief.statistics import McNemar, mcnemar_test
from belief.statistics.comparison import episodes_for_success, holm


def pairs(first_only, second_only, n):
    return McNemar(n, first_only, second_only, 1.0, 1.0)


def exact_power(n, p_first, p_second, level=0.05):
    """Probability that McNemar's mid-p test rejects after n episodes, summed over all outcomes."""
    total = 0.0
    for discordant in range(n + 1):
        weight = stats.binom.pmf(discordant, n, p_first + p_second)
        if weight < 1e-9:
            continue
        first = np.arange(discordant + 1)
        chance = stats.binom.pmf(first, discordant, p_first / (p_first + p_second))
        fair = stats.binom.pmf(first, discordant, 0.5)
        below = np.cumsum(fair)
        fewer = np.minimum(first, discordant - first)
        mid_p = 2 * below[fewer] - fair[fewer]
        mid_p[first * 2 == discordant] = 1.0
        total += weight * chance[mid_p < level].sum()
    return total


@pytest.mark.parametrize(("first", "second"), [(0.10, 0.04), (0.06, 0.02), (0.25, 0.15)])
def test_the_test_has_the_power_promised_after_so_many_episodes(first, second):
    n = episodes_for_success(pairs(round(first * 1000), round(second * 1000), 1000))
    assert exact_power(n, first, second) == pytest.approx(0.8, abs=0.05)


def test_so_many_episodes_are_enough_where_one_is_never_alone_right():
    assert exact_power(episodes_for_success(pairs(40, 0, 1000)), 0.04, 0.0) >= 0.8


def test_no_number_is_so_small_that_the_test_can_never_reject():
    n = episodes_for_success(pairs(1, 0, 1))
    assert n == 5
    assert exact_power(n, 1.0 - 1e-12, 0.0) >= 0.8
    assert mcnemar_test([True] * (n - 1), [False] * (n - 1)).mid_p_value > 0.05


def test_mcnemar_on_drawn_episodes_agrees_with_the_exact_power(rng):
    n, trials = 200, 400
    draws = rng.choice(3, p=(0.10, 0.04, 0.86), size=(trials, n))
    found = np.mean([mcnemar_test(d == 0, d == 1).mid_p_value < 0.05 for d in draws])
    # 400 trials: standard error below .025, so four of them fail once in 16 000.
    assert found == pytest.approx(exact_power(n, 0.10, 0.04), abs=0.1)


def test_no_difference_seen_gives_no_number():
    assert episodes_for_success(pairs(3, 3, 100)) is None
    assert episodes_for_success(pairs(0, 0, 100)) is None


@given(st.integers(1, 50), st.integers(0, 50))
def test_a_larger_difference_needs_fewer_episodes(first, second):
    if first > second:
        n = episodes_for_success(pairs(first, second, 1000))
        assert episodes_for_success(pairs(first + 10, second, 1000)) <= n


def test_corrected_p_values_are_those_of_holms_paper_method():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.5, 0.9]) == [1.0, 1.0]
    assert holm([]) == []


@given(st.lists(st.floats(0, 1), min_size=1, max_size=6))
def test_correction_never_lowers_a_p_value_and_keeps_their_order(values):
    corrected = np.array(holm(values))
    assert (corrected >= np.array(values) - 1e-15).all()
    assert (corrected <= 1).all()
    assert (np.diff(corrected[np.argsort(values, kind="stable")]) >= 0).all()


@pytest.mark.parametrize(
    "wrong", [{"level": 0.0}, {"level": 5}, {"power": 1.0}, {"power": float("nan")}, {"power": "0.8"}]
)
def test_a_level_or_a_power_that_is_none_is_refused(wrong):
    [name] = wrong
    with pytest.raises(ValueError, match=rf"{name} must be a number in \(0, 1\)"):
        episodes_for_success(pairs(3, 3, 100), **wrong)


def test_less_power_never_needs_more_episodes():
    powers = (0.9, 0.5, 0.1, 0.025, 0.02, 1e-3, 1e-9)
    numbers = [episodes_for_success(pairs(30, 10, 1000), power=power) for power in powers]
    assert numbers == sorted(numbers, reverse=True)
    assert numbers[-1] == 5
