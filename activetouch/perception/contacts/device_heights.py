"""Height maps of many bodies on a graphics processor: every pixel asks every triangle.

That is more arithmetic than :func:`activetouch.solids.raster.heights` does, and no scattered writes, so that a training
on a graphics processor does not wait for the maps.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import torch
from torch import Tensor

from activetouch.solids.raster import Surface

_SLACK = 1e-4  # distance by which triangles are widened [pixels]
_FLAT = 1e-6  # twice the area below which a triangle is seen from its side [pixels²]
_BLOCK = 512  # pixels per program
_NUMBERS = 16  # numbers per triangle, see _planes


class DeviceBodies:
    """Bodies whose triangles lie on a device."""

    def __init__(self, surfaces: Sequence[Surface], device: str) -> None:
        counts = np.array([surface.faces.shape[1] for surface in surfaces])
        corners = np.concatenate([surface.vertices[:, surface.faces].transpose(2, 1, 0) for surface in surfaces])
        self._corners = torch.from_numpy(corners.astype(np.float32)).to(device)  # (F, 3 corners, 3)
        self._counts, self._starts = counts, counts.cumsum() - counts
        self._device = device

    def heights(self, bodies: np.ndarray, turns: np.ndarray, places: np.ndarray, pixel: float, edge: int) -> Tensor:
        """Height maps as by :func:`activetouch.solids.raster.heights`, one body for each, ``(B, edge, edge)`` [m].

        ``bodies (B,)`` are indices, ``turns (B, 3, 3)`` rotation matrices times size factors, ``places (B, 2)`` the
        origins along y and z [m], and ``pixel`` is the edge of a pixel [m]. The maps are ``-inf`` beside a body.
        """
        counts = self._counts[bodies]
        ends = np.append(0, counts.cumsum())
        axes = turns[:, ::-1] * np.array([1 / pixel, 1 / pixel, -1.0])[:, None]  # row, column, height
        shift = np.concatenate([places[:, ::-1] / pixel + (edge - 1) / 2, np.zeros((len(bodies), 1))], axis=1)
        arrays = axes.astype(np.float32), shift.astype(np.float32), counts, ends, self._starts[bodies]
        turned, moved, each, starts, firsts = (torch.from_numpy(part).to(self._device) for part in arrays)
        owner = torch.repeat_interleave(each, output_size=int(ends[-1]))
        face = torch.arange(len(owner), device=self._device) + (firsts - starts[:-1])[owner]
        points = torch.einsum("fij,fcj->fci", turned[owner], self._corners[face]) + moved[owner][:, None]
        planes = _planes(points)
        return greatest(planes, starts.int(), edge)


def _planes(points: Tensor) -> Tensor:
    """Planes and bounds of triangles, ``(F, 16)``, from row, column and height of their corners, ``(F, 3, 3)``.

    They are three distances from the edges, positive inside, and the height, each as the slopes and the constant of a
    plane over row and column; then least and greatest height, least and greatest row.
    """
    row, column, height = points.unbind(2)
    ahead, behind = (1, 2, 0), (2, 0, 1)
    by_row, by_column = row[:, ahead] - row, column[:, ahead] - column
    area = by_row[:, 0] * by_column[:, 2] - by_row[:, 2] * by_column[:, 0]
    side = torch.where(area > 0, -1.0, 1.0)[:, None]
    length = torch.sqrt(by_row**2 + by_column**2).clamp_min(1e-9)
    slope_row, slope_column = side * -by_column / length, side * by_row / length
    constant = -(slope_row * row + slope_column * column)
    # Barycentric weights of the corners: the distance from the opposite edge by that of the corner.
    rise = slope_row * row[:, behind] + slope_column * column[:, behind] + constant
    weight = height[:, behind] / torch.where(rise.abs() < 1e-9, torch.inf, rise)
    level = [(weight * part).sum(dim=1) for part in (slope_row, slope_column, constant)]
    constant = torch.where((area.abs() < _FLAT)[:, None], -torch.inf, constant)  # nothing is inside
    rows = row.amin(dim=1), row.amax(dim=1)
    numbers = [slope_row[:, 0], slope_column[:, 0], constant[:, 0], slope_row[:, 1], slope_column[:, 1], constant[:, 1]]
    numbers += [slope_row[:, 2], slope_column[:, 2], constant[:, 2], *level, height.amin(dim=1), height.amax(dim=1)]
    return torch.stack([*numbers, *rows], dim=1)


def greatest(planes: Tensor, starts: Tensor, edge: int) -> Tensor:
    """Heights of the greatest of a map's triangles at each pixel, on a graphics processor; see :func:`_planes`."""
    maps = torch.empty((len(starts) - 1, edge, edge), device=planes.device)
    grid = (len(maps), -(-(edge**2) // _BLOCK))
    _kernel()[grid](planes, starts, maps, edge, edge**2, _SLACK, _BLOCK, _NUMBERS)
    return maps


@cache
def _kernel() -> Any:
    """The kernel in Triton, which comes with torch for CUDA; one program computes a block of pixels of a map."""
    import triton
    import triton.language as tl

    def greatest(planes, starts, maps, edge, pixels, slack, block: tl.constexpr, numbers: tl.constexpr):  # type: ignore
        number = tl.program_id(0)
        pixel = tl.program_id(1) * block + tl.arange(0, block)
        row, column = (pixel // edge).to(tl.float32), (pixel % edge).to(tl.float32)
        top, bottom = tl.program_id(1) * block // edge, (tl.program_id(1) * block + block - 1) // edge
        found = tl.full((block,), float("-inf"), tl.float32)
        for triangle in range(tl.load(starts + number), tl.load(starts + number + 1)):
            at = planes + triangle * numbers
            if (tl.load(at + 15) >= top - 1) & (tl.load(at + 14) <= bottom + 1):
                first = tl.load(at) * row + tl.load(at + 1) * column + tl.load(at + 2)
                second = tl.load(at + 3) * row + tl.load(at + 4) * column + tl.load(at + 5)
                third = tl.load(at + 6) * row + tl.load(at + 7) * column + tl.load(at + 8)
                height = tl.load(at + 9) * row + tl.load(at + 10) * column + tl.load(at + 11)
                height = tl.minimum(tl.maximum(height, tl.load(at + 12)), tl.load(at + 13))
                inside = tl.minimum(tl.minimum(first, second), third) >= -slack
                found = tl.maximum(found, tl.where(inside, height, float("-inf")))
        tl.store(maps + number * pixels + pixel, found, mask=pixel < pixels)

    return triton.jit(greatest)
