"""What a surface of triangles is from outside: its bodies, the orientation of its triangles, and its holes.

Parallel rays from many directions find the triangles that are met first. A pad never feels the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.solids.raster import portions
from activetouch.solids.solid import Floats, Ints, frame_across, on_spiral
from activetouch.solids.triangles import areas, around_origin, bodies_of_vertices, edges, tetrahedra

MOST_INSIDE = 0.1
"""Largest share of the rays from outside that may first meet the inside of a surface, through its holes."""

_NUM_DIRECTIONS, _NUM_PIXELS = 32, 32  # of the rays; pixels along each side of a direction's square
_PAIRS, _MOST_PAIRS = 1 << 20, 1 << 24  # of triangles and rays, tested at a time; of all directions, approximately
_PROBES = 8  # every such direction is asked for its number of pairs
_SAME_DEPTH = 1e-9  # [m]
_THINNEST = 1e-6  # extent of a flat sheet across itself, relative to its extent along itself


class Examined(NamedTuple):
    """Triangles that face outwards, and what was found about them.

    Attributes:
        faces: ``(f, 3)``.
        centre: the centre of mass ``(3,)`` [m].
        remarks: what the surface has beyond one closed solid, as text.
        problem: the reason why it is no solid, or None.
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

    Args:
        vertices: ``(v, 3)`` [m], finite.
        faces: ``(f, 3)``, at least one.
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
    inwards = np.bincount(patch, volumes) < 0.0
    if num_patches == 1 and not is_open[0]:
        if not volumes.sum():
            return Examined(faces, middle, problem="it encloses no volume")
        centre = volumes @ vertices[faces].sum(axis=1) / (4 * volumes.sum())
        return Examined(faces[:, ::-1] if inwards[0] else faces, middle + centre)

    triangle, is_back = first_met(vertices, faces)
    if not len(triangle):
        return Examined(faces, middle, problem="it encloses no volume")
    backs, met = (np.bincount(patch[some], minlength=num_patches) for some in (triangle[is_back], triangle))
    inwards = np.where(is_open, 2 * backs > met, inwards)
    faces = np.where(inwards[patch][:, None], faces[:, ::-1], faces)
    inside = float((is_back != inwards[patch[triangle]]).mean())
    felt = (met > 0)[patch]
    weights = np.where(inwards[patch], -volumes, volumes) * felt
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


def first_met(vertices: Floats, faces: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """The first triangle that each ray from outside meets, ``(n,)``, and whether it is met from behind, ``(n,)``.

    The rays are the same for all surfaces of one size: 32 directions, and 32 × 32 rays of each, or fewer if thousands
    of triangles are so large that most rays pass through most of them. Those that miss are left out.
    """
    directions, num_pixels = on_spiral(1 - 2 * (np.arange(_NUM_DIRECTIONS) + 0.5) / _NUM_DIRECTIONS), _NUM_PIXELS
    num_pairs = sum(
        int(_seen_along(one, vertices, faces, num_pixels)[2].prod(axis=1).sum()) for one in directions[::_PROBES]
    )
    if (excess := num_pairs * _PROBES / _MOST_PAIRS) > 1.0:
        num_pixels = max(1, int(num_pixels / np.sqrt(excess)))
    found = [_first_met_along(direction, vertices, faces, num_pixels) for direction in directions]
    triangles, backs = zip(*found, strict=True)
    return np.concatenate(triangles), np.concatenate(backs)


def _seen_along(direction: Floats, vertices: Floats, faces: Ints, num_pixels: int) -> tuple[Floats, Ints, Ints]:
    """Corners across a direction [pixels], ``(f, 3, 2)``, and first pixel and size of their boxes, ``(f, 2)``."""
    across = vertices @ (frame_across(direction) * [[1.0], [-1.0]]).T
    lowest = across.min(axis=0)
    across = (across - lowest) / np.maximum(np.ptp(across, axis=0), 1e-12) * num_pixels - 0.5  # pixels are integers
    corners = across[faces]
    first, last = np.ceil(corners.min(axis=1)).astype(np.intp), np.floor(corners.max(axis=1)).astype(np.intp)
    return corners, first, np.maximum(last - first + 1, 0)


def _first_met_along(
    direction: Floats, vertices: Floats, faces: Ints, num_pixels: int
) -> tuple[Ints, NDArray[np.bool_]]:
    corners, first, size = _seen_along(direction, vertices, faces, num_pixels)
    depth, num = vertices @ direction, size.prod(axis=1)
    seen = np.flatnonzero(num)
    found = []
    for part in portions(num[seen], _PAIRS):
        some = seen[part]
        triangle = np.repeat(some, num[some])
        place = np.arange(len(triangle)) - np.repeat(np.cumsum(num[some]) - num[some], num[some])
        pixel = first[triangle] + np.column_stack(np.divmod(place, size[triangle, 1]))
        hit, weights, area = around_origin((corners[triangle] - pixel[:, None]).transpose(1, 2, 0))
        distance = (weights * depth[faces[triangle[hit]]].T).sum(axis=0) / area
        found.append((pixel[hit] @ (num_pixels, 1), triangle[hit], distance, area > 0.0))  # counter-clockwise along it
    ray, triangle, distance, is_back = map(np.concatenate, zip(*found, strict=True))
    order = np.lexsort((is_back, np.round(distance / _SAME_DEPTH), ray))
    nearest = order[np.unique(ray[order], return_index=True)[1]]
    return triangle[nearest], is_back[nearest]


def _patches(faces: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """The patch of each triangle, ``(f,)``, and whether to turn it so that its patch has one orientation, ``(f,)``.

    Triangles that share an edge of two triangles are neighbours. Each triangle is a pair of nodes, as it is and turned;
    neighbours are linked such that both are the same way round.
    """
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
    """How many edges are of one triangle and of more than two, and whether each patch is open.

    A patch is closed if it runs along each edge as often in one direction as in the other.
    """
    _, edge, sharing = edges(faces)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    owner = np.repeat(patch, 3)
    _, place = np.unique(edge * num_patches + owner, return_inverse=True)
    balance = np.bincount(place, np.where(start < end, 1.0, -1.0))
    is_open = np.bincount(owner, balance[place] != 0.0, minlength=num_patches) > 0
    return int((sharing == 1).sum()), int((sharing > 2).sum()), is_open
