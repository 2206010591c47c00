"""How an object lies: weighed orientations and sizes of its body, and what of that nobody can see."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from html import escape

import numpy as np

from activetouch.poses import Quaternion, hamilton_product
from activetouch.symmetry import RotationalSymmetry
from belief.frozen import FrozenArrays
from belief.validation import Floats, require_number

_NEAR = np.deg2rad(12.0)  # orientations that are one way to lie
_STEPS = 3  # of the mean of orientations


@dataclass(frozen=True, eq=False)
class PoseBelief(FrozenArrays):
    """Probabilities of how an object of one shape lies.

    Attributes:
        shape: its label.
        orientations: at rest, before a pose turns the object, unit quaternions ``wxyz``, ``(n, 4)``.
        sizes: relative to the nominal size, ``(n,)``.
        probs: of each, ``(n,)``, which sum to 1.
        symmetry: the rotations of the body that nobody can see.
    """

    shape: str
    orientations: Floats
    sizes: Floats
    probs: Floats
    symmetry: RotationalSymmetry

    def __post_init__(self) -> None:
        number = len(self.probs)
        if self.orientations.shape != (number, 4) or self.sizes.shape != (number,) or not number:
            raise ValueError(
                f"orientations must be (n, 4), sizes and probs (n,), got {self.orientations.shape}, {self.sizes.shape} "
                f"and {self.probs.shape}"
            )
        if not (np.isfinite(self.probs).all() and self.probs.min() >= 0.0 and abs(self.probs.sum() - 1.0) < 1e-9):
            raise ValueError("probs must be probabilities that sum to 1")
        self.freeze()

    @property
    def orientation(self) -> Quaternion:
        """The most probable orientation, a unit quaternion ``wxyz``: the mean of the most probable way to lie."""
        return self.ways()[0].orientation

    @property
    def size(self) -> float:
        """The mean size of the most probable way to lie."""
        return self.ways()[0].size

    def error(self, orientation: Quaternion) -> float:
        """Angle [deg] from the most probable orientation to another, less what the body's symmetry hides."""
        return float(np.rad2deg(self.symmetry.angles(self.orientation, np.asarray(orientation, float)[None])[0]))

    def ways(self) -> list[Way]:
        """The ways to lie, the most probable first; those that look the same by symmetry are one.

        >>> none = RotationalSymmetry(np.array([[1.0, 0.0, 0.0, 0.0]]))
        >>> upright, turned = [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]
        >>> belief = PoseBelief("mug", np.array([upright, turned]), np.ones(2), np.array([0.3, 0.7]), none)
        >>> [(way.prob, way.orientation.tolist()) for way in belief.ways()]
        [(0.7, [0.0, 1.0, 0.0, 0.0]), (0.3, [1.0, 0.0, 0.0, 0.0])]
        """
        return list(self._ways)

    @cached_property
    def _ways(self) -> tuple[Way, ...]:
        rest, found = np.flatnonzero(self.probs), list[Way]()
        while len(rest):
            centre = self.orientations[rest[self.probs[rest].argmax()]]
            for _ in range(_STEPS):
                near = rest[self.symmetry.angles(centre, self.orientations[rest]) <= _NEAR]
                if not len(near):
                    break
                alike = self.symmetry.nearest(centre, self.orientations[near])
                mean = self.probs[near] @ alike
                centre = mean / np.linalg.norm(mean)
            near = rest[self.symmetry.angles(centre, self.orientations[rest]) <= _NEAR]
            near = near if len(near) else rest[[self.probs[rest].argmax()]]
            prob = float(self.probs[near].sum())
            found.append(Way(centre, float(self.probs[near] @ self.sizes[near] / prob), prob))
            rest = np.setdiff1d(rest, near)
        return tuple(sorted(found, key=lambda way: -way.prob))

    def credible(self, mass: float = 0.9) -> CredibleSet:
        """The orientations within some angle of the fewest ways to lie, which hold a probability of ``mass``."""
        require_number("mass", mass, 0.0, 1.0)
        ways, total = list[Way](), 0.0
        for way in self.ways():
            ways.append(way)
            total += way.prob
            if total >= mass:
                break
        centres = np.stack([way.orientation for way in ways])
        angles = np.min([self.symmetry.angles(centre, self.orientations) for centre in centres], axis=0)
        order = np.argsort(angles)
        held = np.cumsum(self.probs[order])
        place = min(int(np.searchsorted(held, mass * held[-1] - 1e-12)), len(order) - 1)
        return CredibleSet(centres, float(np.rad2deg(angles[order[place]])), self.symmetry)

    def _repr_html_(self) -> str:
        """The sentence, for a notebook."""
        return f"<p>{escape(str(self))}</p>"

    def __str__(self) -> str:
        way, found = self.ways()[0], self.credible()
        w, x, y, z = way.orientation.round(3).tolist()
        others = "" if len(found.orientations) == 1 else f" of one of {len(found.orientations)} ways to lie"
        return (
            f"{self.shape} lies as ({w}, {x}, {y}, {z}), size {way.size:.2f}; with probability 0.9 within "
            f"{found.radius:.1f}°{others}; {self.symmetry}"
        )


@dataclass(frozen=True, eq=False)
class Way:
    """A way to lie: its mean orientation ``wxyz`` and size, and its probability."""

    orientation: Quaternion
    size: float
    prob: float


@dataclass(frozen=True, eq=False)
class CredibleSet(FrozenArrays):
    """Orientations within ``radius`` [deg] of some ``orientations (m, 4)``, less what the body's symmetry hides."""

    orientations: Floats
    radius: float
    symmetry: RotationalSymmetry

    def __post_init__(self) -> None:
        self.freeze()

    def contains(self, orientation: Quaternion) -> bool:
        """Whether an orientation is in the set."""
        angles = self.symmetry.angles(np.asarray(orientation, float), self.orientations)
        return bool(np.rad2deg(angles.min()) <= self.radius)


def turned_slightly(orientation: Quaternion, vectors: Floats) -> Floats:
    """Orientations ``(n, 4)`` that small rotation vectors ``(n, 3)`` [rad] make of one."""
    angles = np.linalg.norm(vectors, axis=1, keepdims=True)
    turns = np.hstack([np.cos(angles / 2), vectors * (np.sinc(angles / (2 * np.pi)) / 2)])
    return np.stack(hamilton_product(orientation, turns.T), axis=1)
