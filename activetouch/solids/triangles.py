"""Surfaces of triangles: their edges, areas and volumes, and what they are from outside.

Parallel rays from many directions find the triangles that are met first. A pad never feels the others.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.solids.vectors import Floats, Ints, frame_across, on_spiral

MOST_INSIDE = 0.1
"""Largest share of the rays from outside that may first meet the inside of a surface, through its holes."""

_NUM_DIRECTIONS, _NUM_PIXELS = 32, 32  # of the rays; pixels along each side of a direction's square
_PAIRS, _MOST_PAIRS = 1 << 20, 1 << 24  # of triangles and rays, tested at a time; of all directions, approximately
_PROBES = 8  # every such direction is asked for its number of pairs
_SAME_DEPTH = 1e-9  # [m]
_THINNEST = 1e-6  # extent of a flat sheet across itself, relative to its extent along itself
_SAME_SIZE = 1e-6  # relative difference of areas and volumes that are one


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


def edges(faces: Ints) -> tuple[Ints, Ints, Ints]:
    """Identifiers of the edges: directed, ``(3 f,)``; undirected, ``(3 f,)``; and triangles at each of the latter.

    The edges of a triangle are from each corner to the next, in order.
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    size = int(faces.max()) + 1
    _, edge, sharing = np.unique(
        np.minimum(start, end) * size + np.maximum(start, end), return_inverse=True, return_counts=True
    )
    return start * size + end, edge, sharing


def normals(vertices: Floats, faces: Ints) -> Floats:
    """Vectors across the triangles, counter-clockwise, as long as twice their areas, ``(f, 3)`` [m²]."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def areas(vertices: Floats, faces: Ints) -> Floats:
    """Areas of the triangles, ``(f,)`` [m²]."""
    return np.asarray(np.linalg.norm(normals(vertices, faces), axis=1) / 2)


def tetrahedra(vertices: Floats, faces: Ints) -> Floats:
    """Signed volumes of the tetrahedra between the origin and each triangle, ``(f,)`` [m³]."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.einsum("fi,fi->f", a, np.cross(b, c)) / 6


def around_origin(corners: Floats) -> tuple[Ints, Floats, Floats]:
    """Which triangles of a plane ``(3, 2, n)`` hold its origin: numbers ``(h,)``, weights ``(3, h)``, and their sum.

    A weight is twice the signed area between the origin and the opposite edge. Those of two triangles with a common
    edge differ only in sign, so that no origin is between them.
    """
    a, b, c = corners
    weights = np.stack([b[0] * c[1] - b[1] * c[0], c[0] * a[1] - c[1] * a[0], a[0] * b[1] - a[1] * b[0]])
    area = weights.sum(axis=0)
    hit = np.flatnonzero(((weights.min(axis=0) >= 0.0) | (weights.max(axis=0) <= 0.0)) & (area != 0.0))
    return hit, weights[:, hit], area[hit]


def is_convex(vertices: Floats, faces: Ints) -> bool:
    """Whether the triangles bound one convex body and face outwards: area and volume are those of its hull.

    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> [is_convex(corners, faces) for faces in (tetrahedron, tetrahedron[:, ::-1], tetrahedron[:3])]
    [True, False, False]
    """
    try:
        hull = scipy.spatial.ConvexHull(vertices)
    except scipy.spatial.QhullError:  # it is flat
        return False
    found = areas(vertices, faces).sum(), tetrahedra(vertices, faces).sum()
    return bool(np.allclose(found, (hull.area, hull.volume), rtol=_SAME_SIZE, atol=0.0))


def bodies_of_vertices(faces: Ints, num_vertices: int) -> Ints:
    """The body of each vertex, ``(v,)``: vertices of one triangle belong to one body."""
    links = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    graph = scipy.sparse.coo_array((np.ones(faces.size), links), (num_vertices, num_vertices))
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1])


def are_star_shaped(vertices: Floats, faces: Ints) -> bool:
    """Whether each connected part of the triangles bounds a body that its middle sees whole, and faces outwards.

    Every ray from the middle leaves such a body once, so that its surface does not cross itself, and the union of such
    bodies is met from outside on triangles that face outwards only.

    Args:
        vertices: ``(v, 3)`` [m].
        faces: ``(f, 3)``.

    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> [are_star_shaped(corners, faces) for faces in (tetrahedron, tetrahedron[:, ::-1], tetrahedron[:3])]
    [True, False, False]
    """
    directed, _, sharing = edges(faces)
    if (sharing != 2).any() or len(np.unique(directed)) < len(directed):
        return False
    body = bodies_of_vertices(faces, len(vertices))
    middles = np.stack([np.bincount(body, along) for along in vertices.T]) / np.bincount(body)
    rays = (vertices - middles.T[body])[faces]
    if not (lengths := np.linalg.norm(rays, axis=2, keepdims=True)).all():
        return False
    a, b, c = (rays / lengths).transpose(1, 0, 2)
    volumes = np.einsum("fi,fi->f", a, np.cross(b, c))
    cosines = 1.0 + sum(np.einsum("fi,fi->f", one, other) for one, other in ((a, b), (b, c), (c, a)))
    angles = 2.0 * np.arctan2(volumes, cosines)  # solid, as seen from the middle (van Oosterom & Strackee 1983)
    around = np.bincount(body[faces[:, 0]], angles)
    return bool((volumes > 0.0).all() and (around < 6.0 * np.pi).all())  # all around once is 4 pi


def portions(counts: Ints, most: int) -> Iterator[slice]:
    """Slices whose counts sum to about ``most``."""
    total = int(counts.sum())
    if total <= most:
        yield slice(0, len(counts))
        return
    ends = np.cumsum(counts)
    cuts = np.searchsorted(ends, np.arange(most, total, most), side="left") + 1
    bounds = np.unique(np.concatenate([[0], cuts, [len(counts)]])).tolist()
    yield from (slice(begin, end) for begin, end in pairwise(bounds))
