"""Selective risk against coverage: by hand, by enumeration of ties, and its bootstrap interval."""

from itertools import pairwise, permutations

import numpy as np
import pytest

from belief.metrics.selective_risk import risk_coverage


def by_enumeration(trust, correct):
    """Mean curve over all orders that sort by trust."""
    curves = []
    for order in permutations(range(len(trust))):
        if all(trust[a] >= trust[b] for a, b in pairwise(order)):
            wrong = np.array([not correct[i] for i in order], float)
            curves.append(wrong.cumsum() / np.arange(1, len(wrong) + 1))
    return np.mean(curves, axis=0)


@pytest.mark.parametrize("seed", range(8))
def test_equally_trusted_answers_count_as_if_in_random_order(seed, rng):
    chance = np.random.default_rng(seed)
    trust, correct = chance.integers(3, size=6).astype(float), chance.random(6) < 0.6
    curve = risk_coverage(trust, correct, rng, num_unanswered=2, num_resamples=5)
    np.testing.assert_allclose(curve.risk, by_enumeration(trust, correct), atol=1e-12)
    np.testing.assert_allclose(curve.coverage, np.arange(1, 7) / 8)
    assert curve.area == pytest.approx(curve.risk.mean())
    assert curve.full_risk == pytest.approx(1.0 - correct.mean())


def test_only_the_order_of_the_scores_matters(rng):
    correct = rng.random(40) < 0.7
    trust = rng.normal(size=40)
    one, other = (risk_coverage(t, correct, np.random.default_rng(0)) for t in (trust, np.exp(3 * trust) - 50))
    np.testing.assert_array_equal(one.risk, other.risk)
    assert (one.area, one.interval) == (other.area, other.interval)


def test_a_score_that_tells_right_from_wrong_has_a_smaller_area_and_no_score_has_the_risk():
    correct = np.arange(200) % 4 > 0
    rng = np.random.default_rng(0)
    perfect = risk_coverage(correct, correct, rng)
    none = risk_coverage(np.zeros(200), correct, rng)
    reverse = risk_coverage(~correct, correct, rng)
    assert perfect.area < none.area < reverse.area
    assert none.area == pytest.approx(0.25)
    np.testing.assert_allclose(none.risk, 0.25)


def test_the_interval_of_the_area_covers_it_about_as_often_as_it_says():
    # Without a useful score the area is the risk, 0.3. Of 100 intervals of 95 %, fewer than 84 hold it with p < 1e-4.
    chance = np.random.default_rng(1)
    curves = [risk_coverage(np.zeros(80), chance.random(80) < 0.7, chance, num_resamples=100) for _ in range(100)]
    assert sum(curve.interval[0] <= 0.3 <= curve.interval[1] for curve in curves) >= 84
    assert np.mean([high - low for low, high in (curve.interval for curve in curves)]) == pytest.approx(0.2, abs=0.03)


def test_one_answer_and_none_wrong_are_curves(rng):
    assert risk_coverage([0.5], [False], rng).risk.tolist() == [1.0]
    curve = risk_coverage([0.5, 0.6], [True, True], rng, num_unanswered=10**6)
    assert (curve.area, curve.interval) == (0.0, (0.0, 0.0))
    assert curve.coverage[-1] == pytest.approx(2 / (10**6 + 2))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"trust": []}, "score for each"),
        ({"trust": [0.1]}, "score for each"),
        ({"trust": [0.1, np.nan]}, "finite"),
        ({"trust": [[0.1, 0.2]]}, "score for each"),
        ({"trust": ["a", "b"]}, "numbers"),
        ({"correct": [2, 0]}, "right"),
        ({"correct": []}, "at least one"),
        ({"num_unanswered": -1}, "num_unanswered"),
        ({"num_unanswered": 0.5}, "num_unanswered"),
        ({"confidence": 95}, "confidence"),
        ({"num_resamples": 0}, "num_resamples"),
    ],
)
def test_what_is_no_list_of_answers_is_refused_by_name(arguments, message, rng):
    with pytest.raises(ValueError, match=message):
        risk_coverage(**{"trust": [0.1, 0.2], "correct": [1, 0], "rng": rng, **arguments})
