"""Random bodies: what a reader that has to know the sensor, not the shapes, learns from.

The families are wide on purpose: flat, round and pointed parts, holes and rings, thin plates and long bars, unions of
parts, from the size of a key to larger than a pad. A body follows from its number alone, so that bodies of numbers that
a training left out are new to it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache

import numpy as np
import scipy  # whose parts load at first use

from activetouch.poses import normalised, random_orientation, to_matrix
from activetouch.solids.primitives import hull, joined, turned
from activetouch.solids.raster import Surface
from activetouch.solids.triangles import Floats, Triangles, tetrahedra

_MM = 1e-3
_ROUND = 64  # corners of what stands for a circle
_ALONE = 0.55  # share of bodies of one part
_ALIGNED = 0.7  # share of parts of a union whose axes are those of the first
_EXTREME = 0.25  # share of bodies that are stretched, to plates and bars
_LARGEST, _SMALLEST = 0.06, 0.004  # radius of the bounding ball [m]


@lru_cache(maxsize=8192)
def random_body(number: int) -> Surface:
    """The body of a number ≥ 0, kept for the next batch that shows it."""
    rng = np.random.default_rng([number, 0xB0D1])
    parts = [_part(rng)]
    if rng.uniform() > _ALONE:
        parts += [_beside(_part(rng), parts[0], rng) for _ in range(rng.integers(1, 4))]
    vertices, faces = joined(parts)
    if rng.uniform() < _EXTREME:
        vertices = vertices * np.exp(rng.uniform(-1.2, 0.7, 3))
    volumes = tetrahedra(vertices, faces)
    vertices = vertices - volumes @ vertices[faces].sum(axis=1) / (4 * volumes.sum())
    radius = np.linalg.norm(vertices, axis=1).max()
    return Surface.of(vertices * np.clip(radius, _SMALLEST, _LARGEST) / radius, faces)


def _part(rng: np.random.Generator) -> Triangles:
    return _FAMILIES[rng.choice(len(_FAMILIES), p=_SHARES)](rng)


def _polytope(rng: np.random.Generator, normals: Floats, offsets: Floats, cuts: float = 0.35) -> Triangles:
    """The points x with n · x ≤ d for all planes, some with one or two more planes that cut a corner or an edge off."""
    if rng.uniform() < cuts:
        points = scipy.spatial.HalfspaceIntersection(np.column_stack([normals, -offsets]), np.zeros(3)).intersections
        for normal in _directions(rng, int(rng.integers(1, 3))):
            reach = (points @ normal).max()
            normals, offsets = np.vstack([normals, normal]), np.append(offsets, rng.uniform(0.4, 0.98) * reach)
    return hull(scipy.spatial.HalfspaceIntersection(np.column_stack([normals, -offsets]), np.zeros(3)).intersections)


def _directions(rng: np.random.Generator, number: int) -> Floats:
    return normalised(rng.normal(size=(number, 3)))


def _box(rng: np.random.Generator) -> Triangles:
    return _polytope(rng, np.vstack([np.eye(3), -np.eye(3)]), np.tile(rng.uniform(5, 26, 3), 2) * _MM)


def _prism(rng: np.random.Generator) -> Triangles:
    return _tapered(rng, int(rng.integers(3, 9)), 1.0)


def _pyramid(rng: np.random.Generator) -> Triangles:
    return _tapered(rng, int(rng.integers(3, 7)), rng.uniform(0.0, 0.9))


def _cylinder(rng: np.random.Generator) -> Triangles:
    return _tapered(rng, _ROUND, 1.0)


def _cone(rng: np.random.Generator) -> Triangles:
    return _tapered(rng, _ROUND, rng.uniform(0.0, 0.9))


def _tapered(rng: np.random.Generator, sides: int, taper: float) -> Triangles:
    """A prism or frustum along z whose top is ``taper`` times as wide as its bottom."""
    radius, half_length = rng.uniform(7, 24) * _MM, rng.uniform(5, 28) * _MM
    angles = 2 * np.pi * (np.arange(sides) + rng.uniform()) / sides
    slope = radius * (1 - taper) / (2 * half_length)
    normals = np.column_stack([np.cos(angles), np.sin(angles), np.full(sides, slope)])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = np.full(sides, radius * (1 + taper) / 2) / lengths[:, 0]
    ends = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    return _polytope(rng, np.vstack([normals / lengths, ends]), np.append(offsets, [half_length] * 2))


def _random_polytope(rng: np.random.Generator) -> Triangles:
    number = int(rng.integers(5, 24))
    normals = np.vstack([_directions(rng, number), np.eye(3), -np.eye(3)])
    return _polytope(rng, normals, np.append(rng.uniform(9, 22, number), np.tile(rng.uniform(10, 25, 3), 2)) * _MM, 0.0)


def _ellipsoid(rng: np.random.Generator) -> Triangles:
    vertices, faces = _ball()
    return vertices * (np.full(3, rng.uniform(7, 24)) if rng.uniform() < 0.3 else rng.uniform(6, 26, 3)) * _MM, faces


def _half_ball(rng: np.random.Generator) -> Triangles:
    vertices = _ball()[0] * rng.uniform(9, 24) * _MM
    return hull(np.where(vertices[:, 2:] < rng.uniform(-12, 0) * _MM, [1.0, 1.0, 0.0], 1.0) * vertices)


def _capsule(rng: np.random.Generator) -> Triangles:
    vertices, length = _ball()[0] * rng.uniform(6, 18) * _MM, rng.uniform(4, 24) * _MM
    top = rng.uniform(0.4, 1.0) if rng.uniform() < 0.4 else 1.0  # a rounded cone where it is smaller
    return hull(np.vstack([vertices - [0, 0, length / 2], vertices * top + [0, 0, length / 2]]))


def _rounded_box(rng: np.random.Generator) -> Triangles:
    corners = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T * rng.uniform(2, 18, 3)
    ball = _ball(1)[0] * rng.uniform(1, 8)
    return hull((corners[:, None] + ball).reshape(-1, 3) * _MM)


def _blob(rng: np.random.Generator) -> Triangles:
    """A ball with smooth bumps."""
    vertices, faces = _ball()
    waves = rng.normal(size=(8, 3)) * rng.uniform(1, 4)
    bumps = np.sin(vertices @ waves.T + rng.uniform(0, 2 * np.pi, 8)).mean(axis=1)
    return vertices * (rng.uniform(10, 20) * np.exp(rng.uniform(0.2, 0.9) * bumps))[:, None] * _MM, faces


def _ring(rng: np.random.Generator) -> Triangles:
    tube, angles = rng.uniform(3, 9), np.linspace(0, 2 * np.pi, 20, endpoint=False)
    middle = tube * rng.uniform(1.1, 3.0)
    return _turned(np.column_stack([middle + tube * np.cos(angles), tube * np.sin(angles)]))


def _pipe(rng: np.random.Generator) -> Triangles:
    outer, half = rng.uniform(9, 24), rng.uniform(2, 24)
    inner = outer * rng.uniform(0.2, 0.9)
    return _turned(np.array([(outer, -half), (outer, half), (inner, half), (inner, -half)]))


def _cup(rng: np.random.Generator) -> Triangles:
    """A bowl, a cup or a vase: a wall about a hollow that is open at the top."""
    half, wall, steps = rng.uniform(6, 24), rng.uniform(1, 5), np.linspace(0, 1, 9)
    radii = rng.uniform(8, 22) * (1 + rng.uniform(-0.5, 0.5) * steps + rng.uniform(-0.3, 0.3) * np.sin(np.pi * steps))
    outside = np.column_stack([radii, half * (2 * steps - 1)])
    inside = np.column_stack([np.maximum(radii - wall, 0.5), np.maximum(outside[:, 1], wall - half)])[::-1]
    return _turned(np.vstack([[(0.0, -half)], outside, inside, [(0.0, wall - half)]]))


def _turned_part(rng: np.random.Generator) -> Triangles:
    """A solid of revolution with steps, grooves and cones, as from a lathe."""
    number = rng.integers(2, 7)
    heights = np.sort(rng.uniform(-1, 1, number)) * rng.uniform(8, 28)
    radii = rng.uniform(3, 22, number)
    if rng.uniform() < 0.5:  # steps instead of cones
        heights, radii = np.append(np.repeat(heights, 2)[1:], heights[-1] + 4.0), np.repeat(radii, 2)
    ends = [(0.0, heights[0])], [(0.0, heights[-1])]
    return _turned(np.vstack([ends[0], np.column_stack([radii, heights]), ends[1]]))


def _turned(profile: Floats) -> Triangles:
    """The surface of a closed profile of (radius, height) [mm], outside on its right, turned about z."""
    return turned(np.column_stack([profile * _MM, np.full(len(profile), 48)]), closed=True)


def _star(rng: np.random.Generator) -> Triangles:
    """An extruded outline about its middle: a cross, a gear, a cam, an ell."""
    number = rng.integers(5, 25)
    angles = 2 * np.pi * (np.arange(number) + rng.uniform(0, 0.9, number)) / number
    radii = rng.uniform(5, 24, number)
    if rng.uniform() < 0.4:
        teeth = rng.integers(3, 13)
        angles = 2 * np.pi * np.arange(4 * teeth) / (4 * teeth)
        radii = np.tile(np.repeat(rng.uniform(8, 22) * np.array([1.0, rng.uniform(0.5, 0.95)]), 2), teeth)
    half, size = rng.uniform(2, 22), len(radii)
    outline = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
    ends = [np.column_stack([np.vstack([outline, [0.0, 0.0]]), np.full(size + 1, z)]) for z in (-half, half)]
    here = np.arange(size)
    after, above = np.roll(here, -1), size + 1
    side = np.concatenate([np.stack([here, after, after + above], 1), np.stack([here, after + above, here + above], 1)])
    bottom = np.stack([after, here, np.full(size, size)], 1)
    top = np.stack([here, after, np.full(size, size)], 1) + above
    return np.vstack(ends) * _MM, np.concatenate([side, bottom, top])


@cache
def _ball(level: int = 3) -> Triangles:
    """A unit ball, from an icosahedron whose triangles are halved ``level`` times."""
    golden = (1 + 5**0.5) / 2
    points = np.array([(a, b * golden, 0.0) for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    vertices, faces = hull(np.vstack([points, np.roll(points, 1, axis=1), np.roll(points, 2, axis=1)]))
    for _ in range(level):
        middles = (vertices[faces] + vertices[np.roll(faces, -1, axis=1)]).reshape(-1, 3) / 2
        vertices = np.vstack([normalised(vertices), np.unique(np.round(normalised(middles), 9), axis=0)])
        vertices, faces = hull(normalised(vertices))
    return normalised(vertices), faces


_FAMILIES: tuple[Callable[[np.random.Generator], Triangles], ...]
_WEIGHTS = {
    _box: 5, _prism: 3, _pyramid: 2, _cylinder: 4, _cone: 3, _random_polytope: 3, _ellipsoid: 4, _half_ball: 1,
    _capsule: 2, _rounded_box: 3, _blob: 3, _ring: 2, _pipe: 2, _cup: 2, _turned_part: 3, _star: 2,
}  # fmt: skip
_FAMILIES = tuple(_WEIGHTS)
_SHARES = np.array(list(_WEIGHTS.values())) / sum(_WEIGHTS.values())


def _beside(part: Triangles, first: Triangles, rng: np.random.Generator) -> Triangles:
    """A part of another size, put where it overlaps the first."""
    vertices, faces = part
    if rng.uniform() < _ALIGNED:
        vertices = vertices[:, rng.permutation(3)] if rng.uniform() < 0.5 else vertices
    else:
        vertices = vertices @ to_matrix(random_orientation(rng)).T
    place = first[0][rng.integers(len(first[0]))] * rng.uniform(0.0, 1.0)
    if tetrahedra(vertices, faces).sum() < 0.0:  # two axes were exchanged
        faces = faces[:, ::-1]
    return vertices * rng.uniform(0.25, 0.9) + place, faces
