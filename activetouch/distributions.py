"""Probability distributions, the nuisances that have them, and evenly spread hypotheses about a body.

>>> import numpy as np
>>> round(Uniform(1.5, 3.0).sample(np.random.default_rng(0)), 4)
2.4554
>>> Constant(2.0).sample(np.random.default_rng(0))     # does not use the generator
2.0
>>> cover = quaternions(1000)
>>> bool(np.allclose(cover.T @ cover / 1000, np.eye(4) / 4, atol=0.01))        # as uniform orientations have it
True
>>> sizes(Uniform(0.9, 1.1), 4).round(2).tolist()
[1.0, 0.92, 1.05, 0.97]
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, Protocol

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


def require_support(name: str, given: Any, least: float, most: float, unit: str = "") -> None:
    """Check that an object is a distribution of numbers that make sense; those in another unit make none."""
    require_distribution(name, given)
    low, high = given.support
    if not least <= low <= high <= most:
        raise InvalidArgument(f"{name} must lie in [{least:g}, {most:g}]{unit}, got {low:g} to {high:g}")


_LIMITS: dict[str, tuple[float, float, str]] = {
    "size": (1e-3, 1e3, ""),
    "offset": (-0.1, 0.1, " m"),
    "force": (0.0, 1e3, " N"),
    "friction": (0.0, 1e2, ""),
    "stiffness": (1e-6, 1e6, ""),
}


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
        InvalidArgument: one of them is not a distribution, or goes beyond what makes sense, as in another unit.
    """

    size: Distribution = field(default_factory=lambda: Uniform(0.9, 1.1))
    offset: Distribution = field(default_factory=lambda: Uniform(-0.002, 0.002))
    force: Distribution = field(default_factory=lambda: Uniform(1.5, 3.0))
    friction: Distribution = field(default_factory=lambda: Constant(1.0))
    stiffness: Distribution = field(default_factory=lambda: Constant(1.0))

    def __post_init__(self) -> None:
        for part in fields(self):
            require_support(part.name, getattr(self, part.name), *_LIMITS[part.name])

    def sample_offset(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Displacement of one press, along y and along z [m], ``(2,)``."""
        return np.array([self.offset.sample(rng) for _ in range(2)])


Floats = NDArray[np.float64]

_PHI = np.sqrt(2.0)
_PSI = 1.533751168755204288118041  # the root of ψ⁴ = ψ + 4 (Alexa 2022)
_DRAWN = 4096  # numbers that stand for a distribution
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
_PLASTIC_ROOT = 0.7548776662466927  # 1 / ρ with ρ³ = ρ + 1


def quaternions(num: int) -> Floats:
    """Unit quaternions ``wxyz`` that cover all orientations evenly, ``(num, 4)``; all change with ``num``.

    M. Alexa: Super-Fibonacci Spirals: Fast, Low-Discrepancy Sampling of SO(3). CVPR 2022.
    """
    if num < 1:
        raise ValueError(f"num must be at least 1, got {num}")
    place = np.arange(num) + 0.5
    inner, outer = np.sqrt(place / num), np.sqrt(1.0 - place / num)
    alpha, beta = 2.0 * np.pi * place / _PHI, 2.0 * np.pi * place / _PSI
    return np.stack([inner * np.sin(alpha), inner * np.cos(alpha), outer * np.sin(beta), outer * np.cos(beta)], axis=1)


def sizes(distribution: Distribution, num: int) -> Floats:
    """Sizes that cover a distribution evenly, ``(num,)``: quantiles at multiples of the golden ratio, modulo 1."""
    return quantiles(distribution, kronecker(GOLDEN, num))


def member_shares(num: int) -> Floats:
    """Places of hypotheses in a family of solids, whatever its shape, ``(num,)``, above 0 and below 1.

    They are evenly spread, and independent of :func:`sizes`. :meth:`activetouch.Scene.bodies` gives their solids.

    >>> member_shares(4).tolist()
    [0.625, 0.375, 0.125, 0.875]
    """
    return np.asarray((np.argsort(np.argsort(kronecker(_PLASTIC_ROOT, num))) + 0.5) / num)


def kronecker(step: float, num: int) -> Floats:
    """Numbers that cover [0, 1) evenly, ``(num,)``: multiples of a step, modulo 1; the first is 0.5."""
    return np.asarray((0.5 + step * np.arange(num)) % 1.0)


def roberts_steps(num: int) -> list[float]:
    """Steps of ``num`` sequences of :func:`kronecker` that together fill a box evenly (Roberts 2018).

    >>> np.round(roberts_steps(2), 4).tolist()
    [0.7549, 0.5698]
    """
    root = 1.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (num + 1.0))
    return [root**-power for power in range(1, num + 1)]


def quantiles(distribution: Distribution, shares: Floats) -> Floats:
    """Approximate quantiles of a distribution at ``shares (n,)`` in [0, 1], ``(n,)``."""
    rng = np.random.default_rng(0)
    return np.asarray(np.quantile([distribution.sample(rng) for _ in range(_DRAWN)], shares))


class Bodies(NamedTuple):
    """N hypotheses about an object of any shape.

    ``rests (N, 4)`` are orientations at rest, unit quaternions ``wxyz``; ``sizes (N,)`` are relative to the nominal
    size; ``shares (N,)`` are places in a family of solids (:func:`member_shares`).
    """

    rests: Floats
    sizes: Floats
    shares: Floats

    def take(self, some: slice | NDArray[np.int64]) -> Bodies:
        """Some of the hypotheses."""
        return Bodies(*(part[some] for part in self))
