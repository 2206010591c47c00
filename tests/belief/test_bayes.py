"""Laws of Bayes' rule and information, and agreement with plain arithmetic where that is exact."""

import math
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from belief import Belief, ImpossibleObservation, bayes
from belief.bayes import entropy, expected_information_gain, target_information_gain, update

log_likelihoods = arrays(np.float64, 4, elements=st.floats(-50, 50))


@st.composite
def distributions(draw, size=4):
    weights = draw(arrays(np.float64, size, elements=st.floats(1e-6, 1.0)))
    return weights / weights.sum()


@st.composite
def outcome_tables(draw, num_poses=3, num_shapes=4, num_outcomes=5):
    weights = draw(arrays(np.float64, (num_poses, num_shapes, num_outcomes), elements=st.floats(1e-6, 1.0)))
    return weights / weights.sum(axis=2, keepdims=True)


@given(distributions(), arrays(np.float64, 4, elements=st.floats(-1e4, 1e4)))
def test_update_of_logarithms_agrees_with_fifty_digits(prior, log_likelihood):
    log_prior = np.log(prior)
    log_posterior, log_evidence = update(log_prior, log_likelihood)
    with localcontext(prec=50):
        scores = [Decimal(float(p)) + Decimal(float(score)) for p, score in zip(log_prior, log_likelihood, strict=True)]
        log_total = sum(score.exp() for score in scores).ln()
        log_prior_total = sum(Decimal(float(p)).exp() for p in log_prior).ln()
        exact = [float(score - log_total) for score in scores]
        exact_evidence = float(log_total - log_prior_total)
    np.testing.assert_allclose(log_posterior, exact, rtol=1e-14, atol=1e-13)
    assert math.isclose(log_evidence, exact_evidence, rel_tol=1e-14, abs_tol=1e-13)


@pytest.mark.parametrize(
    ("prior_shape", "likelihood_shape"),
    [((3,), (7, 3)), ((7, 3), (3,)), ((2, 1, 3), (5, 3)), ((1, 3), (3,)), ((1, 1, 3), (2, 3)), ((40, 3), (40, 3))],
)
def test_leading_axes_broadcast(prior_shape, likelihood_shape, rng):
    prior, likelihood = rng.dirichlet(np.ones(3), prior_shape[:-1]), rng.random(likelihood_shape)
    prior, likelihood = np.log(prior), np.log(likelihood)
    posterior, evidence = update(prior, likelihood)
    shape = np.broadcast_shapes(prior_shape, likelihood_shape)
    priors, likelihoods = np.broadcast_to(prior, shape), np.broadcast_to(likelihood, shape)
    assert (posterior.shape, evidence.shape) == (shape, shape[:-1])
    for index in np.ndindex(shape[:-1]):
        row, row_evidence = update(priors[index], likelihoods[index])
        np.testing.assert_allclose(posterior[index], row, rtol=1e-14)
        assert math.isclose(evidence[index], row_evidence, rel_tol=1e-14)


@pytest.mark.parametrize("num_shapes", [1, 2, 16, 17, 20_000])
def test_batches_longer_than_a_block_are_their_rows(num_shapes, rng):
    num_rows = 3 if num_shapes > 100 else 20_000 // num_shapes
    prior = rng.dirichlet(np.ones(num_shapes), num_rows)
    likelihood = rng.random((num_rows, num_shapes))
    prior, likelihood = np.log(np.maximum(prior, 1e-300)), np.log(likelihood)
    posterior, evidence = update(prior, likelihood)
    for i in (0, 1, num_rows - 1):
        row, row_evidence = update(prior[i], likelihood[i])
        np.testing.assert_allclose(posterior[i], row, rtol=1e-12, atol=1e-300)
        assert math.isclose(evidence[i], row_evidence, rel_tol=1e-12)


@pytest.mark.parametrize("one_row", [True, False])
def test_a_likelihood_huge_where_nothing_is_believed_does_not_blur_the_rest(one_row):
    log_prior, log_likelihood = np.log([0.25, 0.75]), np.array([0.125, 0.25])
    log_posterior, log_evidence = update(log_prior, log_likelihood)
    wide_prior, wide_likelihood = np.append(log_prior, -np.inf), np.append(log_likelihood, 1e20)
    if not one_row:
        wide_prior, wide_likelihood = wide_prior[None], wide_likelihood[None]
    wide_posterior, wide_evidence = update(wide_prior, wide_likelihood)
    np.testing.assert_allclose(wide_posterior.ravel()[:2], log_posterior, rtol=1e-15)
    np.testing.assert_allclose(wide_evidence, log_evidence, rtol=1e-14)


def test_a_prior_of_float16_is_near_its_numbers():
    found = update(np.log(np.float16([0.1, 0.2, 0.7])), np.zeros(3))[0]
    np.testing.assert_allclose(found, np.log([0.1, 0.2, 0.7]), atol=2e-3)


