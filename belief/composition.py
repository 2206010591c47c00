"""Compositions: prior knowledge about which shapes are on the table."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from belief.errors import UnknownName

_MOST = 2**53  # all whole numbers up to here are floats


class Composition(StrEnum):
    """How the shapes of objects depend on each other, where no numbers are needed to say it.

    ``DISTINCT``: no two objects have the same shape, all such arrangements equally likely.
    ``INDEPENDENT``: every object's shape is drawn from the prior on its own.

    >>> Composition("distinct") is Composition.DISTINCT
    True
    """

    DISTINCT = "distinct"
    INDEPENDENT = "independent"


@dataclass(frozen=True, init=False, repr=False)
class Counts:
    """A bag that holds a known number of objects of each shape; those on the table were drawn from it blindly.

    With as many objects on the table as in the bag, the table holds exactly these shapes. With fewer, some stayed in
    the bag, and any object was as likely to be drawn as any other. One of each shape is what ``DISTINCT`` says.

    Args:
        counts: how many objects there are of each shape, at least zero; shapes left out count zero.

    Attributes:
        items: shapes and their counts, sorted by name.

    Raises:
        ValueError: a count that is no whole number or out of range, or an empty bag.

    >>> bag = Counts({"cube": 2, "cone": 1})
    >>> bag.total, bag.of(["sphere", "cube", "cone"])
    (3, (0, 2, 1))
    """

    items: tuple[tuple[str, int], ...]

    def __init__(self, counts: Mapping[str, int]) -> None:
        try:
            items = tuple(sorted((str(label), operator.index(count)) for label, count in counts.items()))
        except TypeError as error:
            raise ValueError(f"counts must be whole numbers, got {dict(counts)}") from error
        if not all(0 <= count <= _MOST for _, count in items) or not any(count for _, count in items):
            raise ValueError(f"counts must be in [0, 2^53], and one of them above zero, got {dict(counts)}")
        object.__setattr__(self, "items", items)

    @property
    def total(self) -> int:
        """Objects in the bag."""
        return sum(count for _, count in self.items)

    def of(self, labels: Sequence[str]) -> tuple[int, ...]:
        """Counts in the order of these labels.

        Raises:
            UnknownName: the bag holds a shape that is none of them.
        """
        counts = dict(self.items)
        for label in counts:
            if label not in labels:
                raise UnknownName("shape", label, list(labels))
        return tuple(counts.get(label, 0) for label in labels)

    def __repr__(self) -> str:
        return f"Counts({dict(self.items)})"
