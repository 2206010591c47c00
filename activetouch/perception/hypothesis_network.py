"""The network g(shape, rotation, size) that embeds a hypothesis about an object, in torch, for training.

With the embedding f(o) of an image, f(o) · g(k, R, s) is the log ratio log p(o | k, R, s) / p(o), up to a constant of
the image. :mod:`activetouch.perception.hypothesis_embedding` computes the same network without torch.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from activetouch.poses import hamilton_product, matrix_rows

WIDTH, HIDDEN_LAYERS = 192, 3


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

    def join(self, others: Hypotheses) -> Hypotheses:
        """These, then ``others``."""
        return Hypotheses(*(torch.cat(columns) for columns in zip(self, others, strict=True)))


class HypothesisNetwork(nn.Sequential):
    """A multilayer perceptron with GELU from (one-hot shape, rotation matrix, standardised log size) to ``(H, D)``.

    Args:
        num_shapes: how many shapes there are.
        embedding: length D of an embedding.
        log_size_mean: mean of log size over the training touches.
        log_size_std: its standard deviation.
    """

    def __init__(self, num_shapes: int, embedding: int, log_size_mean: float, log_size_std: float) -> None:
        layers: list[nn.Module] = []
        width = num_shapes + 10
        for _ in range(HIDDEN_LAYERS):
            layers += [nn.Linear(width, WIDTH), nn.GELU()]
            width = WIDTH
        super().__init__(*layers, nn.Linear(width, embedding))
        self.num_shapes, self.log_size_mean, self.log_size_std = num_shapes, log_size_mean, log_size_std

    def forward(self, hypotheses: Hypotheses) -> Tensor:
        """Embeddings ``(H, D)``."""
        kinds = nn.functional.one_hot(hypotheses.shapes, self.num_shapes).float()
        log_sizes = (hypotheses.sizes.log() - self.log_size_mean) / self.log_size_std
        columns = [kinds, rotation_matrices(hypotheses.orientations).flatten(1), log_sizes[:, None]]
        return super().forward(torch.cat(columns, dim=1).float())


def rotation_matrices(quaternions: Tensor) -> Tensor:
    """Rotation matrices ``(H, 3, 3)`` of unit quaternions ``wxyz``."""
    rows = matrix_rows(quaternions.unbind(1))
    return torch.stack([entry for row in rows for entry in row], dim=1).reshape(-1, 3, 3)


def compose(left: Tensor, right: Tensor) -> Tensor:
    """The rotations ``right`` followed by ``left``, unit quaternions ``wxyz`` ``(H, 4)`` (Hamilton product)."""
    return torch.stack(hamilton_product(left.unbind(-1), right.unbind(-1)), dim=-1)
