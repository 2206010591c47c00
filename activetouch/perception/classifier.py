"""The networks of a classifier in torch, for training; a sensor has a reader in their place.

With the embedding f(o) of an image and g(k, R, s) of a hypothesis about its object, f(o) · g(k, R, s) is the log ratio
log p(o | k, R, s) / p(o), up to a constant of the image. :mod:`activetouch.perception.export` and
:mod:`activetouch.perception.reader` compute the same without torch.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from activetouch.perception.backbones import BACKBONES
from activetouch.perception.card import PRODUCTS, ClassifierCard
from activetouch.perception.reader import Reading, require_stack
from activetouch.poses import hamilton_product, matrix_rows
from belief.errors import InvalidArgument

HIDDEN_LAYERS = 3
WIDTH = 256


class Hypotheses(NamedTuple):
    """H hypotheses: shapes ``(H,)``, orientations ``(H, 4)`` (``wxyz``, object to pad), and relative sizes ``(H,)``."""

    shapes: Tensor
    orientations: Tensor
    sizes: Tensor

    def select(self, rows: Tensor | slice) -> Hypotheses:
        """The hypotheses with these indices."""
        return Hypotheses(*(column[rows] for column in self))

    def join(self, *others: Hypotheses) -> Hypotheses:
        """These hypotheses, then all ``others``."""
        return Hypotheses(*(torch.cat(columns) for columns in zip(self, *others, strict=True)))


class HypothesisNetwork(nn.ModuleList):
    """A residual network (He et al. 2016; Xiong et al. 2020) with GELU after every layer but the last, to ``(H, D)``.

    Its inputs are the one-hot shape, the rotation matrix, the standardised log size, and all products of two entries of
    the matrix: a plain perceptron on the matrix alone learns sharp functions of the rotation slowly (Rahaman et al.
    2019; decision 0063). Hidden layers but the first read normalised numbers, and add to them.
    """

    def __init__(self, card: ClassifierCard) -> None:
        widths = [card.num_inputs, *[WIDTH] * HIDDEN_LAYERS, card.embedding]
        super().__init__(nn.Linear(*pair) for pair in pairwise(widths))
        self.card = card

    def forward(self, hypotheses: Hypotheses) -> Tensor:
        """Embeddings ``(H, D)``."""
        card, rows = self.card, matrix_rows(hypotheses.orientations.unbind(1))
        rotations = torch.stack([entry for row in rows for entry in row], dim=1)
        kinds = nn.functional.one_hot(hypotheses.shapes, len(card.shape_labels)).float()
        log_sizes = (hypotheses.sizes.log() - card.log_size_mean) / card.log_size_std
        left, right = map(torch.from_numpy, PRODUCTS)
        columns = [kinds, rotations, log_sizes[:, None], rotations[:, left] * rotations[:, right]]
        first, *middle, last = self
        hidden = nn.functional.gelu(first(torch.cat(columns, dim=1).float()))
        for layer in middle:
            hidden = hidden + nn.functional.gelu(layer(nn.functional.layer_norm(hidden, hidden.shape[1:])))
        return last(hidden)


def compose(left: Tensor, right: Tensor) -> Tensor:
    """The rotations ``right`` followed by ``left``, unit quaternions ``wxyz`` ``(H, 4)`` (Hamilton product)."""
    return torch.stack(hamilton_product(left.unbind(-1), right.unbind(-1)), dim=-1)


class TouchNetwork(nn.Module):
    """A backbone on tactile images with a head for logits, or for embeddings, with a part ``hypotheses``."""

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
        """Logits ``(B, K)`` or embeddings ``(B, D)``, and features ``(B, F)``, of uint8 images ``(B, H, W[, 3])``."""
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
    """A trained network in evaluation mode, ready to read touches."""

    def __init__(self, card: ClassifierCard, network: TouchNetwork) -> None:
        self.card = card
        self.network = network.eval().to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch lacks it

    @torch.inference_mode()
    def read(self, images: NDArray[np.uint8], batch_size: int = 64) -> Reading:
        """Logits, features and labels of uint8 images ``(N, H, W)`` or ``(N, H, W, 3)``."""
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
