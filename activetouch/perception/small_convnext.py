"""A small ConvNeXt, which keeps where on the pad a contact is."""

from __future__ import annotations

import torch
from torch import Tensor, nn

CELLS = 4
"""Cells along the edge of an image, over which the last convolution is averaged."""


class SmallConvNeXt(nn.Module):
    """A small ConvNeXt (Liu et al. 2022) of images ``(B, C, n, n)``.

    Each of the ``widths`` is a stage: a convolution that halves the image, and a block, but for the first. It gives the
    means over the cells of a grid, ``(B, widths[-1] · 16)``.
    """

    def __init__(self, channels: int, widths: tuple[int, ...]) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for width_in, width_out in zip((channels, *widths), widths, strict=False):
            layers.append(nn.Conv2d(width_in, width_out, 3, stride=2, padding=1))
            layers.append(_Block(width_out) if layers[1:] else nn.GELU())
        self.layers = nn.Sequential(*layers, Averages(), nn.Flatten())

    def forward(self, images: Tensor) -> Tensor:
        """See the class."""
        found: Tensor = self.layers(images)
        return found


class _Block(nn.Module):
    """A block of a ConvNeXt: a convolution of each channel, then dense layers over the channels, as a shortcut."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.spatial = nn.Conv2d(width, width, 5, padding=2, groups=width)
        self.norm = nn.LayerNorm(width)
        self.wide, self.narrow = nn.Linear(width, 4 * width), nn.Linear(4 * width, width)

    def forward(self, x: Tensor) -> Tensor:
        seen = self.norm(self.spatial(x).permute(0, 2, 3, 1))
        found = self.narrow(nn.functional.gelu(self.wide(seen.flatten(0, 2))))
        return x + found.view(seen.shape).permute(0, 3, 1, 2)


class Averages(nn.Module):
    """Averages over the cells of a grid, as ``nn.AdaptiveAvgPool2d``, which has no operator in ONNX."""

    def forward(self, x: Tensor) -> Tensor:
        """Means ``(B, C, CELLS, CELLS)`` of ``(B, C, n, n)``."""
        if x.shape[-2:] == (CELLS, CELLS):
            return x
        rows, columns = (_shares(edge, x) for edge in x.shape[-2:])
        return rows @ x @ columns.T


def _shares(edge: int, like: Tensor) -> Tensor:
    """The matrix that averages an axis of ``edge`` pixels over cells, ``(CELLS, edge)``."""
    found = torch.zeros(CELLS, edge)
    for cell in range(CELLS):
        first, last = cell * edge // CELLS, -(-(cell + 1) * edge // CELLS)
        found[cell, first:last] = 1 / (last - first)
    return found.to(like)
