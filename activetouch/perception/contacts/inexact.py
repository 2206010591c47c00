"""Objects that differ from their files: scanned, simplified or worn surfaces, as a set of bodies is fitted to."""

from __future__ import annotations

import warnings

import numpy as np

from activetouch.errors import MeshWarning
from activetouch.solids.mesh import Mesh
from activetouch.solids.solid import Shape
from activetouch.solids.triangles import Triangles

USUAL = 0.01
"""Tolerance by default, in radii of a body."""
_CORRELATION = 1 / 6  # length over which the error of a surface is alike, in radii
_WAVES = 48
_MOST_FACES = 12_000


def inexact(solid: Shape, tolerance: float | None, rng: np.random.Generator) -> Shape:
    """A solid whose surface is displaced by smooth noise and that is off its centre.

    Args:
        solid: the exact one; its triangles are divided until they can follow the noise.
        tolerance: standard deviation of the displacement of the surface, and of the centre, along each axis [m]; None
            for 1 % of the radius, 0 for the solid itself.
        rng: generator of the noise.
    """
    radius = float(np.linalg.norm(solid.surface.vertices, axis=0).max())
    size = USUAL * radius if tolerance is None else tolerance
    if size == 0.0:
        return solid
    length = _CORRELATION * radius
    vertices, faces = _divided((solid.surface.vertices.T, solid.surface.faces.T), length)
    waves, phases = rng.normal(size=(_WAVES, 3)) / length, rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    shares = rng.normal(size=(_WAVES, 3)) * np.sqrt(2.0 / _WAVES)
    noise = np.cos(vertices @ waves.T + phases) @ shares
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)  # the user was told when the file was read
        return Mesh("inexact", vertices + size * (noise + rng.normal(size=3)), faces)


def _divided(triangles: Triangles, longest: float) -> Triangles:
    """Triangles divided in four, all alike so that no crack opens, until most edges are short or there are many."""
    vertices, faces = triangles
    while 4 * len(faces) <= _MOST_FACES:
        pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        if np.quantile(np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1), 0.9) < longest:
            break
        edges, places = np.unique(pairs, axis=0, return_inverse=True)
        a, b, c = faces.T
        ab, bc, ca = (len(vertices) + places.reshape(-1, 3)).T
        faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
    return vertices, faces
