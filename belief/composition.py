"""Compositions: prior knowledge about the shapes of the objects on the table."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from belief.constraints import MOST_COUNT
from belief.errors import InvalidArgument, UnknownName
from belief.naming import shown


class Composition(StrEnum):
    """How the shapes of the objects depend on each other.

    ``DISTINCT``: no two objects have the same shape; all such arrangements are equally likely.
    ``INDEPENDENT``: every object's shape is drawn from the prior independently.
    ``AT_MOST_ONE``: one object has the target's shape, or none (:class:`AtMostOne`); for many shapes.

    >>> Composition("distinct") is Composition.DISTINCT
    True
    """

    DISTINCT = "distinct"
    INDEPENDENT = "independent"
    AT_MOST_ONE = "at_most_one"


@dataclass(frozen=True)
class AtMostOne:
    """Objects of which at most one has the shape ``label``: it is as probable at each place as it is to be absent.

    The others have any other shapes, which are equally probable and independent. A problem with ``AT_MOST_ONE`` becomes
    one with this composition once its target is known (:meth:`belief.SearchProblem.seeking`).
    """

    label: str


@dataclass(frozen=True, init=False, repr=False)
class Counts:
    """A bag with a known number of objects of each shape, from which the table is drawn without replacement.

    One object of each shape is equivalent to ``DISTINCT``.

    Args:
        counts: number of objects of each shape, at least zero; missing shapes count zero.

    Attributes:
        items: shapes and their counts, sorted by name.

    Raises:
        ValueError: a label that is not a string, a count that is not an integer or out of range, or an empty bag.

    >>> bag = Counts({"cube": 2, "cone": 1})
    >>> bag.total, bag.of(["sphere", "cube", "cone"])
    (3, (0, 2, 1))
    """

    items: tuple[tuple[str, int], ...]

    def __init__(self, counts: Mapping[str, int]) -> None:
        if not all(isinstance(label, str) for label in counts):
            raise InvalidArgument(f"counts must be given by names of shapes, got {dict(counts)}")
        try:
            items = tuple(sorted((str(label), operator.index(count)) for label, count in counts.items()))
        except TypeError as error:
            raise ValueError(f"counts must be integers, got {dict(counts)}") from error
        if not all(0 <= count <= MOST_COUNT for _, count in items) or not any(count for _, count in items):
            raise ValueError(f"counts must be in [0, 2^53], and at least one above zero, got {shown(dict(counts))}")
        object.__setattr__(self, "items", items)

    @property
    def total(self) -> int:
        """Objects in the bag."""
        return sum(count for _, count in self.items)

    def of(self, labels: Sequence[str]) -> tuple[int, ...]:
        """Counts in the order of these labels.

        Raises:
            UnknownName: the bag holds a shape that is not among them.
        """
        counts = dict(self.items)
        for label in counts:
            if label not in labels:
                raise UnknownName("shape", label, list(labels))
        return tuple(counts.get(label, 0) for label in labels)

    def __repr__(self) -> str:
        return f"Counts({dict(self.items)})"
