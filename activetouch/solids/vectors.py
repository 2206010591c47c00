"""Arrays of points, and directions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Triangles = tuple[Floats, Ints]
"""Vertices ``(v, 3)`` [m] and triangles ``(f, 3)``, counter-clockwise from outside."""


def on_spiral(heights: Floats) -> Floats:
    """Unit vectors of these heights along z, turned by the golden angle from one to the next, ``(n, 3)``."""
    angle, radius = np.pi * (1.0 + np.sqrt(5.0)) * (np.arange(len(heights)) + 0.5), np.sqrt(1.0 - heights**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), heights])


def frame_across(direction: Floats) -> Floats:
    """Unit vectors x and y that form a right-handed frame with z = −direction, ``(2, 3)``."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(x, direction)])


def grid_centres(rows: int, columns: int, pitch: float) -> Floats:
    """Centres of a flat grid about the approach axis, ``(3, rows · columns)`` [m]: rows along z, columns along y."""
    edges = [((np.arange(n) + 0.5) / n * 2 - 1) * (n * pitch / 2) for n in (rows, columns)]
    z, y = np.meshgrid(*edges, indexing="ij")
    return np.stack([np.zeros(z.size), y.ravel(), z.ravel()])
