"""What a surface of triangles is from outside.

Parallel rays from many directions find the triangles that are met first. A pad never feels the others.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.solids.raster import Surface, first_faces
from activetouch.solids.triangles import (
    Floats,
    Ints,
    are_star_shaped,
    areas,
    bodies_of_vertices,
    edges,
    frame_across,
    on_spiral,
    tetrahedra,
)

MOST_INSIDE = 0.1
"""Largest share of the rays from outside that may first meet the inside of a surface, through its holes."""

_NUM_DIRECTIONS, _NUM_PIXELS = 32, 32  # of the rays; pixels along each side of a direction's square
_MOST_PAIRS = 1 << 24  # of triangles and rays of all directions, approximately
_PROBES = 8  # every such direction is asked for its number of pairs
_SAME_DEPTH = 1e-9  # [m]
_THINNEST = 1e-6  # extent of a flat sheet across itself, relative to its extent along itself


class Examined(NamedTuple):
    """Triangles that face outwards, and what was found about them.

    The centre of mass is ``(3,)`` [m]. Remarks are what the surface has beyond one closed solid; the problem is why it
    is no solid, or None.
    """

    faces: Ints
    centre: Floats
    remarks: tuple[str, ...] = ()
    problem: str | None = None


def examined(vertices: Floats, faces: Ints) -> Examined:
    """Turn the triangles outwards, and say what a pad will feel of them.

    A patch is a set of triangles that are connected through edges of two triangles. Each patch is oriented as a whole:
    outwards if it is closed, else so that the rays from outside meet its front rather than its back. The centre of mass
    is that of all closed patches that the rays meet, filled with one material; where they overlap they count twice. If
    one of the patches is open, its volume is unknown, and the centre is that of the surface that the rays meet.
    Vertices ``(v, 3)`` [m] are finite; there is at least one triangle in ``faces (f, 3)``.
    """
    middle = vertices.mean(axis=0)  # for accuracy far from the origin
    vertices = vertices - middle
    extents = np.linalg.eigvalsh(vertices.T @ vertices)  # squared
    if extents[0] <= _THINNEST**2 * extents[-1]:
        return Examined(faces, middle, problem="it encloses no volume: it is flat")
    patch, turned = _patches(faces)
    faces = np.where(turned[:, None], faces[:, ::-1], faces)
    num_patches = int(patch.max()) + 1
    num_open, num_shared, is_open = _openness(faces, patch, num_patches)
    volumes = tetrahedra(vertices, faces)
    is_turned = ~is_open & (np.bincount(patch, volumes) < 0.0)
    if num_patches == 1 and not is_open[0]:
        if not volumes.sum():
            return Examined(faces, middle, problem="it encloses no volume")
        centre = volumes @ vertices[faces].sum(axis=1) / (4 * volumes.sum())
        return Examined(faces[:, ::-1] if is_turned[0] else faces, middle + centre)

    faces = np.where(is_turned[patch][:, None], faces[:, ::-1], faces)
    volumes = np.where(is_turned[patch], -volumes, volumes)
    triangle, is_back = first_met(vertices, faces, is_sound=not is_open.any() and are_star_shaped(vertices, faces))
    if not len(triangle):
        return Examined(faces, middle, problem="it encloses no volume")
    backs, met = (np.bincount(patch[some], minlength=num_patches) for some in (triangle[is_back], triangle))
    is_turned = is_open & (2 * backs > met)
    faces = np.where(is_turned[patch][:, None], faces[:, ::-1], faces)
    inside = float((is_back != is_turned[patch[triangle]]).mean())
    felt = (met > 0)[patch]
    weights = volumes * felt
    corners = vertices[faces].sum(axis=1)
    if is_open[met > 0].any() or not weights.sum() > 0.0:
        weights = areas(vertices, faces) * felt
        centre = weights @ corners / (3 * weights.sum())
    else:
        centre = weights @ corners / (4 * weights.sum())
    remarks = []
    if (num_bodies := len(np.unique(bodies_of_vertices(faces, len(vertices))[faces[felt, 0]]))) > 1:
        remarks.append(f"{num_bodies} separate surfaces, which are felt as their union")
    if num_shared:
        remarks.append(f"{num_shared} edges of more than two triangles, which touches do not show")
    seen = f"{num_open} open edges; {inside:.1%} of {len(triangle)} rays from outside first meet the inside"
    if num_open or inside:
        remarks.append(f"{seen} of the surface, and a touch there shows what lies behind a hole")
    problem = (
        f"it is not closed: {seen}, {MOST_INSIDE:.0%} are the most. It is a sheet without thickness, or has large "
        "holes: fill them, or make it solid, in the program it comes from"
    )
    return Examined(faces, middle + centre, tuple(remarks), problem if inside > MOST_INSIDE else None)


@cache
def _views() -> Floats:
    """Directions of the rays, and unit vectors across each, ``(32 directions, 3 vectors, 3)``."""
    directions = on_spiral(1 - 2 * (np.arange(_NUM_DIRECTIONS) + 0.5) / _NUM_DIRECTIONS)
    return np.stack([np.vstack([one, frame_across(one)]) for one in directions])


def first_met(vertices: Floats, faces: Ints, is_sound: bool = False) -> tuple[Ints, NDArray[np.bool_]]:
    """The first triangle that each ray from outside meets, ``(n,)``, and whether it is met from behind, ``(n,)``.

    The rays are the same for all surfaces of one size: 32 directions, and 32 × 32 rays of each, or fewer if thousands
    of triangles are so large that most rays pass through most of them. Those that miss are left out.
    """
    views, num_faces, num_pixels = _views().copy(), len(faces), _NUM_PIXELS
    across = (axes @ vertices.T for axes in np.split(views[:, 1:].reshape(-1, 3), _PROBES))  # some views at a time
    bounds = np.concatenate([np.stack([flat.min(axis=1), flat.max(axis=1)], axis=1) for flat in across])
    low, high = bounds.T.reshape(2, -1, 2)
    extents = np.maximum(high - low, 1e-12)
    views[:, 1:] /= extents[:, :, None]  # they map the surface to a square of one metre,
    places = -low / extents - 0.5  # which these move to the middle
    if num_faces * num_pixels**2 * _NUM_DIRECTIONS > _MOST_PAIRS:
        probes = zip(views[::_PROBES], places[::_PROBES], strict=True)
        num_pairs = sum(_num_pairs(vertices @ view[1:].T + place, faces) for view, place in probes)
        num_pixels = max(1, int(num_pixels / np.sqrt(max(1.0, num_pairs * _PROBES / _MOST_PAIRS))))
    views[:, 1:] *= num_pixels
    if not is_sound:  # a triangle that is met from behind is its other side, which comes after all fronts
        faces = np.vstack([faces, faces[:, ::-1]])
    surface = Surface.of(vertices, faces, is_sound=True)
    found = first_faces(surface, views, places * num_pixels, 1.0, num_pixels, _SAME_DEPTH)
    return found % num_faces, found >= num_faces


def _num_pairs(flat: Floats, faces: Ints) -> int:
    """How many pixels the boxes of triangles have, with vertices ``(v, 2)`` in a square of 1 in the middle."""
    corners = flat[faces] * _NUM_PIXELS + (_NUM_PIXELS - 1) / 2
    size = np.floor(corners.max(axis=1)) - np.ceil(corners.min(axis=1)) + 1.0
    return int(np.maximum(size, 0.0).prod(axis=1).sum())


def _patches(faces: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """The patch of each triangle, ``(f,)``, and whether to turn it so that its patch has one orientation, ``(f,)``."""
    # Each triangle is two nodes, as it is and turned. Triangles at an edge of two are linked the same way round.
    size, owner = len(faces), np.repeat(np.arange(len(faces)), 3)
    directed, edge, sharing = edges(faces)
    order = np.argsort(edge, kind="stable")
    one, other = order[sharing[edge[order]] == 2].reshape(-1, 2).T
    start, end = owner[one], owner[other] + size * (directed[one] == directed[other])
    links = np.stack([np.append(start, start + size), np.append(end, (end + size) % (2 * size))])
    _, group = scipy.sparse.csgraph.connected_components(
        scipy.sparse.coo_array((np.ones(links.shape[1]), links), (2 * size, 2 * size)), directed=False
    )
    as_it_is, turned = group[:size], group[size:]
    _, first, patch = np.unique(np.minimum(as_it_is, turned), return_index=True, return_inverse=True)
    return patch, as_it_is != as_it_is[first][patch]


def _openness(faces: Ints, patch: Ints, num_patches: int) -> tuple[int, int, NDArray[np.bool_]]:
    """Numbers of edges of one triangle and of more than two; patches that run along an edge more in one direction."""
    _, edge, sharing = edges(faces)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    owner = np.repeat(patch, 3)
    _, place = np.unique(edge * num_patches + owner, return_inverse=True)
    balance = np.bincount(place, np.where(start < end, 1.0, -1.0))
    is_open = np.bincount(owner, balance[place] != 0.0, minlength=num_patches) > 0
    return int((sharing == 1).sum()), int((sharing > 2).sum()), is_open
