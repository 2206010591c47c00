"""Nuisances of objects and presses: sizes, surfaces, offsets and forces."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Constant, Distribution, Uniform, require_distribution


@dataclass(frozen=True)
class Variation:
    """What differs from object to object (size, friction, stiffness) and from press to press (offset, force).

    Attributes:
        size: factor on the nominal size of every object, built-in or mesh; ``Constant(1.0)`` for one of known size.
        offset: of an object's centre from the approach axis, along y and along z [m].
        force: at which the motion stops [N].
        friction: coefficient between an object and the pad.
        stiffness: of the pad's layer together with an object's skin, relative to the pad's alone.

    Raises:
        InvalidArgument: one of them is no distribution.
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
