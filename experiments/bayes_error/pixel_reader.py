"""A reader of force-patch images that looks at every pixel: what do *images* tell, beside the numbers behind them?

An image is drawn from a few numbers (:mod:`experiments.bayes_error.press_features`), but need not show them all: what
moves the edge of a disc by a tenth of a pixel hardly shows. So readers of the numbers bound readers of the images from
above only. This one bounds them from below. It sees what there is to see: the pixels around the spot, not resized, how
bright they are together, and to a fraction of a pixel where the spot lies. As turned and mirrored presses are as
likely, the spot is turned and mirrored into one eighth of the pad first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from activetouch.rendering import ForcePatchRenderer

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]

REACH = 18
"""Pixels to every side of a spot's centre; a disc of 2 N, with its smooth edge, fits on a pad of 128 taxels."""
PLACE = 5
"""How many numbers follow the pixels: along, across, their fractions of a pixel, brightness."""
_AT_ONCE = 500


def close_ups(images: NDArray[np.uint8], renderer: ForcePatchRenderer) -> Floats:
    """What the reader sees of each image.

    Args:
        images: force patches, ``(N, n, n, 3)``.
        renderer: that drew them.

    Returns:
        ``(N, (2 REACH + 1)² + PLACE)``: pixels in [0, 1]; the spot's distances from the pad's centre, relative to half
        the pad, ``0 ≤ across ≤ along``; what they are beyond whole pixels [pixels]; the root of the mean brightness.

    Raises:
        ValueError: these are no force patches of this renderer.
    """
    blocks = [_close_ups(renderer.levels(images[n : n + _AT_ONCE])) for n in range(0, len(images), _AT_ONCE)]
    return np.concatenate(blocks)


def _close_ups(levels: NDArray[np.uint8]) -> Floats:
    count, edge, _ = levels.shape
    brightness = np.maximum(levels.sum(axis=(1, 2), dtype=np.int64), 1)
    offset = np.arange(edge) - (edge - 1) / 2
    place = np.stack([levels.sum(axis=other, dtype=np.int64) @ offset for other in (2, 1)], axis=1)
    place /= brightness[:, None]  # (N, 2): row, column
    nearest = np.rint(place + (edge - 1) / 2).astype(int)
    rest = place + (edge - 1) / 2 - nearest
    padded = np.pad(levels, ((0, 0), (REACH, REACH), (REACH, REACH)))
    spots = sliding_window_view(padded, (2 * REACH + 1,) * 2, axis=(1, 2))[np.arange(count), *nearest.T]
    for axis in (0, 1):
        mirrored = place[:, axis] < 0.0
        spots[mirrored] = np.flip(spots[mirrored], axis=axis + 1)
        place[mirrored, axis] *= -1.0
        rest[mirrored, axis] *= -1.0
    turned = place[:, 0] < place[:, 1]
    spots[turned] = spots[turned].swapaxes(1, 2)
    place[turned], rest[turned] = place[turned, ::-1], rest[turned, ::-1]
    columns = [spots.reshape(count, -1) / 255, place / (edge / 2), rest, np.sqrt(brightness / (255 * edge**2))[:, None]]
    return np.hstack(columns).astype(np.float32)


@dataclass(frozen=True)
class CloseReader:
    """A network of two hidden layers, and how it is trained.

    Attributes:
        widths: of the hidden layers.
        epochs: passes over the known touches.
        batch_size: touches a step.
        learning_rate: peak of a one-cycle schedule.
        weight_decay: of AdamW.
    """

    widths: tuple[int, int] = (256, 128)
    epochs: int = 30
    batch_size: int = 256
    learning_rate: float = 2e-3
    weight_decay: float = 0.05

    def learn(
        self, known: Floats, shapes: Ints, seed: int, tick: Callable[[int], None] = lambda _: None
    ) -> Callable[[Floats], Floats]:
        """Train on known touches.

        Args:
            known: a row a touch, ``(N, D)``.
            shapes: ``(N,)``.
            seed: of weights and order.
            tick: is told how many touches each step took.

        Returns:
            From rows ``(M, D)`` to log probabilities ``(M, K)``.
        """
        import torch
        from torch import nn

        # A pixel at the rim is lit by few spots; to scale it up to the others would magnify those.
        mean, scale = known.mean(axis=0), known.std(axis=0) + 1 / 64
        rows, labels = torch.from_numpy((known - mean) / scale), torch.from_numpy(shapes)
        first, second = self.widths
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            network = nn.Sequential(
                nn.Linear(known.shape[1], first), nn.SiLU(), nn.Linear(first, second), nn.SiLU(),
                nn.Linear(second, int(shapes.max()) + 1), nn.LogSoftmax(dim=1),
            )  # fmt: skip
        optimizer = torch.optim.AdamW(network.parameters(), weight_decay=self.weight_decay)
        steps = self.epochs * -(-len(rows) // self.batch_size)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, self.learning_rate, total_steps=steps)
        rng = np.random.default_rng(seed)
        for _ in range(self.epochs):
            for batch in torch.from_numpy(rng.permutation(len(rows))).split(self.batch_size):
                optimizer.zero_grad()
                nn.functional.nll_loss(network(rows[batch]), labels[batch]).backward()
                optimizer.step()
                schedule.step()
                tick(len(batch))
        network.eval()

        def read(asked: Floats) -> Floats:
            with torch.inference_mode():
                return network(torch.from_numpy((asked - mean) / scale)).numpy()

        return read
