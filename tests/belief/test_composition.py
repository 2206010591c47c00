"""What a bag says about a table before anything is touched, against listing every draw."""

import itertools
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from belief import Composition, Counts, SearchProblem
from belief.errors import UnknownName
from belief.synthetic import sample_arrangement

LABELS = ("cube", "cone", "ball")


def problem(num_objects, composition):
    return SearchProblem(LABELS, ("p",), num_objects, composition)


def every_draw(counts, num_objects):
    """All equally likely ordered draws from the bag, as shapes, ``(draws, N)``."""
    bag = np.repeat(np.arange(len(counts)), counts)
    return bag[np.array(list(itertools.permutations(range(len(bag)), num_objects)))]


counted = st.tuples(*[st.integers(0, 3)] * 3).filter(lambda counts: 0 < sum(counts) <= 6)


@given(counted, st.integers(1, 6))
def test_priors_of_a_bag_equal_the_shares_of_all_draws(counts, num_objects):
    num_objects = min(num_objects, sum(counts))
    search = problem(num_objects, Counts(dict(zip(LABELS, counts, strict=True))))
    draws = every_draw(counts, num_objects)
    for shape in range(3):
        np.testing.assert_allclose(search.prior_probs[shape], (draws[:, -1] == shape).mean(), atol=1e-12)
        absent = (draws != shape).all(axis=1).mean()
        np.testing.assert_allclose(search.prior_absent_probs[shape], absent, atol=1e-12)
        assert (search.prior_absent_probs[shape] == 0.0) == (absent == 0.0)


@pytest.mark.parametrize("num_objects", [1, 2, 3])
def test_one_of_each_is_what_distinct_says(num_objects):
    distinct, bag = problem(num_objects, "distinct"), problem(num_objects, Counts(dict.fromkeys(LABELS, 1)))
    assert distinct.counts == bag.counts == (1, 1, 1)
    assert distinct.prior_absent_probs.tolist() == bag.prior_absent_probs.tolist()
    for seed in range(20):
        tables = [sample_arrangement(p, np.random.default_rng(seed)) for p in (distinct, bag)]
        assert tables[0] == tables[1]


def test_independent_objects_come_from_no_bag():
    search = problem(4, Composition.INDEPENDENT)
    assert search.counts is None
    np.testing.assert_allclose(search.prior_probs, 1 / 3)
    np.testing.assert_allclose(search.prior_absent_probs, (2 / 3) ** 4)


@pytest.mark.parametrize("num_objects", [2, 4])
def test_sampled_tables_are_distributed_as_draws_from_the_bag(num_objects):
    counts = (2, 1, 1)
    search, rng = problem(num_objects, Counts(dict(zip(LABELS, counts, strict=True)))), np.random.default_rng(0)
    draws, frequencies = np.unique(every_draw(counts, num_objects), axis=0, return_counts=True)
    expected = dict(zip(map(tuple, draws.tolist()), frequencies / frequencies.sum(), strict=True))
    seen = dict.fromkeys(expected, 0)
    for _ in range(4000):
        seen[sample_arrangement(search, rng)] += 1
    test = stats.chisquare(list(seen.values()), 4000 * np.array(list(expected.values())))
    assert test.pvalue > 1e-3  # fixed seed; a right sampler would fail one seed in a thousand


def test_counts_are_values():
    bag = Counts({"cube": 2, "cone": np.int64(1)})
    assert bag == Counts({"cone": 1, "cube": 2})
    assert hash(bag) == hash(Counts({"cone": 1, "cube": 2}))
    assert pickle.loads(pickle.dumps(bag)) == bag
    assert repr(bag) == "Counts({'cone': 1, 'cube': 2})"
    assert {problem(3, bag)} == {problem(3, bag)}


@pytest.mark.parametrize(
    "counts",
    [
        {},
        {"cube": 0},
        {"cube": -1, "cone": 2},
        {"cube": 1.5},
        {"cube": float("nan")},
        {"cube": "1"},
        {"cube": 2**60},
        {1: 1, "1": 2},
        {None: 1},
    ],
)
def test_a_bag_that_makes_no_sense_is_refused(counts):
    with pytest.raises(ValueError, match="counts must be"):
        Counts(counts)


def test_a_bag_that_does_not_fit_the_problem_is_refused():
    with pytest.raises(ValueError, match="4 objects cannot come from a bag of 3"):
        problem(4, Counts({"cube": 2, "ball": 1}))
    with pytest.raises(UnknownName, match="Did you mean 'cube'"):
        problem(1, Counts({"cubes": 2}))
