"""Random pads: what a reader that has to read any described pad learns from.

Layouts are wide on purpose: grids from 2 × 2 taxels to 64 × 64, square and long, with outlines and holes, hexagons,
places that lie on no grid, and curved tips, from 6 to 64 mm wide.
"""

from __future__ import annotations

import numpy as np

from activetouch.pad_file import PadDescription
from activetouch.perception.described_pads import RANGES
from activetouch.pressing.taxels import Taxels
from activetouch.solids.triangles import Floats, grid_centres
from belief.errors import InvalidArgument

_EDGES, _ACROSS, _FINEST_PITCH = (0.006, 0.064), (2.0, 64.0), 0.0004  # edge of a pad [m], taxels along it, distance [m]
_LONGEST = 5.0  # ratio of the edges
_FINEST = 64  # pixels of a raster; finer ones take long to press


def random_pad(rng: np.random.Generator) -> PadDescription:
    """A random pad, whose response has all of :data:`activetouch.perception.described_pads.RANGES`."""
    while True:
        try:
            taxels = _layout(rng)
            if taxels.raster <= _FINEST:
                break
        except InvalidArgument:  # taxels behind each other, or turned too far
            continue
    edge, least = 2 * taxels.half_width, _log_uniform(rng, 0.3, 6.0)
    dead: tuple[int, ...] = ()
    if rng.uniform() < 0.2 and len(taxels) > 8:
        dead = tuple(map(int, rng.choice(len(taxels), rng.integers(1, 1 + len(taxels) // 8), replace=False)))
    force = least, least * _log_uniform(rng, 1.0, 15.0)
    offset = min(0.012, edge * float(rng.choice([0.0, 0.08, rng.uniform(0.0, 0.25)])))
    return PadDescription(
        taxels,
        RANGES,
        force=force,
        offset=offset if offset > 2e-5 else 0.0,  # descriptions take smaller ones for metres
        max_depth=_log_uniform(rng, 0.001, 0.006),
        full_scale=_log_uniform(rng, 1e4, 1e6),
        is_relative=bool(rng.uniform() < 0.5),
        dead=dead,
    )


def _layout(rng: np.random.Generator) -> Taxels:
    edge, longer = _log_uniform(rng, *_EDGES), _log_uniform(rng, 1.0, _LONGEST)
    across = min(_log_uniform(rng, *_ACROSS), edge / _FINEST_PITCH)
    pitch, rows, columns = edge / round(across), round(across), max(1, round(across / longer))
    if rng.uniform() < 0.5:
        rows, columns = columns, rows
    places = grid_centres(rows, columns, pitch)[1:].T
    kind = rng.choice(["grid", "hexagons", "scattered"], p=[0.7, 0.2, 0.1])
    if kind == "hexagons":
        odd = np.arange(rows).repeat(columns) % 2
        places = (places + np.outer(odd - 0.5, [pitch / 2, 0.0])) * [1.0, np.sqrt(0.75)]
    elif kind == "scattered":
        places = places + rng.uniform(-0.25, 0.25, places.shape) * pitch
    places = places[_outline(rng, places, pitch)]
    centres, normals = _curved(rng, places - (places.max(axis=0) + places.min(axis=0)) / 2)
    share = rng.uniform(0.4, 1.0) if rng.uniform() < 0.3 else 1.0  # of the surface that is sensitive
    return Taxels(centres, normals, share * pitch**2)


def _outline(rng: np.random.Generator, places: Floats, pitch: float) -> np.ndarray:
    """Which places have a taxel: all, those within an ellipse or a half one, or all but some."""
    half = np.abs(places).max(axis=0) + pitch / 2
    there = np.ones(len(places), bool)
    match rng.choice(["all", "ellipse", "bullet", "holes"], p=[0.55, 0.15, 0.15, 0.15]):
        case "ellipse":
            there = ((places / half) ** 2).sum(axis=1) <= 1.05
        case "bullet":  # round at one end, as the pads of many fingers
            along, across = places[:, 1] / half[1], places[:, 0] / half[0]
            there = (along < 0.3) | (((along - 0.3) / 0.7) ** 2 + across**2 <= 1.05)
        case "holes":
            there = rng.uniform(size=len(places)) > rng.uniform(0.0, 0.25)
    return there if there.any() else np.ones(len(places), bool)


def _curved(rng: np.random.Generator, places: Floats) -> tuple[Floats, Floats]:
    """Centres and normals of taxels at places ``(N, 2)`` of a flat pad, a cylinder, or a ball."""
    if (kind := rng.choice(3, p=[0.75, 0.12, 0.13])) == 0:
        flat = np.column_stack([np.zeros(len(places)), places])
        return flat, np.tile([1.0, 0.0, 0.0], (len(places), 1))
    bent = places * ([[1.0, 0.0], [1.0, 1.0]][kind - 1] if rng.uniform() < 0.7 else [[0.0, 1.0], [1.0, 1.0]][kind - 1])
    away = np.linalg.norm(bent, axis=1)
    radius = max(away.max(), 1e-4) * rng.uniform(1.05, 3.0)
    normals = np.column_stack([np.sqrt(radius**2 - away**2), bent]) / radius
    return np.column_stack([radius * (normals[:, 0] - 1.0), places]), normals


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (max(high, low) / low) ** rng.uniform())
