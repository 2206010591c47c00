"""Keys of chance: different keys, different streams; ordinary keys have numpy's."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belief import ActiveTouchError
from belief.errors import InvalidArgument
from belief.seeding import arrangement_rng, deciding_rng, keyed_rng, keyed_words, touch_rng

# Numbers at which one word ends and the next begins, so that collisions are likely among few of them.
NUMBERS = (0, 1, 2, 3, 4, 7, 2**32 - 2, 2**32 - 1, 2**32, 2**32 + 1, 2**33, 2**64 - 1, 2**64, 2**96)
numbers = st.sampled_from(NUMBERS) | st.integers(0, 2**70)
keys = st.lists(numbers, max_size=6).map(tuple)


def padded(words):
    """What numpy mixes: a key of fewer than four words is filled up with zeros."""
    return tuple(words) + (0,) * (4 - len(words))


def state(rng):
    return str(rng.bit_generator.state)


def test_no_two_keys_have_the_same_words():
    short = [key for length in range(4) for key in itertools.product(NUMBERS, repeat=length)]
    assert len({padded(keyed_words(key)) for key in short}) == len(short)


@given(keys, keys)
def test_keys_that_differ_have_words_that_differ(first, second):
    assert (padded(keyed_words(first)) == padded(keyed_words(second))) == (first == second)
    assert all(0 <= word < 2**32 for word in keyed_words(first))


@given(keys)
def test_a_key_and_itself_with_a_zero_more_differ(key):
    assert padded(keyed_words(key)) != padded(keyed_words((*key, 0)))


@pytest.mark.parametrize(("first", "second"), [([2**32], [0, 1]), ([7], [7, 0]), ([], [0]), ([2**32, 5], [0, 1, 5])])
def test_what_numpy_takes_for_one_key_are_two_streams(first, second):
    assert state(np.random.default_rng(first)) == state(np.random.default_rng(second))
    assert state(keyed_rng(first)) != state(keyed_rng(second))


@given(st.lists(st.integers(0, 2**32 - 2), max_size=6), st.integers(1, 2**32 - 2))
def test_ordinary_keys_have_the_streams_of_numpy(some, last):
    assert state(keyed_rng([*some, last])) == state(np.random.default_rng([*some, last]))
    assert state(keyed_rng([*some, 0], is_fixed_length=True)) == state(np.random.default_rng([*some, 0]))


@given(st.lists(st.integers(0, 2**32 - 2), min_size=1, max_size=3), st.integers(0, 99), st.integers(0, 99))
def test_ordinary_episodes_have_the_streams_they_always_had(seed, pose, repeat):
    assert state(touch_rng(seed, 1, pose, repeat)) == state(np.random.default_rng([*seed, 1, 1, pose, repeat]))
    assert state(arrangement_rng(seed)) == state(np.random.default_rng([*seed, 2]))
    assert state(deciding_rng(seed)) == state(np.random.default_rng([*seed, 3]))


def test_no_two_draws_of_any_two_episodes_share_a_stream():
    seeds = [seed for length in (1, 2, 3, 4, 5) for seed in itertools.product((0, 1, 2, 2**32), repeat=length)]
    streams = [rng for seed in seeds for rng in (arrangement_rng(seed), deciding_rng(seed))]
    streams += [touch_rng(seed, o, p, r) for seed in seeds[:84] for o, p, r in itertools.product((0, 2), repeat=3)]
    assert len({state(rng) for rng in streams}) == len(streams)


@pytest.mark.parametrize("seed", [(-1,), (0.5,), (1.0,), ("7",), (None,), (float("nan"),), (), "7", None])
@pytest.mark.parametrize("make", [arrangement_rng, deciding_rng, lambda seed: touch_rng(seed, 0, 0, 0)])
def test_a_seed_that_is_none_is_refused(make, seed):
    with pytest.raises(ActiveTouchError, match="seed"):
        make(seed)


def test_a_single_number_is_a_key_of_one():
    for rng in (keyed_rng, arrangement_rng, deciding_rng, lambda seed: touch_rng(seed, 1, 2, 0)):
        for number in (0, 7, np.int64(7), 2**40):
            assert rng(number).random() == rng((number,)).random() == rng([number]).random()
        for wrong in (-1, 1.5, "7", None, True):
            with pytest.raises(InvalidArgument, match="integers"):
                rng(wrong)
