"""Opinions about objects before they are touched: probabilities of shapes from a camera, or from anybody.

An opinion is evidence whose quality nobody knows. It is therefore tempered: if its odds are wrong by a factor of 20,
what is stated after it is wrong by a factor of at most 5, the ratio of the odds of 0.99, where searches stop, and 0.95.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from belief.columns import read_columns
from belief.errors import ActiveTouchError, InvalidArgument
from belief.files import plain_number
from belief.naming import index_of
from belief.validation import SUM_TOLERANCE, Floats, normalise_probs, require_number

WRONG_BY = 20.0
"""Factor by which the odds of an opinion may be wrong."""
_ALLOWED = (0.99 / 0.01) / (0.95 / 0.05)  # by which the odds of an answer may be wrong
_FLOOR = 0.01  # share of equal probabilities: nothing is ruled out by an opinion


class BadOpinion(ActiveTouchError, ValueError):
    """An opinion about objects cannot be read."""


def tempered(opinion: ArrayLike, wrong_by: float = WRONG_BY) -> Floats:
    """An opinion ``(..., K)`` that may be wrong: its odds are raised to a power, so that little is lost if they are.

    Args:
        opinion: probabilities of the shapes, of each object.
        wrong_by: factor by which its odds may be wrong; up to 5.2 it is taken as it is.

    Raises:
        ValueError: no probabilities, or a factor below 1.

    >>> tempered([0.95, 0.05]).round(3).tolist(), tempered([1.0, 0.0]).round(3).tolist()
    ([0.828, 0.172], [0.949, 0.051])
    """
    require_number("wrong_by", wrong_by, 1.0, np.inf)
    probs = normalise_probs(opinion, "opinion")
    power = min(1.0, np.log(_ALLOWED) / np.log(wrong_by)) if wrong_by > 1.0 else 1.0
    raised = ((1.0 - _FLOOR) * probs + _FLOOR / probs.shape[-1]) ** power
    return np.asarray(raised / raised.sum(axis=-1, keepdims=True))


def opinion_of(probs: Mapping[str, float], labels: Sequence[str]) -> Floats:
    """Probabilities of all shapes ``(K,)`` from those of some, which leave the rest to the others in equal parts.

    >>> opinion_of({"mug": 0.7}, ("mug", "bowl", "cup")).round(2).tolist()
    [0.7, 0.15, 0.15]
    """
    found = np.full(len(labels), np.nan)
    for label, prob in probs.items():
        require_number(f"the probability of {label}", prob, 0.0, 1.0)
        found[index_of("shape", tuple(labels), label)] = prob
    rest, others = 1.0 - np.nansum(found), np.isnan(found)
    if rest < -SUM_TOLERANCE or (not others.any() and rest > SUM_TOLERANCE):
        raise BadOpinion(
            f"the probabilities of an object must have the sum 1, or less where shapes are left out: {probs}"
        )
    return np.where(others, max(rest, 0.0) / max(others.sum(), 1), found)


def read_opinion(text: str, labels: Sequence[str], num_objects: int) -> Floats:
    """Probabilities of shapes ``(N, K)`` from words such as "mug=.7,bowl=.3", or from a CSV file.

    Args:
        text: words for all objects; or the path of a file with the columns shape and prob, and object, from 1, where
            objects differ. Objects that it does not name may have any shape.
        labels: names of the K shapes.
        num_objects: N.

    Raises:
        BadOpinion: the text is neither, or names an object that is not there.
        UnknownName: there is no shape of a name.

    >>> read_opinion("mug=.7,bowl=.3", ("mug", "bowl"), 2).tolist()
    [[0.7, 0.3], [0.7, 0.3]]
    """
    path = Path(text)
    if "=" in text and not _is_there(path):
        one = dict[str, float]()
        for name, _, value in (pair.partition("=") for pair in text.split(",")):
            _say(one, name.strip(), value, text)
        return np.tile(opinion_of(one, labels), (num_objects, 1))
    if not _is_there(path) or not path.is_file():
        raise BadOpinion(f"an opinion is shape=probability, separated by commas, or a CSV file; got {text!r:.80}")
    names = ("shape", "prob", "object")
    table = read_columns([path], names, BadOpinion, needed=("shape", "prob")).arrays
    blank = np.full(len(table["shape"]), "")
    found = np.full((num_objects, len(labels)), 1.0 / len(labels))
    every: dict[str, dict[str, float]] = {}
    for name, shape, prob in zip(*(table.get(one, blank).tolist() for one in ("object", "shape", "prob")), strict=True):
        _say(every.setdefault(name, {}), shape, prob, f"{path}, object {name or 'any'}")
    numbers = {str(number): number - 1 for number in range(1, num_objects + 1)}
    for name, probs in sorted(every.items()):  # "" is first: it is about objects that have no rows of their own
        if name and name not in numbers:
            raise BadOpinion(f"{path} names the object {name!r:.40}; objects are 1 to {num_objects}")
        found[numbers[name] if name else slice(None)] = opinion_of(probs, labels)
    return found


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a text that is too long for a name
        return False


def _say(probs: dict[str, float], shape: str, text: str, where: str) -> None:
    """Add the probability of a shape, which is said once."""
    if shape in probs:
        raise BadOpinion(f"the shape {shape!r:.40} is named twice: {where:.80}")
    try:
        probs[shape] = plain_number(text)
    except ValueError:
        raise BadOpinion(f"a probability is a number, got {text!r:.40}") from None


def as_opinion(opinion: ArrayLike, num_objects: int, num_shapes: int) -> Floats:
    """Probabilities ``(N, K)``, checked; one row is for all objects."""
    found = normalise_probs(opinion, "opinion")
    if found.shape not in ((num_shapes,), (num_objects, num_shapes)):
        raise InvalidArgument(f"an opinion must be ({num_objects}, {num_shapes}) or ({num_shapes},), got {found.shape}")
    return np.array(np.broadcast_to(found, (num_objects, num_shapes)))
