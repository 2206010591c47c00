"""How a body may rest on a level floor: its stable faces, found from its triangles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import DTypeLike, NDArray

from activetouch.errors import BadMesh
from activetouch.solids.raster import heights
from activetouch.solids.solid import Floats, Shape
from activetouch.solids.triangles import solid_angles, tetrahedra

NUM_TURNS = 24
"""Turns about the vertical that are told apart, by 15°."""
MOST_FACES = 6
"""Stable faces of a body, the likeliest ones."""
_MOST_CORNERS = 1000  # of a hull, by which heights after a tilt are found
_MOST_VIEWS = 64  # of faces that are compared
_ANGLES, _RINGS = 3 * NUM_TURNS, 10  # of a view in polar coordinates
_PIXELS = 96
_ALIKE = 0.03  # mean difference of the heights of two views that are one, in radii of the body
_TILT, _LOWER = np.radians(15.0), 0.003  # a tilt, and by what part it lowers a body that is not stable
_UP = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # from a tray (z up) to a pad that looks down


@dataclass(frozen=True, eq=False)
class Rests:
    """The F stable faces of a body that look different from above.

    Attributes:
        rotations: from the body's frame to that of a tray, whose z axis points up, matrices ``(F, 3, 3)``.
        probs: probability of each face, ``(F,)``: the solid angle of what rolls to it, as the centre of mass sees it.
        lifts: height of the body's origin above the floor [m], ``(F,)``.
        turns: number of turns by 15° until the view from above is the same again, ``(F,)``; 24 without symmetry.
    """

    rotations: Floats
    probs: Floats
    lifts: Floats
    turns: NDArray[np.int64]


def rests(shape: Shape) -> Rests:
    """The stable faces of a body of uniform density: those of its hull above which the centre of mass stands.

    Faces that look alike from above, up to a turn, are one.

    Raises:
        BadMesh: the body is flat.

    >>> from activetouch import SHAPES
    >>> found = rests(SHAPES["cylinder"])                     # it stands, or it lies
    >>> found.probs.round(2).tolist(), found.turns.tolist(), (1000 * found.lifts).round(1).tolist()
    ([0.78, 0.22], [12, 1], [16.0, 20.0])
    """
    vertices, faces = shape.surface.vertices.T, shape.surface.faces.T
    try:
        hull = scipy.spatial.ConvexHull(vertices)
    except scipy.spatial.QhullError as error:
        raise BadMesh(f"the shape {shape!r:.80} is flat: it has no face to rest on") from error
    centre = _centre_of_mass(vertices, faces)
    downs, angles, distances = _facets(hull, centre)
    kept = np.flatnonzero(angles)[np.argsort(distances[angles > 0.0], kind="stable")]
    if len(kept) > _MOST_VIEWS:  # of a curved surface, of which some stand for all
        shares = np.cumsum(angles[kept]) / angles.sum()
        drawn = kept[np.searchsorted(shares, (np.arange(_MOST_VIEWS) + 0.5) / _MOST_VIEWS)]
        kept, counts = np.unique(drawn, return_counts=True)
        angles[kept] = counts
    turned = _down(downs[kept])
    lifts = -(turned[:, 2] @ vertices.T).min(axis=1)
    views = _views(shape, turned, lifts)
    groups: list[list[int]] = []
    for one in range(len(kept)):
        mate = next((group for group in groups if _difference(views[group[0]], views[one]) < _ALIKE), None)
        if mate is None:
            groups.append([one])
        else:
            mate.append(one)
    probs = np.array([angles[kept[group]].sum() for group in groups])
    chosen = np.argsort(-probs, kind="stable")[:MOST_FACES]
    first = np.array([groups[one][0] for one in chosen])
    turns = np.array([_period(views[one]) for one in first])
    return Rests(turned[first], probs[chosen] / probs[chosen].sum(), lifts[first], turns)


def seen_from_above(rotations: Floats) -> Floats:
    """Rotations to the frame of a pad that looks down, ``(n, 3, 3)``, of those to the frame of a tray."""
    return np.asarray(_UP @ rotations)


def heights_above_floor(
    shape: Shape,
    turns: Floats,
    lifts: Floats,
    places: Floats,
    pixel: float,
    num_pixels: int,
    dtype: DTypeLike = np.float64,
) -> NDArray[Any]:
    """Heights of a body above the floor [m], from above, ``(n, num_pixels, num_pixels)``; ``-inf`` beside it.

    Args:
        shape: the body.
        turns: rotations to the frame of the tray times size factors, ``(n, 3, 3)``.
        lifts: height of the body's origin above the floor [m], ``(n,)``.
        places: of the origin from the middle of the square, along x and y [m], ``(n, 2)``.
        pixel: its edge [m].
        num_pixels: along an edge of the square, whose rows go along x.
        dtype: of the result.
    """
    maps = heights(shape.surface, seen_from_above(turns), places[:, ::-1], pixel, num_pixels, dtype)
    return np.asarray(maps + lifts.astype(dtype)[:, None, None])


def about_vertical(angles: Floats) -> Floats:
    """Rotations about the z axis, ``(n, 3, 3)``, by angles ``(n,)`` [rad]."""
    cosines, sines, zeros, ones = np.cos(angles), np.sin(angles), np.zeros_like(angles), np.ones_like(angles)
    rows = [[cosines, -sines, zeros], [sines, cosines, zeros], [zeros, zeros, ones]]
    return np.moveaxis(np.array(rows), 2, 0)


def _centre_of_mass(vertices: Floats, faces: NDArray[np.int64]) -> Floats:
    volumes = tetrahedra(vertices, faces)
    total = volumes.sum()
    if abs(total) < 1e-12 * np.abs(volumes).sum():  # not closed
        return np.asarray(vertices.mean(axis=0))
    return np.asarray(volumes @ vertices[faces].sum(axis=1) / (4.0 * total))


def _facets(hull: scipy.spatial.ConvexHull, centre: Floats) -> tuple[Floats, Floats, Floats]:
    """Outer normals of the flat parts of a hull ``(f, 3)``, and their distances from the centre of mass ``(f,)`` [m].

    Between them ``(f,)``, the solid angles, as the centre of mass sees them, of all parts from which a body comes to
    rest on this one: from a part on which it is not stable, it rolls to the lowest neighbour. It is stable where the
    centre of mass stands above the part, and where no tilt of 15° lowers it: the parts of a curved surface are small,
    so that the centre stands above each.
    """
    size = np.ptp(hull.points, axis=0).max()
    keys = np.round(np.c_[hull.equations[:, :3] * 1e4, hull.equations[:, 3:] * 1e4 / size]).astype(np.int64)
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    group, num = group.ravel(), len(first)
    rays = hull.points[hull.simplices] - centre
    angles = np.bincount(group, np.abs(solid_angles(rays / np.linalg.norm(rays, axis=2, keepdims=True))[1]), num)
    distances = -(hull.equations[first, :3] @ centre + hull.equations[first, 3])
    corners = rays.transpose(1, 0, 2)
    outer = hull.points[hull.vertices[:: len(hull.vertices) // _MOST_CORNERS + 1]] - centre
    stands = _are_lowest(outer, hull.equations[first, :3])
    for place in range(3):  # the edge opposite to a corner
        start = corners[(place + 1) % 3]
        outwards = np.cross(corners[(place + 2) % 3] - start, hull.equations[:, :3])
        outwards *= -np.sign(np.einsum("fi,fi->f", corners[place] - start, outwards))[:, None]
        is_edge = group[hull.neighbors[:, place]] != group
        stands[group[is_edge & (np.einsum("fi,fi->f", start, outwards) < 0.0)]] = False
    rolls, lowest = np.arange(num), np.where(stands, -np.inf, distances)
    beside = group[hull.neighbors].ravel()
    around = group.repeat(3)
    order = np.lexsort((distances[beside], around))
    parts, begin = np.unique(around[order], return_index=True)
    best = beside[order][begin]  # the lowest neighbour of each part
    is_lower = distances[best] < lowest[parts]
    rolls[parts[is_lower]] = best[is_lower]
    while (rolls[rolls] != rolls).any():
        rolls = rolls[rolls]
    return hull.equations[first, :3], np.asarray(np.bincount(rolls, angles, num), float), np.asarray(distances, float)


def _are_lowest(corners: Floats, downs: Floats) -> NDArray[np.bool_]:
    """Whether no tilt lowers the centre of mass of a body that rests on each part of its hull, ``(f,)``."""
    angles = np.arange(12) * np.pi / 6
    across = _down(downs)[:, :2]
    around = np.einsum("ak,fkj->faj", np.stack([np.cos(angles), np.sin(angles)], axis=1), across)
    lowest = np.full(len(downs), np.inf)
    points = np.asarray(corners, np.float32)
    for tilted in np.moveaxis(np.cos(_TILT) * downs[:, None] + np.sin(_TILT) * around, 1, 0):
        np.minimum(lowest, _highest(points, tilted.astype(np.float32)), out=lowest)
    return np.asarray(lowest >= (1.0 - _LOWER) * _highest(points, downs.astype(np.float32)))


def _highest(corners: NDArray[np.float32], directions: NDArray[np.float32]) -> NDArray[np.float32]:
    """How far a body reaches in each direction, ``(f,)``."""
    return np.concatenate(
        [(some @ corners.T).max(axis=1) for some in np.array_split(directions, len(directions) // 256 + 1)]
    )


def _down(normals: Floats) -> Floats:
    """Rotations that turn unit vectors ``(n, 3)`` to −z, ``(n, 3, 3)``."""
    helpers = np.eye(3)[np.abs(normals).argmin(axis=1)]
    x = np.cross(helpers, normals)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(x, normals), -normals], axis=1)


def _views(shape: Shape, rotations: Floats, lifts: Floats) -> Floats:
    """Heights above the floor from above in polar coordinates, in radii of the body, ``(n, rings, angles)``."""
    radius = shape.bounding_radius
    pixel = 2.0 * radius / _PIXELS
    places = np.zeros((len(rotations), 2))
    maps = heights(shape.surface, seen_from_above(rotations), places, pixel, _PIXELS, np.float32)
    maps = scipy.ndimage.uniform_filter(np.maximum(maps + lifts[:, None, None], 0.0) / radius, (0, 3, 3))
    ring = (np.arange(_RINGS) + 0.5) / _RINGS * _PIXELS / 2
    angle = np.arange(_ANGLES) * 2.0 * np.pi / _ANGLES
    rows = np.clip(_PIXELS / 2 + ring[:, None] * np.cos(angle), 0, _PIXELS - 1).astype(int)  # along the tray's x
    columns = np.clip(_PIXELS / 2 + ring[:, None] * np.sin(angle), 0, _PIXELS - 1).astype(int)
    return np.asarray(maps[:, rows, columns])


def _difference(one: Floats, other: Floats) -> float:
    """Mean difference of the heights of two views after the best turn, weighted by area."""
    weights = (np.arange(_RINGS) + 0.5) / (_RINGS**2 / 2 * _ANGLES)
    rolled = np.stack([np.roll(other, turn, axis=1) for turn in range(_ANGLES)])
    return float((np.abs(rolled - one) * weights[:, None]).sum(axis=(1, 2)).min())


def _period(view: Floats) -> int:
    """Turns by 15° until a view is the same again."""
    weights = (np.arange(_RINGS) + 0.5) / (_RINGS**2 / 2 * _ANGLES)
    for turn in (number for number in range(1, NUM_TURNS) if NUM_TURNS % number == 0):
        step = turn * _ANGLES // NUM_TURNS
        if (np.abs(np.roll(view, step, axis=1) - view) * weights[:, None]).sum() < _ALIKE:
            return turn
    return NUM_TURNS