def test_certainty_recovers_when_later_touches_disagree():
    belief, against = np.log([0.5, 0.5]), np.log([0.3, 0.7])
    for _ in range(1000):
        belief = update(belief, np.log([0.7, 0.3]))[0]
    assert np.exp(belief[1]) < 1e-300
    for _ in range(1005):
        belief = update(belief, against)[0]
    assert np.exp(belief[1]) == pytest.approx(1 / (1 + (3 / 7) ** 5), rel=1e-9)


def test_a_million_touches_stay_within_a_milli_nat_of_exact_summation(rng):
    steps = np.log(rng.dirichlet(np.ones(2) * 50, size=1_000_000))
    belief = np.log([0.5, 0.5])
    for chunk in steps.reshape(1000, 1000, 2):
        belief = update(belief, chunk.sum(axis=0))[0]
    exact = math.fsum(steps[:, 0]) - math.fsum(steps[:, 1])
    assert abs((belief[0] - belief[1]) - exact) < 1e-3


def test_impossible_evidence_raises_and_names_the_row():
    prior = np.log([[0.5, 0.5], [1.0, 1e-300]])
    with pytest.raises(ImpossibleObservation, match=r"row 0"):
        update(prior, [[-np.inf, -np.inf], [0.0, 0.0]])


@pytest.mark.parametrize(
    ("log_prior", "log_likelihood", "message"),
    [
        ([[np.log(0.5)] * 2] * 3, [[0, 0], [0, np.nan], [0, 0]], r"log_likelihood in row 1 \(from 0\) holds NaN"),
        ([np.log(0.5)] * 2, [np.inf, 0.0], "NaN or [+]inf"),
        ([np.nan, 0.0], [0.0, 0.0], "log_prior holds NaN"),
        (np.log([0.5, 0.6]), [0.0, 0.0], "do not sum to one"),
        (np.log([0.5, 0.5]), [0.0, 0.0, 0.0], "same, non-empty last axis"),
        ([], [], "non-empty"),
        (np.log([0.5, 0.5]), np.zeros((0, 2)), "nothing to update"),
    ],
)
def test_bad_input_raises_and_says_where(log_prior, log_likelihood, message):
    with pytest.raises(ValueError, match=message):
        update(log_prior, log_likelihood)


def test_the_row_of_a_batch_of_batches_is_named_by_all_its_indices():
    log_likelihood = np.zeros((3, 4, 2))
    log_likelihood[2, 1, 0] = np.nan
    with pytest.raises(ValueError, match=r"log_likelihood in row \(2, 1\) \(from 0\) holds NaN"):
        update(np.log([0.5, 0.5]), log_likelihood)


@pytest.mark.parametrize(
    "call",
    [
        lambda: entropy([0.5, np.nan]),
        lambda: entropy([1.5, -0.5]),
        lambda: entropy([0.5, 0.6]),
        lambda: entropy([]),
        lambda: expected_information_gain([0.5, 0.6], np.full((1, 2, 2), 0.5)),
        lambda: expected_information_gain([0.5, 0.5], np.full((1, 3, 2), 0.5)),
        lambda: expected_information_gain([0.5, 0.5], np.full((2, 2), 0.5)),
        lambda: expected_information_gain([0.5, 0.5], np.full((1, 2, 2), np.nan)),
        *[
            lambda target=target: target_information_gain([0.5, 0.5], np.full((1, 2, 2), 0.5), target)
            for target in (2, -1, True, 1.0, "cube")
        ],
        lambda: target_information_gain([0.5, 0.5], np.full((1, 2, 2), 0.4), target=0),
    ],
)
def test_information_about_what_is_no_distribution_is_refused(call):
    with pytest.raises(ValueError, match=r"holds|must be|needs"):
        call()


@given(distributions(), outcome_tables())
def test_information_gain_is_the_expected_drop_of_entropy(belief, table):
    for pose, gain in enumerate(expected_information_gain(belief, table)):
        predictive = belief @ table[pose]
        posteriors = (belief[:, None] * table[pose] / predictive).T
        assert gain == pytest.approx(entropy(belief) - predictive @ entropy(posteriors), abs=1e-9)


@given(distributions(), outcome_tables(), st.integers(0, 3))
def test_target_gain_is_the_full_gain_of_the_two_way_problem(belief, table, target):
    others = np.delete(np.arange(4), target)
    missed = belief[others].sum()
    merged = np.stack([table[:, target], np.einsum("k,pkm->pm", belief[others] / missed, table[:, others])], axis=1)
    expected = expected_information_gain([belief[target], missed], merged)
    np.testing.assert_allclose(target_information_gain(belief, table, target), expected, atol=1e-9)


# Beyond the largest float.

LARGEST = np.finfo(float).max
huge = st.sampled_from([0.0, -1.0, 1.0, 1e300, -1e300, 1e308, -1e308, 1.7e308, -1.7e308, LARGEST, -LARGEST, -np.inf])
unlikely = st.sampled_from([-1.0, -700.0, -1e300, -1e308, -1.7e308, -LARGEST, -np.inf])


