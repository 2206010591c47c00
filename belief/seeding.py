"""Random generators keyed by seed and purpose, independent of the order in which they are used (decision 0007).

Two deciders that touch the same object of an episode in the same pose for the n-th time get the same touch.

Different keys have different streams. numpy's ``default_rng`` does not ensure that: it concatenates numbers as 32-bit
words, so 2^32 equals the pair (0, 1), and it pads short keys with zeros, so (7, 0) equals (7,). :func:`keyed_words`
marks the ambiguous keys and leaves all others unchanged.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Sequence

import numpy as np

from belief.composition import AtMostOne, Composition
from belief.errors import InvalidArgument
from belief.naming import UNLISTED, Name
from belief.problem import SearchProblem

_MARK = 2**32 - 1  # the largest word: before a number that does not fit below it, or at the end of a short key
_POOL = 4  # words to which numpy pads shorter keys
_TOUCHING, _ARRANGING, _DECIDING = 1, 2, 3  # streams of an episode


def keyed_rng(key: int | Sequence[int], *, is_fixed_length: bool = False) -> np.random.Generator:
    """The generator of a key, of one or several integers ≥ 0 of any size; different keys have different streams.

    ``is_fixed_length`` says that all keys of this kind have one length; a final zero of a short key is then not marked.
    """
    return np.random.default_rng(keyed_words(key, is_fixed_length=is_fixed_length))


def keyed_words(key: int | Sequence[int], *, is_fixed_length: bool = False) -> list[int]:
    """The words below 2^32 that seed numpy for a key; see :func:`keyed_rng`."""
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


def checked_key(key: int | Sequence[int]) -> tuple[int, ...]:
    """A key, or a single number, as a tuple of Python integers; raises InvalidArgument unless all are integers ≥ 0."""
    try:
        numbers = tuple(operator.index(number) for number in (key if isinstance(key, Iterable) else [key]))
        if isinstance(key, str | bool) or any(isinstance(number, bool) for number in numbers):
            raise TypeError("no numbers")
    except TypeError as error:
        raise InvalidArgument(f"seeds and keys must be integers ≥ 0, got {key!r}") from error
    for number in numbers:
        if number < 0:
            raise InvalidArgument(f"seeds and keys must be integers ≥ 0, got {number} in {list(numbers)}")
    return numbers


def touch_rng(seed: int | Sequence[int], object_index: int, pose: int, repeat: int) -> np.random.Generator:
    """Generator of one touch of an object in a pose, for the ``repeat``-th time (from 0)."""
    return _of_episode(seed, _TOUCHING, object_index, pose, repeat)


def arrangement_rng(seed: int | Sequence[int]) -> np.random.Generator:
    """Generator of an episode's objects: their shapes, sizes and orientations."""
    return _of_episode(seed, _ARRANGING)


def sample_arrangement(problem: SearchProblem, rng: np.random.Generator, target: Name | None = None) -> tuple[int, ...]:
    """True shapes of all objects, drawn from the problem's composition; with at most one target, of that target.

    Where shapes may be unlisted, :data:`belief.naming.UNLISTED` (-2) stands for an object of such a shape.

    >>> from belief import Counts
    >>> bag = Counts({"cube": 2, "cone": 1})
    >>> problem = SearchProblem(("cube", "cone", "sphere"), ("front",), num_objects=3, composition=bag)
    >>> sample_arrangement(problem, np.random.default_rng(0))
    (1, 0, 0)
    """
    problem = problem if target is None else problem.seeking(target)
    if isinstance(problem.composition, AtMostOne):
        target = problem.shape_labels.index(problem.composition.label)
        others = rng.permutation(np.delete(np.arange(problem.num_shapes), target))
        shapes = np.resize(others, problem.num_objects + 1)  # different ones where there are enough
        shapes[rng.integers(problem.num_objects + 1)] = target
        shapes = shapes[: problem.num_objects]
    elif problem.composition is Composition.AT_MOST_ONE:
        raise InvalidArgument("at most one object has the target's shape, and no target is known: problem.seeking(it)")
    elif problem.counts is None:
        shapes = rng.integers(problem.num_shapes, size=problem.num_objects)
    else:
        bag = np.repeat(np.arange(problem.num_shapes), problem.counts)
        shapes = rng.permutation(bag)[: problem.num_objects]
    if problem.unlisted:
        shapes = np.where(rng.random(problem.num_objects) < problem.unlisted, UNLISTED, shapes)
    return tuple(int(shape) for shape in shapes)


def deciding_rng(seed: int | Sequence[int]) -> np.random.Generator:
    """Generator of an episode's decider."""
    return _of_episode(seed, _DECIDING)


def _of_episode(seed: int | Sequence[int], *stream: int) -> np.random.Generator:
    """A stream of an episode; for seeds of one to three numbers the length of the key separates streams and seeds."""
    numbers = checked_key(seed)
    if not numbers:
        raise InvalidArgument("the seed of an episode needs at least one number")
    rest = checked_key(stream)
    if len(numbers) <= 3:
        return keyed_rng([*numbers, *rest])
    return np.random.default_rng([_MARK, 0, *keyed_words([len(numbers), *numbers, *rest])])  # no number has 0 words
