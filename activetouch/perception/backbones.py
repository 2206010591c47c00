"""The networks a classifier may be made of, by name; reading the table loads no torch.

To add one, write a frozen dataclass with the members of :class:`SmallCNN` and a line in :data:`BACKBONES`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import nn


class _OfWidths:
    """A network by its channels, the last of which are the features."""

    widths: tuple[int, ...]

    @property
    def num_features(self) -> int:
        """Length of a feature vector."""
        return self.widths[-1]


@dataclass(frozen=True)
class ConvNeXt(_OfWidths):
    """A ConvNeXt (Liu et al. 2022; Woo et al. 2023 below Tiny): number of blocks and of channels of each stage."""

    depths: tuple[int, ...]
    widths: tuple[int, ...]

    @property
    def smallest_image(self) -> int:
        """Edge of the smallest image [pixels]: a patch of the first layer is 4 wide, and every further stage halves."""
        return 4 * 2 ** (len(self.depths) - 1)

    def build(self, channels: int) -> nn.Module:
        """The network with random weights: from images ``(B, channels, H, W)`` to features ``(B, num_features)``."""
        from activetouch.perception.convnext import ConvNeXtFeatures  # loads transformers

        return ConvNeXtFeatures(self.depths, self.widths, channels)


@dataclass(frozen=True)
class SmallCNN(_OfWidths):
    """Convolutions 3 × 3 of stride 2 with ReLU, then means over the cells of a grid: the cheap reference.

    Nothing is normalised: statistics over a batch differ too much between batches of small spots on an empty pad, and
    those over an image would hide how strong the contact is. A dense layer joins the ``cells`` × ``cells`` means. With
    one cell, a network hardly knows where on the pad it was touched. ``widths`` are channels after each convolution.
    """

    widths: tuple[int, ...]
    cells: int = 1

    @property
    def smallest_image(self) -> int:
        """Edge of the smallest image [pixels]: a pixel of the last layer for each cell."""
        return (self.cells - 1) * 2 ** len(self.widths) + 1

    def build(self, channels: int) -> nn.Module:
        """The network with random weights: from images ``(B, channels, H, W)`` to features ``(B, num_features)``."""
        from torch import nn

        layers: list[nn.Module] = []
        for width_in, width_out in zip((channels, *self.widths), self.widths, strict=False):
            convolution = nn.Conv2d(width_in, width_out, kernel_size=3, stride=2, padding=1)
            nn.init.kaiming_normal_(convolution.weight, nonlinearity="relu")
            assert convolution.bias is not None, "a convolution has one by default"
            nn.init.zeros_(convolution.bias)
            layers += [convolution, nn.ReLU()]
        layers += [nn.AdaptiveAvgPool2d(self.cells), nn.Flatten()]
        if self.cells > 1:
            layers += [nn.Linear(self.cells**2 * self.widths[-1], self.widths[-1]), nn.ReLU()]
        return nn.Sequential(*layers)


@dataclass(frozen=True)
class GridConvNeXt(_OfWidths):
    """A ConvNeXt of a few blocks, a dense layer of whose cells joins what is felt where on the pad.

    Stages halve the image, with ``widths`` channels; the last of ``widths`` is the length of the features.
    """

    widths: tuple[int, ...]

    @property
    def smallest_image(self) -> int:
        """Edge of the smallest image [pixels]: one for each cell after the last stage."""
        from activetouch.perception.small_convnext import CELLS

        return (CELLS - 1) * 2 ** (len(self.widths) - 1) + 1

    def build(self, channels: int) -> nn.Module:
        """The network with random weights: from images ``(B, channels, H, W)`` to features ``(B, num_features)``."""
        from torch import nn

        from activetouch.perception.small_convnext import CELLS, SmallConvNeXt

        *stages, num_features = self.widths
        dense = nn.Linear(stages[-1] * CELLS**2, num_features)
        return nn.Sequential(SmallConvNeXt(channels, tuple(stages)), dense, nn.GELU())


BACKBONES: Mapping[str, ConvNeXt | SmallCNN | GridConvNeXt] = MappingProxyType(
    {
        "cnn": SmallCNN((24, 48, 96, 128)),
        "grid_cnn": SmallCNN((24, 48, 96, 128), cells=2),
        "grid_convnext": GridConvNeXt((24, 48, 96, 128)),
        "atto": ConvNeXt((2, 2, 6, 2), (40, 80, 160, 320)),
        "tiny": ConvNeXt((3, 3, 9, 3), (96, 192, 384, 768)),
    }
)
"""Every backbone by name."""
