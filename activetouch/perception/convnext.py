"""ConvNeXt as a feature extractor, from ``transformers``."""

from __future__ import annotations

from torch import Tensor
from transformers import ConvNextConfig, ConvNextModel


class ConvNeXtFeatures(ConvNextModel):
    """Pooled, normalised features ``(B, widths[-1])`` of images ``(B, channels, H, W)``."""

    def __init__(self, depths: tuple[int, ...], widths: tuple[int, ...], channels: int) -> None:
        stages, hidden = list(depths), list(widths)
        super().__init__(
            ConvNextConfig(num_channels=channels, num_stages=len(stages), depths=stages, hidden_sizes=hidden)
        )

    def forward(self, images: Tensor) -> Tensor:
        """See the class."""
        return super().forward(images).pooler_output
