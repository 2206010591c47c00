"""The networks a classifier may be made of, by name; reading the table loads no torch.

To add one, write a frozen dataclass with the members of :class:`Backbone` and a line in :data:`BACKBONES`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from torch import nn


class Backbone(Protocol):
    """From images ``(B, channels, H, W)``, centred and scaled, to features ``(B, num_features)``."""

    @property
    def num_features(self) -> int:
        """Length of a feature vector."""

    @property
    def smallest_image(self) -> int:
        """Edge of the smallest image that it takes [pixels]."""

    def build(self, channels: int) -> nn.Module:
        """The network with random weights, drawn from torch's global generator."""


@dataclass(frozen=True)
class ConvNeXt:
    """A ConvNeXt (Liu et al. 2022; Woo et al. 2023 for the sizes below Tiny).

    Attributes:
        depths: blocks of each stage.
        widths: channels of each stage.
    """

    depths: tuple[int, ...]
    widths: tuple[int, ...]

    @property
    def num_features(self) -> int:
        """See :class:`Backbone`."""
        return self.widths[-1]

    @property
    def smallest_image(self) -> int:
        """See :class:`Backbone`: a patch of the first layer is 4 pixels wide, and every further stage halves."""
        return 4 * 2 ** (len(self.depths) - 1)

    def build(self, channels: int) -> nn.Module:
        """See :class:`Backbone`."""
        from activetouch.perception.convnext import ConvNeXtFeatures  # loads transformers

        return ConvNeXtFeatures(self.depths, self.widths, channels)

    def build_pretrained(self, source: Path | str, channels: int) -> nn.Module:
        """The network with weights from elsewhere: a local folder, or a name on the Hugging Face hub.

        Raises:
            MissingWeights: they are not to be had, or belong to another network.
        """
        from activetouch.perception.convnext import pretrained

        return pretrained(source, self.depths, self.widths, channels)


@dataclass(frozen=True)
class SmallCNN:
    """Plain 3 × 3 convolutions, each halving the image, then means over it: the cheap reference.

    Attributes:
        widths: channels after each convolution.
        cells: means are over each cell of a grid of so many cells along the edge, and a dense layer joins them. With
            one cell, the mean over the image, a network hardly knows where on the pad it was touched.
    """

    widths: tuple[int, ...]
    cells: int = 1

    @property
    def num_features(self) -> int:
        """See :class:`Backbone`."""
        return self.widths[-1]

    @property
    def smallest_image(self) -> int:
        """See :class:`Backbone`: a pixel of the last layer for each cell."""
        return (self.cells - 1) * 2 ** len(self.widths) + 1

    def build(self, channels: int) -> nn.Module:
        """See :class:`Backbone`."""
        from activetouch.perception.small_cnn import small_cnn

        return small_cnn(self.widths, channels, self.cells)


BACKBONES: Mapping[str, Backbone] = MappingProxyType(
    {
        "cnn": SmallCNN((24, 48, 96, 128)),
        "wide_cnn": SmallCNN((32, 64, 128, 192)),
        "grid_cnn": SmallCNN((24, 48, 96, 128), cells=2),
        "micro": ConvNeXt((3, 3), (64, 128)),  # two stages, for sensors of few taxels
        "atto": ConvNeXt((2, 2, 6, 2), (40, 80, 160, 320)),
        "femto": ConvNeXt((2, 2, 6, 2), (48, 96, 192, 384)),
        "pico": ConvNeXt((2, 2, 6, 2), (64, 128, 256, 512)),
        "nano": ConvNeXt((2, 2, 8, 2), (80, 160, 320, 640)),
        "tiny": ConvNeXt((3, 3, 9, 3), (96, 192, 384, 768)),
    }
)
"""Every backbone by name."""
