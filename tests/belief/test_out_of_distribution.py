"""Novelty scores against explicit formulas, their laws, and what the interval of an AUROC covers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import binomtest, norm

from belief.out_of_distribution import MahalanobisScore, auroc, auroc_interval

few_scores = arrays(np.float64, st.integers(1, 12), elements=st.integers(-3, 3).map(float))  # with many ties


def clouds(rng, number=300, dimensions=4, classes=3):
    """Features around well separated means, mixed by a random linear map, and their labels."""
    labels = np.arange(number) % classes
    centres = 5.0 * rng.normal(size=(classes, dimensions))
    return (centres[labels] + rng.normal(size=(number, dimensions))) @ rng.normal(size=(dimensions,) * 2), labels


def test_mahalanobis_distance_is_the_one_with_the_inverse_covariance(rng):
    features, labels = clouds(rng)
    means = np.stack([features[labels == k].mean(axis=0) for k in range(3)])
    residuals = features - means[labels]
    for shrinkage in (0.0, 0.3, 1.0):
        covariance = residuals.T @ residuals / len(features)
        covariance = (1 - shrinkage) * covariance + shrinkage * np.trace(covariance) / 4 * np.eye(4)
        apart = rng.normal(size=(20, 1, 4)) * 5 - means
        expected = np.einsum("ncd,de,nce->nc", apart, np.linalg.inv(covariance), apart).min(axis=1)
        fitted = MahalanobisScore.fit(features, labels, shrinkage=shrinkage)
        np.testing.assert_allclose(fitted.score(apart[:, 0] + means[0]), expected, rtol=1e-9)


def test_without_shrinkage_no_invertible_affine_map_changes_the_distance(rng):
    features, labels = clouds(rng)
    new, linear, shift = 5 * rng.normal(size=(30, 4)), rng.normal(size=(4, 4)), 1e3 * rng.normal(size=4)
    score = MahalanobisScore.fit(features, labels, shrinkage=0.0).score(new)
    moved = MahalanobisScore.fit(features @ linear + shift, labels, shrinkage=0.0).score(new @ linear + shift)
    np.testing.assert_allclose(moved, score, rtol=1e-6)


@given(st.sampled_from([1e-140, 1e-12, 1.0, 1e12, 1e140]))
def test_with_shrinkage_units_and_rotations_still_do_not_matter(unit):
    rng = np.random.default_rng(0)
    features, labels = clouds(rng, number=40, dimensions=12)
    rotation = np.linalg.qr(rng.normal(size=(12, 12)))[0]
    fitted, turned = (MahalanobisScore.fit(x, labels) for x in (features, unit * features @ rotation))
    assert turned.shrinkage == pytest.approx(fitted.shrinkage)
    new = rng.normal(size=(9, 12))
    np.testing.assert_allclose(turned.score(unit * new @ rotation), fitted.score(new), rtol=1e-7)


def test_the_shrinkage_is_ledoit_and_wolfs_written_out(rng):
    x = rng.normal(size=(30, 8)) * np.arange(1, 9)
    x -= x.mean(axis=0)  # one class, so that these are the residuals
    covariance = x.T @ x / 30
    error = np.mean([np.square(np.outer(row, row) - covariance).sum() for row in x]) / 30
    distance = np.square(covariance - np.trace(covariance) / 8 * np.eye(8)).sum()
    assert MahalanobisScore.fit(x, np.zeros(30, int)).shrinkage == pytest.approx(min(error / distance, 1.0))


def test_more_data_is_shrunk_less(rng):
    few, many = (MahalanobisScore.fit(*clouds(np.random.default_rng(1), number=n)) for n in (12, 3000))
    assert many.shrinkage < 0.01 < few.shrinkage


def test_more_dimensions_than_samples_still_tell_novel_from_known(rng):
    # The novel cloud lies 60 standard deviations away in all; a single miss among 2 500 pairs would be a finding.
    labels = np.arange(20) % 2
    known = rng.normal(size=(70, 200)) + 10.0 * (np.arange(70) % 2)[:, None]
    fitted = MahalanobisScore.fit(known[:20], labels)
    novel = rng.normal(size=(50, 200)) - 60.0 / np.sqrt(200)
    assert auroc(fitted.score(known[20:]), fitted.score(novel)) == 1.0


def test_a_class_that_does_not_occur_has_no_mean(rng):
    features, labels = clouds(rng)
    kept = labels != 1
    fitted = MahalanobisScore.fit(features[kept], labels[kept])
    assert fitted.means.shape == (2, 4)
    np.testing.assert_allclose(
        fitted.score(features), MahalanobisScore.fit(features[kept], labels[kept] // 2).score(features)
    )


@pytest.mark.parametrize("level", [0.0, 0.1, -3e7])
def test_features_that_never_vary_have_unit_covariance(level):
    fitted = MahalanobisScore.fit(np.full((7, 2), level), np.zeros(7, int))
    assert fitted.score([[level, level], [level + 3.0, level - 4.0]]) == pytest.approx([0.0, 25.0])


def test_one_feature_that_never_varies_leaves_the_score_finite(rng):
    features, labels = clouds(rng)
    features[:, 2] = 0.7
    scores = MahalanobisScore.fit(features, labels).score(features)
    assert np.isfinite(scores).all()
    assert scores.min() >= 0.0


def test_two_samples_are_enough(rng):
    fitted = MahalanobisScore.fit([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0]], [3, 3])
    near, far = fitted.score([[1.0, 0.0, 1.0], [1.0, 9.0, 1.0]])
    assert near == pytest.approx(0.0)
    assert np.isfinite(far)
    assert far > fitted.score([[2.0, 0.0, 1.0]])[0]


def test_what_is_too_far_for_a_float_is_infinitely_novel():
    fitted = MahalanobisScore.fit([[0.0, 0.0], [1e-150, 0.0], [0.0, 1e-150]], [0, 0, 0])
    assert fitted.score([[1e150, -1e150]]).tolist() == [np.inf]


@pytest.mark.parametrize(
    ("features", "labels", "shrinkage", "message"),
    [
        (np.zeros((0, 2)), np.zeros(0, int), None, "n ≥ 1"),
        ([[0.0, np.nan]], [0], None, r"nan at \[0, 1\]"),
        ([[1e200]], [0], None, "1e\\+150"),
        ([[1.0], [2.0]], [0], None, "label for each of 2"),
        ([[1.0], [2.0]], [0.0, 1.0], None, "integer"),
        ([[1.0], [2.0]], [0, 0], 1.5, "shrinkage"),
        ([[1.0, 1.0], [2.0, 2.0]], [0, 0], 0.0, "singular"),
    ],
)
def test_mahalanobis_refuses_what_it_cannot_fit(features, labels, shrinkage, message):
    with pytest.raises(ValueError, match=message):
        MahalanobisScore.fit(features, labels, shrinkage)


def test_mahalanobis_scores_only_the_dimension_it_was_fitted_to(rng):
    with pytest.raises(ValueError, match="4 dimensions, got 3"):
        MahalanobisScore.fit(*clouds(rng)).score(np.zeros((2, 3)))


@given(few_scores, few_scores)
def test_auroc_counts_pairs(known, novel):
    pairs = (novel[:, None] > known).mean() + 0.5 * (novel[:, None] == known).mean()
    assert auroc(known, novel) == pytest.approx(pairs, abs=1e-12)
    assert auroc(novel, known) == pytest.approx(1.0 - pairs, abs=1e-12)


@given(few_scores, few_scores)
def test_only_the_order_of_the_scores_matters(known, novel):
    assert auroc(np.exp(7 * known), np.exp(7 * novel)) == auroc(known, novel)


def test_infinite_scores_have_their_place():
    assert auroc([-np.inf, 0.0], [np.inf, 1e308]) == 1.0
    assert auroc([np.inf], [np.inf]) == 0.5


def test_scores_that_say_nothing_have_an_auroc_of_a_half(rng):
    # Standard deviation sqrt((n + m + 1) / 12 n m) = .0091; five of them are exceeded with probability below 1e-6.
    assert abs(auroc(rng.normal(size=2000), rng.normal(size=2000)) - 0.5) < 5 * 0.0092


@pytest.mark.parametrize(("known", "novel"), [([], [1.0]), ([1.0], []), ([np.nan], [1.0]), ([0.0], [1.0, np.nan])])
def test_auroc_refuses_nothing_and_nan(known, novel):
    with pytest.raises(ValueError, match=r"at least one score|NaN"):
        auroc(known, novel)


def test_the_interval_covers_and_needs_to_know_which_touches_belong_together(rng):
    # Objects differ (unit variance), their touches little (.3). 400 intervals at 95 %: fewer than 360 hits has
    # probability 2e-5. Taken as independent, touches give intervals less than half as wide; they cover about .58
    # (4 000 runs with other seeds), and more than 310 hits then has probability below 1e-10.
    shift, hits, careless = 1.2, 0, 0
    truth = norm.cdf(shift / np.sqrt(2 * (1.0 + 0.3**2)))
    for _ in range(400):
        known, novel = (rng.normal(size=(40, 1)) + 0.3 * rng.normal(size=(40, 6)) for _ in range(2))
        _, low, high = auroc_interval(known, novel + shift)
        hits += low <= truth <= high
        _, low, high = auroc_interval(known.ravel(), (novel + shift).ravel())
        careless += low <= truth <= high
    assert hits >= 360
    assert careless <= 310


@given(few_scores.filter(lambda x: len(x) > 1), few_scores.filter(lambda x: len(x) > 1))
def test_the_interval_holds_the_value_and_turns_over_with_the_groups(known, novel):
    value, low, high = auroc_interval(known, novel)
    assert value == auroc(known, novel)
    assert 0.0 <= low <= value + 1e-12
    assert value - 1e-12 <= high <= 1.0
    assert auroc_interval(novel, known) == pytest.approx((1.0 - value, 1.0 - high, 1.0 - low), abs=1e-9)


def test_perfect_order_in_a_sample_is_no_proof_of_perfection():
    # 30 disjoint pairs all in order: the exact binomial bound is .025^(1/30).
    bound = 0.025 ** (1 / 30)
    assert auroc_interval(np.arange(30), 100 + np.arange(50)) == (1.0, pytest.approx(bound), 1.0)
    assert auroc_interval(100 + np.arange(50), np.arange(30)) == (0.0, 0.0, pytest.approx(1.0 - bound))


def test_ties_everywhere_leave_an_interval_as_wide_as_that_of_as_many_throws_of_a_coin():
    expected = binomtest(10, 20).proportion_ci(0.95, method="exact")
    assert auroc_interval(np.ones((20, 3)), np.ones(30)) == (
        0.5,
        pytest.approx(expected.low),
        pytest.approx(expected.high),
    )


@pytest.mark.parametrize(
    ("known", "novel", "confidence", "message"),
    [([1.0], [1.0, 2.0], 0.95, "two rows"), ([1.0, 2.0], [1.0, 2.0], 1.0, "confidence")],
)
def test_an_interval_needs_two_rows_and_a_confidence(known, novel, confidence, message):
    with pytest.raises(ValueError, match=message):
        auroc_interval(known, novel, confidence)
