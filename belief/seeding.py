"""Keyed chance: what an episode draws depends on its seed and on what is drawn, not on what was drawn before.

Two deciders that touch the same object of the same episode in the same pose, equally often, therefore feel the same
thing, be it in a search, in an environment or from a recording (decision 0007).

Different keys have different streams. numpy alone does not do that: it writes a key as 32-bit words one after another,
so that 2^32 is the pair (0, 1), and it fills short keys up with zeros, so that (7, 0) is (7,). :func:`keyed_words`
marks what would be ambiguous, and leaves all other keys as they are.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence

import numpy as np

from belief.errors import InvalidArgument

_MARK = 2**32 - 1  # the largest word: before a number that does not fit below it, or at the end of a short key
_POOL = 4  # words that numpy fills shorter keys up to
_TOUCHING, _ARRANGING, _DECIDING = 1, 2, 3  # streams of an episode


def keyed_rng(key: Sequence[int], *, is_fixed_length: bool = False) -> np.random.Generator:
    """The source of chance of a key: different keys, different streams.

    Args:
        key: whole numbers from 0, as large as you like.
        is_fixed_length: whether all keys of this kind have as many numbers. A zero at the end of a short key is then
            not marked; the key is not told apart from keys of another length.

    Raises:
        InvalidArgument: a number that is negative or not whole.

    >>> keyed_rng([7, 1]).random() == np.random.default_rng([7, 1]).random()        # ordinary keys are numpy's
    True
    >>> len({float(keyed_rng(key).random()) for key in ([2**32], [0, 1], [7], [7, 0], [7, 0, 0])})
    5
    """
    return np.random.default_rng(keyed_words(key, is_fixed_length=is_fixed_length))


def keyed_words(key: Sequence[int], *, is_fixed_length: bool = False) -> list[int]:
    """What numpy is given for a key: words below 2^32; arguments and errors as of :func:`keyed_rng`.

    >>> keyed_words([3, 2**32, 5])
    [3, 4294967295, 2, 0, 1, 5]
    >>> keyed_words([3, 0]), keyed_words([3, 0], is_fixed_length=True)
    ([3, 0, 4294967295], [3, 0])
    """
    words: list[int] = []
    for number in checked_key(key):
        if number < _MARK:
            words.append(number)
        else:
            parts = [number >> shift & _MARK for shift in range(0, number.bit_length(), 32)]
            words += [_MARK, len(parts), *parts]
    if not is_fixed_length and 0 < len(words) <= _POOL and words[-1] == 0:
        words.append(_MARK)
    return words


def checked_key(key: Sequence[int]) -> tuple[int, ...]:
    """The key as plain numbers.

    Raises:
        InvalidArgument: a number that is negative or not whole.

    >>> checked_key([3, -1])
    Traceback (most recent call last):
    ...
    belief.errors.InvalidArgument: seeds and keys are whole numbers from 0, got -1 in [3, -1]
    """
    try:
        numbers = tuple(operator.index(number) for number in key)
    except TypeError as error:
        raise InvalidArgument(f"seeds and keys are whole numbers from 0, got {key!r}") from error
    for number in numbers:
        if number < 0:
            raise InvalidArgument(f"seeds and keys are whole numbers from 0, got {number} in {list(numbers)}")
    return numbers


def touch_rng(seed: Sequence[int], object_index: int, pose: int, repeat: int) -> np.random.Generator:
    """Source of chance of one touch: of an object in a pose, for the ``repeat``-th time (from 0).

    >>> touch_rng((7,), 0, 2, 0).random() == touch_rng((7,), 0, 2, 0).random()
    True
    """
    return _of_episode(seed, _TOUCHING, object_index, pose, repeat)


def arrangement_rng(seed: Sequence[int]) -> np.random.Generator:
    """Source of chance of an episode's objects: which shapes lie where, their sizes and orientations.

    >>> int(arrangement_rng((7, 0)).integers(100)) != int(arrangement_rng((7, 1)).integers(100))
    True
    """
    return _of_episode(seed, _ARRANGING)


def deciding_rng(seed: Sequence[int]) -> np.random.Generator:
    """Source of chance of an episode's decider.

    >>> deciding_rng((7,)).random() != arrangement_rng((7,)).random()
    True
    """
    return _of_episode(seed, _DECIDING)


def _of_episode(seed: Sequence[int], *stream: int) -> np.random.Generator:
    """A stream of an episode: for seeds of one to three numbers the lengths of keys tell streams and seeds apart."""
    numbers = checked_key(seed)
    if not numbers:
        raise InvalidArgument("the seed of an episode needs at least one number")
    rest = checked_key(stream)
    if len(numbers) <= 3:
        return keyed_rng([*numbers, *rest])
    return np.random.default_rng([_MARK, 0, *keyed_words([len(numbers), *numbers, *rest])])  # no number has 0 words
