"""Exact marginals against enumeration of every arrangement."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.special import gammaln, softmax

from belief import ImpossibleObservation, arrangement
from belief.arrangement import (
    arrangement_marginals,
    log_arrangement_marginals,
    num_states,
    prob_shape_absent,
)


def enumerate_draws(weights: np.ndarray, counts=None) -> tuple[np.ndarray, float]:
    """Marginals, and the mean weight, over all equally likely ordered draws of single things from the bag."""
    num_objects, num_shapes = weights.shape
    things = np.repeat(np.arange(num_shapes), (1,) * num_shapes if counts is None else counts)
    totals, draws = np.zeros_like(weights), 0
    for drawn in itertools.permutations(things.tolist(), num_objects):
        totals[np.arange(num_objects), drawn] += math.prod(weights[i, k] for i, k in enumerate(drawn))
        draws += 1
    return totals / max(totals[0].sum(), 5e-324), totals[0].sum() / draws


def enumerate_marginals(weights: np.ndarray) -> np.ndarray:
    """Sum over all injective maps from objects to shapes."""
    return enumerate_draws(weights)[0]


@st.composite
def log_weights(draw):
    num_shapes = draw(st.integers(1, 5))
    num_objects = draw(st.integers(1, num_shapes))
    return draw(arrays(np.float64, (num_objects, num_shapes), elements=st.floats(-20, 20)))


@st.composite
def bags(draw):
    """Log weights, some of them -inf, some rows blank, and the counts of a bag that is large enough."""
    counts = draw(st.lists(st.integers(0, 3), min_size=1, max_size=4).filter(lambda counts: 0 < sum(counts) <= 6))
    num_objects = draw(st.integers(1, min(sum(counts), 4)))
    elements = st.one_of(st.floats(-20, 20), st.just(-np.inf), st.just(0.0))
    weights = draw(arrays(np.float64, (num_objects, len(counts)), elements=elements))
    weights[draw(arrays(np.bool_, num_objects))] = 0.0
    return weights, counts


@given(bags())
def test_marginals_of_a_bag_equal_enumeration(bag):
    weights, counts = bag
    marginals, evidence = enumerate_draws(np.exp(weights), counts)
    if evidence == 0.0:
        with pytest.raises(ImpossibleObservation):
            arrangement_marginals(weights, counts)
    else:
        np.testing.assert_allclose(arrangement_marginals(weights, counts), marginals, atol=1e-12)


@given(log_weights())
def test_a_bag_with_very_many_of_each_shape_is_as_good_as_independence(weights):
    marginals = arrangement_marginals(weights, [2**50] * weights.shape[1])
    expected = np.exp(weights - weights.max(axis=1, keepdims=True))
    np.testing.assert_allclose(marginals, expected / expected.sum(axis=1, keepdims=True), atol=1e-12)


def test_log_marginals_reach_below_the_least_float():
    log_marginals = log_arrangement_marginals([[0.0, -2000.0, -3000.0], [0.0, -1.0, 0.0], [0.0, 0.0, 0.0]])
    # Beside a first object of shape 0 the others weigh 1 + 1/e, of shape 1 they weigh 2, of shape 2 again 1 + 1/e.
    expected = [0.0, -2000.0 + math.log(2 / (1 + math.exp(-1))), -3000.0]
    np.testing.assert_allclose(log_marginals[0], expected, rtol=1e-14)


@given(log_weights())
def test_marginals_equal_enumeration(weights):
    np.testing.assert_allclose(arrangement_marginals(weights), enumerate_marginals(np.exp(weights)), atol=1e-12)


@given(bags())
def test_a_list_of_all_arrangements_and_the_sum_over_multisets_agree(bag):
    weights, counts = bag[0], tuple(bag[1])
    if enumerate_draws(np.exp(weights), counts)[1] > 0.0:
        log_weights = np.where(np.array(counts) > 0, weights, -np.inf)
        careful = arrangement._sum_over_arrangements(log_weights, counts)
        np.testing.assert_allclose(arrangement_marginals(weights, counts), np.exp(careful), atol=1e-12)


def test_twelve_objects_use_every_shape_exactly_once(rng):
    marginals = arrangement_marginals(rng.normal(size=(12, 12)) * 3)
    np.testing.assert_allclose(marginals.sum(axis=0), 1.0, atol=1e-12)
    np.testing.assert_allclose(marginals.sum(axis=1), 1.0, atol=1e-12)


def test_two_objects_that_can_only_be_the_same_shape_are_impossible():
    weights = np.array([[0.0, -np.inf], [0.0, -np.inf]])
    with pytest.raises(ImpossibleObservation, match="to have the same shape"):
        arrangement_marginals(weights)


@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        ([[1e308, -1e308], [1e308, -1e308]], [[0.5, 0.5], [0.5, 0.5]]),
        ([[0.0, -1e308, -1e308], [0.0, -1e308, -1e308], [0.0, -1e308, -1e308]], np.full((3, 3), 1 / 3)),
        ([[1e308, 0.0], [0.0, 0.0]], [[1.0, 0.0], [0.0, 1.0]]),
    ],
)
def test_weights_at_the_edge_of_floats_have_marginals(weights, expected):
    np.testing.assert_allclose(arrangement_marginals(weights), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (np.zeros((3, 2)), "3 objects cannot all differ"),
        (np.eye(21), "more than 1048576 multisets"),
        (np.zeros((0, 3)), "at least one object"),
        (np.array([[0.0, 1.0], [np.nan, 0.0]]), r"row 1 \(from 0\) hold NaN"),
        (np.array([[0.0, 1.0], [0.0, np.inf]]), r"row 1 \(from 0\) hold NaN or [+]inf"),
        (np.zeros(3), "must be"),
        (np.array([["a"]]), "real numbers"),
    ],
)
def test_bad_input_raises_and_says_why(weights, message):
    with pytest.raises(ValueError, match=message):
        arrangement_marginals(weights)


@pytest.mark.parametrize(
    ("counts", "message"),
    [
        ([1, 1, 1], "must be 2 numbers"),
        ([-1, 4], "at least zero"),
        ([1, 0], "2 objects cannot come from a bag of 1"),
        ([0, 0], "bag of 0"),
    ],
)
def test_a_bag_that_does_not_fit_is_refused(counts, message):
    with pytest.raises(ValueError, match=message):
        arrangement_marginals(np.zeros((2, 2)), counts)


def test_two_objects_of_which_a_bag_holds_one_are_impossible():
    with pytest.raises(ImpossibleObservation, match="more objects of a shape than the bag holds"):
        arrangement_marginals([[0.0, -np.inf], [0.0, -np.inf]], [1, 5])


def test_few_objects_of_many_shapes_are_no_problem(rng):
    weights = rng.normal(size=(2, 60))
    np.testing.assert_allclose(arrangement_marginals(weights), enumerate_marginals(np.exp(weights)), atol=1e-12)


def test_what_is_refused_is_what_has_too_many_multisets():
    assert num_states([1] * 20, 20) == 2**20
    assert num_states([9] * 6, 54) == 10**6
    with pytest.raises(ValueError, match=r"45 objects from a bag of 63 in 7 shapes .* Use fewer"):
        num_states([9] * 7, 45)


def test_what_is_asked_of_too_many_multisets_is_refused_not_computed():
    for ask in (log_arrangement_marginals, lambda weights: prob_shape_absent(weights, None, 0)):
        with pytest.raises(ValueError, match=r"21 objects from a bag of 21 in 21 shapes .* Use fewer"):
            ask(np.eye(21))


@pytest.mark.parametrize(("counts", "advantage"), [((600, 700), -0.3), ((550, 550), 5.0)])
def test_marginals_of_a_thousand_alike_objects_of_two_shapes_are_binomial_sums(counts, advantage):
    """There are more than 1e308 arrangements. All objects are alike, so one has the first shape in the mean share."""
    number, (some, others) = 1100, counts
    first = np.arange(max(0, number - others), min(number, some) + 1)
    choose = gammaln(number + 1) - gammaln(first + 1) - gammaln(number - first + 1)
    draws = gammaln(some + 1) - gammaln(some - first + 1) + gammaln(others + 1) - gammaln(others - number + first + 1)
    expected = softmax(choose + draws + advantage * first) @ first / number
    marginals = arrangement_marginals(np.tile([advantage, 0.0], (number, 1)), counts)
    np.testing.assert_allclose(marginals, np.tile([expected, 1.0 - expected], (number, 1)), rtol=1e-9)


@given(bags(), st.data())
def test_the_probability_that_some_objects_lack_a_shape_equals_enumeration(bag, data):
    weights, counts = bag
    likelihoods = np.exp(weights)
    _, evidence = enumerate_draws(likelihoods, counts)
    if evidence == 0.0:
        return
    shape = data.draw(st.integers(0, len(counts) - 1))
    lacking = likelihoods.copy()
    lacking[:, shape] = 0.0
    expected = enumerate_draws(lacking, counts)[1] / evidence
    assert prob_shape_absent(weights, counts, shape) == pytest.approx(expected, rel=1e-9, abs=1e-12)


SIZES = [0.0, 0.5, -1.0, -700.0, 1e9, 1e16, -1e16, 1e300, -1e300, 1e308, -1e308, 1.797e308, -1.797e308, -np.inf]


def exact_marginals(weights, counts):
    """Marginals by listing all arrangements, with their log weights as fractions."""
    places, things = range(len(weights)), [k for k, count in enumerate(counts) for _ in range(count)]
    every = list(itertools.permutations(range(len(things)), len(weights)))
    shapes = [[things[i] for i in some] for some in every]
    shapes = [some for some in shapes if all(weights[i][k] > -np.inf for i, k in zip(places, some, strict=True))]
    if not shapes:
        return None
    logs = [sum(Fraction(weights[i][k]) for i, k in zip(places, some, strict=True)) for some in shapes]
    shares = [math.exp(max(one - max(logs), -1000)) for one in logs]
    found = np.zeros((len(weights), len(counts)))
    for some, share in zip(shapes, shares, strict=True):
        found[places, some] += share / sum(shares)
    return found


@settings(max_examples=40)
@given(st.lists(st.lists(st.sampled_from(SIZES), min_size=3, max_size=3), min_size=1, max_size=3), st.booleans())
@example([[1e16, 1e300, 1e16], [1.0, 1e308, 0.5], [1.5, 1.0, 0.5]], True)
@example([[-np.inf, -1.797e308, -np.inf], [-1.797e308, -1e300, 1e300], [-1e300, -0.5, 1.797e308]], False)
@example([[0.0, -1e16, 1.0], [0.0, 1.5, 1e308]], False)
def test_weights_of_all_sizes_together_have_the_marginals_of_exact_fractions(weights, is_bag):
    counts = (2, 1, 1) if is_bag else (1, 1, 1)
    expected = exact_marginals(weights, counts)
    for find in (arrangement_marginals, lambda *given: np.exp(arrangement._sum_over_arrangements(*given))):
        if expected is None:
            with pytest.raises(ImpossibleObservation):
                find(np.array(weights), counts)
        else:
            np.testing.assert_allclose(find(np.array(weights), counts), expected, atol=1e-6)


def test_a_million_shapes_of_objects_that_were_not_touched_are_equally_likely():
    found = arrangement_marginals(np.zeros((2, 10**6)))
    np.testing.assert_allclose([found.min(), found.max()], 1e-6, rtol=1e-9)


def test_one_object_of_many_shapes_has_its_posterior(rng):
    weights, counts = rng.normal(size=(1, 500)), rng.integers(0, 4, 500)
    expected = counts * np.exp(weights[0])
    np.testing.assert_allclose(arrangement_marginals(weights, counts)[0], expected / expected.sum(), rtol=1e-9)
    with pytest.raises(ImpossibleObservation, match="object 0 has zero likelihood for every shape"):
        arrangement_marginals(np.where(counts > 0, -np.inf, weights), counts)


@pytest.mark.parametrize("num_shapes", [20_000, 200_000])
def test_a_sum_that_needs_more_memory_than_there_is_is_refused_at_once(num_shapes):
    weights = np.zeros((2, num_shapes))
    weights[:, 0] = [1.0, 2.0]
    for ask in (log_arrangement_marginals, lambda weights: prob_shape_absent(weights, None, 0)):
        with pytest.raises(ValueError, match=r"2 objects from a bag .* 134217728 numbers\). Use fewer"):
            ask(weights)


@given(log_weights(), st.sampled_from([1e3, 1e6, 1e9, 1e15, 1e300]))
def test_a_contradiction_of_any_size_leaves_the_other_evidence_in_force(weights, contradiction):
    # Every object insists on being of shape 0, so how much it insists cancels: only the rest of what was felt decides.
    def insist(much):
        wide = np.concatenate([np.full((len(weights), 1), much), weights], axis=1)
        return arrangement_marginals(wide)

    assert insist(1e3)[:, 0].sum() == pytest.approx(1.0)
    np.testing.assert_allclose(insist(contradiction), insist(1e3), atol=1e-9)


@pytest.mark.parametrize("shape", [-1, 4, True, 1.0, "cube"])
def test_the_probability_of_lacking_what_is_no_shape_is_refused(shape):
    with pytest.raises(ValueError, match=r"shape must be an integer in \[0, 4\)"):
        prob_shape_absent(np.zeros((2, 4)), None, shape)
