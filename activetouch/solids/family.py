"""Families of solids: one kind of solid, whose proportions differ from object to object.

>>> from activetouch.distributions import Uniform
>>> from activetouch.solids.primitives import Cylinder
>>> rods = Family(Cylinder(radius=0.016, half_length=0.020), half_length=Uniform(0.010, 0.040))
>>> round(rods.sample(np.random.default_rng(0)).half_length, 4)
0.0291
>>> [round(rod.half_length, 3) for rod in rods.members(4)]
[0.014, 0.021, 0.028, 0.036]
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from itertools import product
from numbers import Real
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import (
    Distribution,
    LogUniform,
    Uniform,
    kronecker,
    quantiles,
    require_distribution,
    roberts_steps,
)
from activetouch.solids.solid import Floats, Shape
from belief.errors import InvalidArgument, UnknownName
from belief.validation import MOST_REPEATED, require_count

_RANGE = 0.4, 2.5  # of the factors of other proportions
_MOST_MEMBERS = 64  # among hypotheses


@dataclass(frozen=True, init=False, repr=False)
class Family:
    """A shape whose objects differ in their proportions: parameters of a solid are drawn for each object.

    Attributes:
        nominal: the solid that stands for the family in pictures and tables, a dataclass with numbers as fields.
        parameters: its parameters that differ, each with its distribution, in the order of the solid's fields. They are
            independent, and the size of an object is a further factor on all lengths.

    Raises:
        UnknownName: the solid has no number of that name.
        InvalidArgument: there are no parameters, one is no distribution, the nominal solid is no dataclass with
            numbers, or no solid can be built where parameters are at the ends of their supports.
    """

    nominal: Shape
    parameters: tuple[tuple[str, Distribution], ...]

    def __init__(self, nominal: Shape, /, **parameters: Distribution) -> None:
        known = list(numbers_of(nominal))
        if not known:
            raise InvalidArgument(
                "a family is of a solid that is a dataclass with numbers, such as Cylinder(0.016, 0.020); no field of "
                f"{nominal!r:.80} is a number"
            )
        if not parameters:
            raise InvalidArgument(f"a family of {nominal} needs a parameter, such as {known[0]}=Uniform(0.010, 0.020)")
        for name, given in parameters.items():
            if name not in known:
                raise UnknownName(f"parameter of {type(nominal).__name__}", name, known)
            require_distribution(name, given)
        object.__setattr__(self, "nominal", nominal)
        object.__setattr__(self, "parameters", tuple((name, parameters[name]) for name in known if name in parameters))
        for ends in product(*(given.support for _, given in self.parameters)):
            self._require_solid(ends)

    def __repr__(self) -> str:
        return f"Family({', '.join([repr(self.nominal), *(f'{name}={given}' for name, given in self.parameters)])})"

    def sample(self, rng: np.random.Generator) -> Shape:
        """A random member."""
        return self._member([given.sample(rng) for _, given in self.parameters])

    def members(self, num: int) -> tuple[Shape, ...]:
        """Members that cover the family evenly, ordered by the first parameter.

        Args:
            num: how many, at least 1; all change with it.

        Raises:
            InvalidArgument: ``num`` is no integer ≥ 1.
        """
        require_count("num", num, most=MOST_REPEATED)
        first, others = (np.arange(num) + 0.5) / num, roberts_steps(len(self.parameters) - 1)
        shares = [first, *(kronecker(step, num) for step in others)]
        columns = [quantiles(given, some).tolist() for (_, given), some in zip(self.parameters, shares, strict=True)]
        return tuple(map(self._member, zip(*columns, strict=True)))

    def bodies(self, shares: Floats) -> tuple[tuple[Shape, ...], NDArray[np.int64]]:
        """At most 64 different members for hypotheses at given shares; see :meth:`activetouch.Scene.bodies`."""
        given = [self._hypothetical[place] for place in np.floor(shares * _MOST_MEMBERS).astype(int).tolist()]
        numbers = {member: number for number, member in enumerate(dict.fromkeys(given))}
        return tuple(numbers), np.array([numbers[member] for member in given], np.int64)

    @cached_property
    def _hypothetical(self) -> tuple[Shape, ...]:
        return self.members(_MOST_MEMBERS)

    def _member(self, values: Iterable[float]) -> Shape:
        """The member with these values of its parameters."""
        changes = {name: value for (name, _), value in zip(self.parameters, values, strict=True)}
        return cast(Shape, replace(cast(Any, self.nominal), **changes))

    def _require_solid(self, values: Sequence[float]) -> None:
        """Check that there is a member with these values.

        Raises:
            InvalidArgument: there is none.
        """
        try:
            member = self._member(values)
            hash(member)  # solids are keys of caches
            radius = member.bounding_radius
            reason = "" if 0.0 < radius < np.inf else f"its bounding radius is {radius} m"
        except (TypeError, ValueError) as error:
            reason = str(error)
        if reason:
            place = ", ".join(f"{name}={value}" for (name, _), value in zip(self.parameters, values, strict=True))
            raise InvalidArgument(f"{self} has members that are no solids, at {place}: {reason}")


class Proportions(Family):
    """A solid of other proportions than its nominal ones: from 0.4 to 2.5 times, to reach half and double for sure.

    A factor multiplies its last length, or all of its lengths but the first. What multiplies all of them is the size.

    >>> from activetouch.solids.primitives import Box
    >>> [tuple(round(edge, 1) for edge in box.half_extents) for box in Proportions(Box((1.0, 1.0, 1.0))).members(2)]
    [(1.0, 1.0, 0.6), (1.0, 1.0, 1.6)]

    Raises:
        InvalidArgument: the solid has fewer than two lengths.
    """

    def __init__(self, nominal: Shape, /) -> None:
        if len(_lengths_of(nominal)) < 2:
            raise InvalidArgument(f"{nominal!r:.80} has no proportions: it needs two lengths")
        parameters = (("factor", LogUniform(*_RANGE)), ("part", Uniform(0.0, 1.0)))
        object.__setattr__(self, "nominal", nominal)
        object.__setattr__(self, "parameters", parameters)

    @staticmethod
    def has(solid: object) -> bool:
        """Whether a solid has proportions: at least two lengths, and solids at the ends of the range."""
        if len(_lengths_of(solid)) < 2:
            return False
        try:
            [Proportions(cast(Shape, solid))._member((factor, part)) for factor in _RANGE for part in (0.0, 1.0)]
        except ValueError:
            return False
        return True

    def _member(self, values: Iterable[float]) -> Shape:
        factor, part = values
        lengths = _lengths_of(self.nominal)
        first = 1 if part >= 0.5 else len(lengths) - 1
        scaled = iter([length * (factor if place >= first else 1.0) for place, length in enumerate(lengths)])
        changes = {
            name: tuple(next(scaled) for _ in given) if isinstance(given, tuple) else next(scaled)
            for name, given in _length_fields(self.nominal).items()
        }
        return cast(Shape, replace(cast(Any, self.nominal), **changes))


def _length_fields(solid: object) -> dict[str, float | tuple[float, ...]]:
    """The fields of a dataclass that are lengths, or tuples of lengths."""
    if not is_dataclass(solid) or isinstance(solid, type):
        return {}
    found = {field.name: getattr(solid, field.name) for field in fields(solid) if field.init}
    return {
        name: given
        for name, given in found.items()
        if isinstance(given, float) or (isinstance(given, tuple) and all(isinstance(part, float) for part in given))
    }


def _lengths_of(solid: object) -> list[float]:
    return np.hstack([np.zeros(0), *_length_fields(solid).values()]).tolist()


def numbers_of(solid: object) -> dict[str, float]:
    """The fields of a dataclass that are numbers, by name; none of anything else.

    >>> from activetouch.solids.primitives import Cylinder
    >>> numbers_of(Cylinder(radius=0.016, half_length=0.020))
    {'radius': 0.016, 'half_length': 0.02}
    """
    if not is_dataclass(solid) or isinstance(solid, type):
        return {}
    given = {field.name: getattr(solid, field.name) for field in fields(solid) if field.init}
    return {
        name: float(value) for name, value in given.items() if isinstance(value, Real) and not isinstance(value, bool)
    }