def exact_log_posterior(log_prior, log_likelihood):
    """Bayes' rule in rational numbers, cut off at the largest float."""
    joint = [
        None if -np.inf in pair else sum(map(Fraction, pair)) for pair in zip(log_prior, log_likelihood, strict=True)
    ]
    best = max(score for score in joint if score is not None)
    away = [None if score is None else max(score - best, Fraction(-LARGEST)) for score in joint]
    log_total = math.log(sum(math.exp(score) for score in away if score is not None))
    return [-np.inf if score is None else max(float(score) - log_total, -LARGEST) for score in away]


@given(st.lists(unlikely, min_size=1, max_size=3), st.data())
def test_what_is_possible_stays_possible_however_improbable(others, data):
    log_prior = [0.0, *others]
    log_likelihood = data.draw(st.lists(huge, min_size=len(log_prior), max_size=len(log_prior)))
    if all(-np.inf in pair for pair in zip(log_prior, log_likelihood, strict=True)):
        log_likelihood[0] = 0.0
    prior = np.array(log_prior)
    log_prior = (prior - np.logaddexp.reduce(prior)).tolist()
    expected = exact_log_posterior(log_prior, log_likelihood)
    size = max(abs(number) for number in (*log_prior, *log_likelihood) if number > -np.inf)  # so much is rounded
    for copies in (1, 3):
        found = update(np.tile(log_prior, (copies, 1)), np.tile(log_likelihood, (copies, 1)))[0]
        np.testing.assert_array_equal(np.isfinite(found), np.isfinite(np.tile(expected, (copies, 1))))
        np.testing.assert_allclose(found, np.tile(expected, (copies, 1)), rtol=1e-12, atol=max(1e-15 * size, 1e-12))
        np.testing.assert_allclose(np.exp(found).sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_array_equal(update(log_prior, log_likelihood)[0] > -np.inf, found[0] > -np.inf)


@pytest.mark.parametrize("size", [1e16, 1e300, 1e308, LARGEST])
@pytest.mark.parametrize("unlikely", [1e-320, 1e-300, 1e-17])
def test_priors_decide_between_equal_likelihoods_of_any_size(unlikely, size):
    log_prior = np.log([unlikely, 0.5, 0.5])
    for log_likelihood in ([size, size, -size], [size, -size, size], [-size, -size, -size], [size, size, size]):
        expected = exact_log_posterior(log_prior, log_likelihood)
        for found in (update(log_prior, log_likelihood)[0], update([log_prior] * 2, [log_likelihood] * 2)[0][1]):
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(
            Belief(tuple("abc"), log_prior).update(log_likelihood).log_probs, expected, atol=1e-12
        )


def test_what_overflowed_comes_back():
    log_probs = np.log(np.full((20, 2), 0.5))
    for step in [[0.0, -1.7e308]] * 3 + [[-1.7e308, 0.0]] * 2:
        log_probs, _ = update(log_probs, np.tile(step, (20, 1)))
    assert np.exp(log_probs).tolist() == [[0.0, 1.0]] * 20


@pytest.mark.parametrize("total", [0.9985, 1.0015])
@pytest.mark.parametrize(
    ("prior", "likelihood"),
    [([0.3, 0.5, 0.2], [0.1, 0.7, 0.4]), ([0.0, 0.6, 0.4], [1.0, 1e-200, 3e-200])],  # the second needs care
)
def test_a_prior_that_nearly_sums_to_one_answers_as_its_normalised_form(prior, likelihood, total):
    product = np.multiply(prior, likelihood)
    with np.errstate(divide="ignore"):
        log_prior, log_likelihood = np.log(np.multiply(prior, total)), np.log(likelihood)
    for copies in (1, 3):
        for found in (
            map(np.exp, update(np.tile(log_prior, (copies, 1)), log_likelihood)),
            map(np.exp, update(log_prior, log_likelihood)),
        ):
            posterior, evidence = map(np.atleast_1d, found)
            np.testing.assert_allclose(posterior, np.broadcast_to(product / product.sum(), posterior.shape), rtol=1e-9)
            np.testing.assert_allclose(evidence, product.sum(), rtol=1e-9)


def test_what_a_prior_rules_out_stays_ruled_out_in_every_block(rng):
    num_rows = 20_000  # several blocks
    prior = rng.dirichlet(np.ones(2), num_rows)
    prior[::3] = [1.0, 0.0]
    likelihood = rng.random((num_rows, 2))
    likelihood[1::3, 0] = 0.0
    product = prior * likelihood
    with np.errstate(divide="ignore"):
        posterior = np.exp(update(np.log(prior), np.log(likelihood))[0])
    np.testing.assert_allclose(posterior, product / product.sum(axis=1, keepdims=True), rtol=1e-12)


@given(distributions(), arrays(np.float64, (5, 4), elements=st.floats(-200, 200)))
def test_the_plain_rule_and_the_careful_one_agree(prior, scores):
    log_prior = np.log(prior)
    careful, evidence, is_answered = bayes._careful_logs(np.tile(log_prior, (5, 1)), scores)
    assert is_answered.all()
    one_by_one = [np.array(part) for part in zip(*(update(log_prior, row) for row in scores), strict=True)]
    for rows in (update(log_prior, scores), one_by_one):
        np.testing.assert_allclose(rows[0], careful, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(rows[1], evidence, rtol=1e-12, atol=1e-12)
