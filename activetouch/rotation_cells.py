"""Nested cells of all orientations, and evenly spread views: from which side and at which roll a body is seen.

The eight cubes of a tesseract cover the sphere of unit quaternions; up to sign there are four. Each cube is a grid of
3³ cells, each cell has 2³ parts, and so on: 108, 864, 6 912, 55 296 and 442 368 cells with edges of about 52°, 26°,
13°, 6.5° and 3.2°.

>>> [len(centres(level)) for level in range(3)]
[108, 864, 6912]
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.distributions import Floats
from activetouch.poses import facing, hamilton_product, normalised, turn
from activetouch.solids.solid import on_spiral
from belief.coarse_to_fine import NestedCells
from belief.validation import MOST_REPEATED, require_count, require_index

LEVELS = 5
"""Levels of cells."""
_COARSEST = 3  # cells along the edge of a cube


@lru_cache(maxsize=LEVELS)
def _grid(level: int) -> tuple[Floats, Floats]:
    """Centres of the cells of a level, ``(N, 4)``, and their density, which is the same in all four cubes."""
    require_index("level", level, LEVELS)
    corners = np.stack(np.meshgrid(*[np.arange(_COARSEST)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    halves = np.stack(np.meshgrid(*[np.arange(2)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for _ in range(level):
        corners = (2 * corners[:, None] + halves).reshape(-1, 3)
    places = (corners + 0.5) / (_COARSEST * 2**level) * 2.0 - 1.0
    points = np.tan(places * (math.pi / 4))  # at equal angles from the middle of the cube
    density = (1.0 + points**2).prod(axis=1) / (1.0 + (points**2).sum(axis=1)) ** 2
    first = normalised(np.column_stack([np.ones(len(points)), points]))
    cubes = [np.stack(hamilton_product(unit, first.T), axis=1) for unit in np.eye(4)]
    return np.concatenate(cubes), np.tile(density, 4)


def centres(level: int) -> Floats:
    """Orientations in the middle of the cells of a level, unit quaternions ``wxyz``, ``(N, 4)``."""
    return _grid(level)[0]


@lru_cache(maxsize=2 * LEVELS)
def nested(levels: tuple[int, ...]) -> NestedCells:
    """Cells of some levels, coarse first, with the share of all orientations that lies in each.

    >>> [len(shares) for shares in nested((0, 2)).shares]
    [108, 6912]
    """
    shares = _grid(levels[-1])[1]
    shares = shares / shares.sum()
    return NestedCells(tuple(shares.reshape(len(_grid(level)[1]), -1).sum(axis=1) for level in levels))


@lru_cache(maxsize=8)
def views(directions: int, rolls: int) -> Floats:
    """Orientations that show a body from evenly spread sides at even rolls about the approach axis, ``(V, 4)``.

    View d R + r is direction d at roll r, of D directions and R rolls, a multiple of 4. A quarter of the rolls differ
    by less than 90°: the others show the same height maps, turned by quarters.
    """
    require_count("directions", directions, most=MOST_REPEATED)
    require_count("rolls / 4", rolls / 4 if rolls % 4 else rolls // 4, most=MOST_REPEATED)
    sides = on_spiral(1.0 - 2.0 * (np.arange(directions) + 0.5) / directions)
    faced = np.array([facing(side) for side in sides])
    rolled = np.array([turn("x", 2 * math.pi * roll / rolls) for roll in range(rolls)])
    return np.stack(hamilton_product(rolled.T[:, None, :], faced.T[:, :, None]), axis=-1).reshape(-1, 4)


def nearest(orientations: Floats, found: Floats) -> NDArray[np.int64]:
    """Index of the nearest of other orientations ``(m, 4)`` for each orientation ``(n, 4)``; q and -q are the same."""
    tree = scipy.spatial.cKDTree(np.concatenate([found, -found]))
    return np.asarray(tree.query(orientations)[1] % len(found))
