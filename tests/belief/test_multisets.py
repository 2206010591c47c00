"""Numbered multisets against listing them all."""

import itertools
import math

import numpy as np
import pytest

from belief.arrangement import layers, num_multisets

bags = pytest.mark.parametrize("counts", [(1, 1, 1, 1), (3,), (2, 0, 1), (0, 2, 2, 1), (5, 1), (300, 2)])


def every_multiset(counts, size):
    capped = [range(min(count, size) + 1) for count in counts]
    return sorted(used for used in itertools.product(*capped) if sum(used) == size)


@bags
def test_every_multiset_is_listed_once_by_its_size(counts):
    for size, layer in enumerate(layers(counts, min(sum(counts), 6))):
        assert sorted(map(tuple, layer.used.T.tolist())) == every_multiset(counts, size)


@bags
def test_one_more_and_one_less_lead_to_the_multisets_they_say(counts):
    table = layers(counts, min(sum(counts), 6))
    for here, after in itertools.pairwise(table):
        for number, used in enumerate(here.used.T.astype(int)):
            for shape in range(len(counts)):
                more = here.bigger[shape, number]
                if used[shape] == counts[shape]:
                    assert more == here.num_bigger == after.used.shape[1]  # one past the end
                else:
                    assert (after.used[:, more] - used == np.eye(len(counts), dtype=int)[shape]).all()
                    assert after.smaller[shape, more] == number
        assert (after.smaller[after.used == 0] == here.used.shape[1]).all()


@bags
def test_draws_are_counted_as_permutations_of_objects_that_can_be_told_apart(counts):
    for layer in layers(counts, min(sum(counts), 6)):
        expected = [math.prod(math.perm(c, int(u)) for c, u in zip(counts, used, strict=True)) for used in layer.used.T]
        np.testing.assert_allclose(np.exp(layer.log_draws), expected, rtol=1e-12)


@bags
def test_multisets_are_counted_without_listing_them(counts):
    for most in range(5):
        listed = sum(len(every_multiset(counts, size)) for size in range(most + 1))
        assert num_multisets(counts, most, limit=10**6) == listed


def test_a_count_beyond_the_limit_is_not_counted_out():
    assert num_multisets((1,) * 500, 250, limit=1000) > 1000
    assert num_multisets((1,) * 20, 20, limit=2**20) == 2**20


@pytest.mark.parametrize("num_shapes", [63, 64, 65, 128, 300])
def test_a_count_beyond_every_integer_is_beyond_the_limit(num_shapes):
    assert num_multisets((1,) * num_shapes, num_shapes, limit=2**20) > 2**20
    assert num_multisets((2**40,) * num_shapes, num_shapes, limit=2**20) > 2**20


def test_many_alike_objects_need_no_deep_recursion():
    assert layers((1500, 1500), 1200)[-1].used.shape == (2, 1201)
