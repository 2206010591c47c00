"""The network g(shape, rotation, size) that embeds a hypothesis about an object, in torch, for training.

With the embedding f(o) of an image, f(o) · g(k, R, s) is the log ratio log p(o | k, R, s) / p(o), up to a
constant of the image. :mod:`activetouch.perception.hypothesis_embedding` computes the same network without torch.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn

from activetouch.perception.card import PRODUCTS, ClassifierCard
from activetouch.poses import hamilton_product, matrix_rows

HIDDEN_LAYERS = 3
WIDTH = 256


class Hypotheses(NamedTuple):
    """H hypotheses about the object that was touched.

    Attributes:
        shapes: indices, ``(H,)``.
        orientations: unit quaternions ``wxyz`` from the object's frame to the pad's, ``(H, 4)``.
        sizes: relative to the nominal size, ``(H,)``.
    """

    shapes: Tensor
    orientations: Tensor
    sizes: Tensor

    def select(self, rows: Tensor | slice) -> Hypotheses:
        """Some of them, by index."""
        return Hypotheses(*(column[rows] for column in self))

    def join(self, *others: Hypotheses) -> Hypotheses:
        """These, then all ``others``."""
        return Hypotheses(*(torch.cat(columns) for columns in zip(self, *others, strict=True)))


class HypothesisNetwork(nn.ModuleList):
    """A residual network (He et al. 2016; Xiong et al. 2020) with GELU after every layer but the last, to ``(H, D)``.

    Its inputs are the one-hot shape, the rotation matrix, the standardised log size, and all products of two entries of
    the rotation matrix. Hidden layers but the first read
    normalised numbers, and add to them. A plain perceptron on the matrix alone learns sharp functions of the rotation
    slowly (Rahaman et al. 2019; decision 0063).

    Args:
        card: says which shapes there are, the length D of an embedding, and how to standardise.
    """

    def __init__(self, card: ClassifierCard) -> None:
        widths = [card.num_inputs, *[WIDTH] * HIDDEN_LAYERS, card.embedding]
        super().__init__(nn.Linear(*pair) for pair in pairwise(widths))
        self.card = card

    def forward(self, hypotheses: Hypotheses) -> Tensor:
        """Embeddings ``(H, D)``."""
        card, rotations = self.card, rotation_matrices(hypotheses.orientations).flatten(1)
        kinds = nn.functional.one_hot(hypotheses.shapes, len(card.shape_labels)).float()
        log_sizes = (hypotheses.sizes.log() - card.log_size_mean) / card.log_size_std
        columns = [kinds, rotations, log_sizes[:, None]]
        left, right = map(torch.from_numpy, PRODUCTS)
        columns.append(rotations[:, left] * rotations[:, right])
        first, *middle, last = self
        hidden = nn.functional.gelu(first(torch.cat(columns, dim=1).float()))
        for layer in middle:
            hidden = hidden + nn.functional.gelu(layer(nn.functional.layer_norm(hidden, hidden.shape[1:])))
        return last(hidden)


def rotation_matrices(quaternions: Tensor) -> Tensor:
    """Rotation matrices ``(H, 3, 3)`` of unit quaternions ``wxyz``."""
    rows = matrix_rows(quaternions.unbind(1))
    return torch.stack([entry for row in rows for entry in row], dim=1).reshape(-1, 3, 3)


def compose(left: Tensor, right: Tensor) -> Tensor:
    """The rotations ``right`` followed by ``left``, unit quaternions ``wxyz`` ``(H, 4)`` (Hamilton product)."""
    return torch.stack(hamilton_product(left.unbind(-1), right.unbind(-1)), dim=-1)
