"""The network that reads a tactile image, in torch; a sensor has a reader in its place.

See :mod:`activetouch.perception.export`.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from activetouch.errors import TrainingDiverged
from activetouch.perception.backbones import BACKBONES
from activetouch.perception.card import ClassifierCard
from activetouch.perception.hypothesis_network import HypothesisNetwork
from activetouch.perception.reader import Reading, require_stack
from belief.errors import InvalidArgument


class TouchNetwork(nn.Module):
    """A backbone on tactile images, grey or in colour, with a head.

    The head gives logits of the shapes, or, where the card has an embedding, the embedding f of the image; the
    network then has a second part, ``hypotheses``, which embeds hypotheses about the object.

    Args:
        card: which backbone, for which images and shapes.
    """

    def __init__(self, card: ClassifierCard) -> None:
        super().__init__()
        kind = BACKBONES[card.backbone]
        self.card = card
        self.backbone = kind.build(card.channels)
        width, num_shapes = kind.num_features, len(card.shape_labels)
        self.head: nn.Module
        if card.embedding:
            self.head = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, card.embedding))
            self.hypotheses = HypothesisNetwork(card)
        else:
            self.head = nn.Linear(width, num_shapes)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Logits ``(B, K)`` or embeddings ``(B, D)``, and features ``(B, F)``.

        Args:
            images: uint8, ``(B, H, W)`` or ``(B, H, W, channels)``.
        """
        if images.ndim == 3:
            images = images.unsqueeze(-1)
        if images.shape[-1] != self.card.channels:
            raise ValueError(f"the network reads images of {self.card.channels} channels, got {images.shape[-1]}")
        pixels = images.permute(0, 3, 1, 2).float() / 255.0
        found, wanted = pixels.shape[-1], self.card.input_size
        if found % wanted == 0:
            pixels = nn.functional.avg_pool2d(pixels, found // wanted) if found > wanted else pixels
        elif wanted % found == 0:
            pixels = nn.functional.interpolate(pixels, scale_factor=wanted // found, mode="nearest")
        else:
            raise ValueError(
                f"input_size {wanted} is no multiple of the images' {found} pixels, nor the other way round"
            )
        pixels = (pixels - self.card.pixel_mean) / self.card.pixel_std
        pixels = pixels.to(next(self.backbone.parameters()).dtype, memory_format=torch.channels_last)
        features = self.backbone(pixels).float()
        return self.head(features), features


class TouchClassifier:
    """A trained network, ready to read touches.

    Attributes:
        card: what it was trained for.
        network: the torch module, in evaluation mode.
    """

    def __init__(self, card: ClassifierCard, network: TouchNetwork) -> None:
        self.card = card
        self.network = network.eval().to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch lacks it

    @torch.inference_mode()
    def read(self, images: NDArray[np.uint8], batch_size: int = 64) -> Reading:
        """Logits, features and labels of uint8 images ``(N, H, W)`` or ``(N, H, W, 3)``.

        Raises:
            InvalidArgument: the network embeds images, and gives no logits without hypotheses.
            ValueError: there are no images, or they are something else.
        """
        require_stack(images)
        if self.card.knows_orientations:
            raise InvalidArgument(
                "this network embeds images, and tells shapes only with hypotheses: read with the reader that training "
                "wrote beside it, or train a plain classifier (--recipe large)"
            )
        parts = [
            self.network(torch.from_numpy(images[first : first + batch_size]))
            for first in range(0, len(images), batch_size)
        ]
        logits, features = (torch.cat(column).float().numpy() for column in zip(*parts, strict=True))
        return Reading(logits.astype(np.float64), features, features)


def half_weights(network: nn.Module) -> dict[str, NDArray[np.float16]]:
    """The weights of a network by name, in half precision.

    Raises:
        TrainingDiverged: a weight is too large for half precision, or not finite.
    """
    tensors = {name: value.half().numpy() for name, value in network.state_dict().items()}
    for name, value in tensors.items():
        if not np.isfinite(value).all():
            raise TrainingDiverged(
                f"the weights {name} are not finite in half precision. Train again, in another folder, with a lower "
                "--change.learning-rate"
            )
    return tensors
