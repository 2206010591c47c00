"""Ideal images of many presses of one body at once: one orientation, many offsets and forces, quasistatically.

The images are exactly those of :class:`activetouch.pressing.press.Quasistatic`. All rays of one orientation are cast
together, and the depths of all forces at an offset are read from one sorted list of gaps: a hundredth of the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Distribution
from activetouch.placement import Placement
from activetouch.poses import to_matrix
from activetouch.pressing.pad import Pad
from activetouch.rendering import PressureRenderer
from activetouch.scene import Scene, Variation

Floats = NDArray[np.float64]

_SAMPLE = 4096  # numbers that stand for a distribution
_POINTS_AT_ONCE = 32768  # of the pad, over offsets and forces, so that arrays stay in the cache
_LATTICE = np.array([0.7548776662466927, 0.5698402909980532])  # Roberts' R2 sequence: points that fill a square evenly


@dataclass(frozen=True, eq=False)
class PressDraws:
    """What differs from press to press.

    Attributes:
        offsets: of the object's centre, along y and z [m], ``(J, 2)``.
        forces: several at each offset [N], ``(J, F)``.
    """

    offsets: Floats
    forces: Floats


class PressSampler:
    """Draws offsets and forces of presses that cover their distributions evenly.

    Args:
        variation: of the scene.
        num_offsets: J.
        num_forces: F at each offset.
    """

    def __init__(self, variation: Variation, num_offsets: int, num_forces: int) -> None:
        rng = np.random.default_rng(0)
        self._offset, self._force = (_quantiles(one, rng) for one in (variation.offset, variation.force))
        self._lattice = np.arange(num_offsets)[:, None] * _LATTICE
        self._strata = np.arange(num_forces) / num_forces

    def sample(self, rng: np.random.Generator) -> PressDraws:
        """Offsets from a lattice that is shifted at random, and a force from each of F strata at every offset."""
        offsets = _at(self._offset, (self._lattice + rng.random(2)) % 1.0)
        within = rng.random((len(offsets), len(self._strata))) / len(self._strata)
        return PressDraws(offsets, _at(self._force, self._strata + within))


def ideal_presses(scene: Scene, placement: Placement, draws: PressDraws) -> Floats:
    """Ideal images of quasistatic presses, ``(J * F, n, n)``.

    Args:
        scene: with the pad, and a renderer that has ``mean_pressure``.
        placement: the body; its offset is not used.
        draws: offsets and forces.
    """
    mean_pressure = cast(PressureRenderer, scene.renderer).mean_pressure
    pad, edge, images = scene.pad, scene.pad.num_taxels, []
    at_once = max(1, _POINTS_AT_ONCE // (edge**2 * draws.forces.shape[1]))
    for first in range(0, len(draws.offsets), at_once):
        some = slice(first, first + at_once)
        gaps = surface_gaps(pad, placement, draws.offsets[some])
        depths = indentations(pad, gaps, draws.forces[some] / placement.stiffness)
        pressed = depths[:, :, None] - gaps[:, None]
        np.maximum(pressed, 0.0, out=pressed)
        images.append(mean_pressure(pressed.reshape(-1, edge, edge)))
    return np.concatenate(images) * (placement.stiffness / pad.max_depth)


def surface_gaps(pad: Pad, placement: Placement, offsets: Floats) -> Floats:
    """Gaps as of :func:`activetouch.pressing.contact.surface_gap`, at most ``max_depth``, for many offsets.

    Args:
        pad: the pad.
        placement: the body; its offset is not used.
        offsets: ``(J, 2)`` [m].

    Returns:
        ``(J, num_taxels²)`` [m].
    """
    to_object = to_matrix(placement.orientation).T / placement.scale
    centres = np.column_stack([np.full(len(offsets), 2 * placement.bounding_radius), offsets]).T  # (3, J)
    origins = (to_object @ pad.taxel_centres)[:, None] - (to_object @ centres)[:, :, None]
    direction = to_object[:, 0] * placement.scale
    distances = placement.shape.entry_distance(origins.reshape(3, -1), direction).reshape(len(offsets), -1)
    distances *= placement.scale
    with np.errstate(invalid="ignore"):  # of a miss: no distance is finite
        return np.fmin(distances - distances.min(axis=1, keepdims=True), pad.max_depth, out=distances)


def indentations(pad: Pad, gaps: Floats, forces: Floats) -> Floats:
    """Depths as of :meth:`Pad.indentation` for many gaps and forces [m], ``(J, F)``.

    Args:
        pad: the pad.
        gaps: from :func:`surface_gaps`, ``(J, T)``.
        forces: ``(J, F)`` [N].
    """
    ordered = np.sort(gaps, axis=1)
    sums = np.cumsum(ordered, axis=1)
    loads = forces / (pad.stiffness * pad.taxel_area)  # sum of indentations that carries the force [m]
    before = ordered * np.arange(1, gaps.shape[1] + 1)
    before -= sums  # the load at which the next taxel is reached, (J, T)
    rows = zip(sums, before, loads, strict=True)
    return np.minimum(np.stack([_row_depths(*row) for row in rows]), pad.max_depth)


def _row_depths(sums: Floats, before: Floats, loads: Floats) -> Floats:
    loaded = np.maximum(np.searchsorted(before, loads), 1)
    return np.asarray((loads + sums[loaded - 1]) / loaded)


def _quantiles(distribution: Distribution, rng: np.random.Generator) -> Floats:
    return np.sort([distribution.sample(rng) for _ in range(_SAMPLE)])


def _at(quantiles: Floats, shares: Floats) -> Floats:
    """The values below which the given shares of a sorted sample lie."""
    return np.interp(shares * len(quantiles) - 0.5, np.arange(len(quantiles)), quantiles)
