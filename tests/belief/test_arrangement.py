"""Exact marginals against enumeration of every arrangement."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from belief import ImpossibleObservation
from belief.arrangement import arrangement_marginals


def enumerate_marginals(weights: np.ndarray) -> np.ndarray:
    """Sum over all injective maps from objects to shapes."""
    num_objects, num_shapes = weights.shape
    totals = np.zeros_like(weights)
    for shapes in itertools.permutations(range(num_shapes), num_objects):
        weight = math.prod(weights[i, k] for i, k in enumerate(shapes))
        totals[np.arange(num_objects), shapes] += weight
    return totals / totals.sum(axis=1, keepdims=True)


@st.composite
def log_weights(draw):
    num_shapes = draw(st.integers(1, 5))
    num_objects = draw(st.integers(1, num_shapes))
    return draw(arrays(np.float64, (num_objects, num_shapes), elements=st.floats(-20, 20)))


@given(log_weights())
def test_marginals_equal_enumeration(weights):
    np.testing.assert_allclose(arrangement_marginals(weights), enumerate_marginals(np.exp(weights)), atol=1e-12)


def test_marginals_equal_enumeration_where_some_shapes_are_ruled_out():
    likelihoods = np.array([[0.0, 0.5, 0.5, 0.2], [0.7, 0.0, 0.3, 0.1], [0.1, 0.2, 0.0, 0.9]])
    with np.errstate(divide="ignore"):
        marginals = arrangement_marginals(np.log(likelihoods))
    np.testing.assert_allclose(marginals, enumerate_marginals(likelihoods), atol=1e-15)


@given(log_weights(), st.randoms(use_true_random=False))
def test_renaming_shapes_and_reordering_objects_permutes_the_marginals(weights, random):
    rows, columns = list(range(weights.shape[0])), list(range(weights.shape[1]))
    random.shuffle(rows)
    random.shuffle(columns)
    permuted = arrangement_marginals(weights[rows][:, columns])
    np.testing.assert_allclose(permuted, arrangement_marginals(weights)[rows][:, columns], atol=1e-12)


@given(log_weights(), st.floats(-1e3, 1e3))
def test_a_constant_added_to_a_row_changes_nothing(weights, constant):
    shifted = weights.copy()
    shifted[0] += constant
    np.testing.assert_allclose(arrangement_marginals(shifted), arrangement_marginals(weights), atol=1e-9)


def test_untouched_objects_are_uniform():
    np.testing.assert_allclose(arrangement_marginals(np.zeros((3, 5))), 0.2)


def test_twelve_objects_use_every_shape_exactly_once(rng):
    marginals = arrangement_marginals(rng.normal(size=(12, 12)) * 3)
    np.testing.assert_allclose(marginals.sum(axis=0), 1.0, atol=1e-12)
    np.testing.assert_allclose(marginals.sum(axis=1), 1.0, atol=1e-12)


def test_certainty_about_all_but_one_object_decides_the_last():
    weights = np.zeros((4, 4))
    weights[[0, 1, 2], [2, 0, 3]] = 1e4
    np.testing.assert_allclose(arrangement_marginals(weights)[3], [0, 1, 0, 0], atol=1e-300)


def test_two_objects_that_can_only_be_the_same_shape_are_impossible():
    weights = np.array([[0.0, -np.inf], [0.0, -np.inf]])
    with pytest.raises(ImpossibleObservation, match="only be the same shape"):
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
        (np.zeros((2, 21)), "above the limit of 20"),
        (np.zeros((0, 3)), "at least one object"),
        (np.array([[0.0, 1.0], [np.nan, 0.0]]), "row 1 hold NaN"),
    ],
)
def test_bad_input_raises_and_says_why(weights, message):
    with pytest.raises(ValueError, match=message):
        arrangement_marginals(weights)
