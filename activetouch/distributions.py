"""Probability distributions, and the nuisances of objects and presses that have them.

>>> import numpy as np
>>> round(Uniform(1.5, 3.0).sample(np.random.default_rng(0)), 4)
2.4554
>>> Constant(2.0).sample(np.random.default_rng(0))     # does not use the generator
2.0
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from belief.constraints import Checked, Finite, Positive, check
from belief.errors import InvalidArgument


class Distribution(Protocol):
    """The distribution of a real random number."""

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest possible value."""

    def sample(self, rng: np.random.Generator) -> float:
        """Draw one number."""


@dataclass(frozen=True)
class Constant(Checked):
    """The distribution of a constant; it does not use the generator."""

    value: Finite

    @property
    def support(self) -> tuple[float, float]:
        """See :class:`Distribution`."""
        return self.value, self.value

    def sample(self, rng: np.random.Generator) -> float:
        """See :class:`Distribution`."""
        return self.value


@dataclass(frozen=True)
class _Range:
    low: Finite
    high: Finite

    def __post_init__(self) -> None:
        check(self)
        if self.low > self.high:
            raise ValueError(f"low must not exceed high, got {self}")

    @property
    def support(self) -> tuple[float, float]:
        """See :class:`Distribution`."""
        return self.low, self.high


@dataclass(frozen=True)
class Uniform(_Range):
    """The uniform distribution between ``low`` and ``high``."""

    def sample(self, rng: np.random.Generator) -> float:
        """See :class:`Distribution`."""
        return float(rng.uniform(self.low, self.high))


@dataclass(frozen=True)
class LogUniform(_Range):
    """The log-uniform distribution between ``low`` and ``high``, both positive."""

    low: Positive

    def sample(self, rng: np.random.Generator) -> float:
        """See :class:`Distribution`."""
        return float(np.exp(rng.uniform(np.log(self.low), np.log(self.high))))


def require_distribution(name: str, given: object) -> None:
    """Check that an object is a distribution; the error message calls it ``name``."""
    if isinstance(given, type) or not callable(getattr(given, "sample", None)):
        raise InvalidArgument(
            f"{name} must be a distribution such as Uniform(0.9, 1.1) or Constant(1.0), got {given!r}"
        )


@dataclass(frozen=True)
class Variation:
    """What differs from object to object (size, friction, stiffness) and from press to press (offset, force).

    Attributes:
        size: factor on the nominal size of every object, built-in or mesh; ``Constant(1.0)`` for one of known size.
        offset: displacement of an object's centre from the approach axis, along y and along z [m].
        force: force at which the motion stops [N].
        friction: coefficient between an object and the pad.
        stiffness: stiffness of the pad's layer together with an object's skin, relative to the pad's alone.

    Raises:
        InvalidArgument: one of them is not a distribution.
    """

    size: Distribution = field(default_factory=lambda: Uniform(0.9, 1.1))
    offset: Distribution = field(default_factory=lambda: Uniform(-0.002, 0.002))
    force: Distribution = field(default_factory=lambda: Uniform(1.5, 3.0))
    friction: Distribution = field(default_factory=lambda: Constant(1.0))
    stiffness: Distribution = field(default_factory=lambda: Constant(1.0))

    def __post_init__(self) -> None:
        for part in fields(self):
            require_distribution(part.name, getattr(self, part.name))

    def sample_offset(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Displacement of one press, along y and along z [m], ``(2,)``."""
        return np.array([self.offset.sample(rng) for _ in range(2)])
