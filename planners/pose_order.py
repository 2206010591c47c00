"""The best fixed order of poses: how it is found, and its file in a sensor's folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from belief.errors import ActiveTouchError, CorruptFile
from belief.files import sealed_json, unsealed_json, write_text
from belief.problem import Floats

FILE = "order.json"
"""Name of the file in a sensor's folder."""


class NoOrder(ActiveTouchError, FileNotFoundError):
    """A sensor has no best order of poses."""


def greedy_order(
    log_ratios: NDArray[np.floating], shapes: NDArray[np.integer], length: int
) -> tuple[list[int], Floats]:
    """Poses one by one, each the one with which the touches so far leave the lowest NLL of the shape.

    Args:
        log_ratios: log p(touch | shape, hypothesis) of a touch of S objects in every pose, ``(P, S, K, N)``.
        shapes: the true shape of each, ``(S,)``.
        length: of the order, at most P.

    Returns:
        The order, and the NLL after each of its touches [nats].

    >>> tells, silent = np.log([[[0.9], [0.1]], [[0.1], [0.9]]]), np.zeros((2, 2, 1))
    >>> order, losses = greedy_order(np.stack([silent, tells]), np.array([0, 1]), 2)
    >>> order, losses.round(3).tolist()
    ([1, 0], [0.105, 0.105])
    """
    rows, left = np.arange(len(shapes)), list(range(len(log_ratios)))
    order: list[int] = []
    losses: list[float] = []
    weights = np.zeros(log_ratios.shape[1:], np.float32)
    for _ in range(length):
        found = []
        for pose in left:
            totals = logsumexp(weights + log_ratios[pose], axis=2)  # (S, K)
            found.append(float((logsumexp(totals, axis=1) - totals[rows, shapes]).mean()))
        best = int(np.argmin(found))
        losses.append(found[best])
        order.append(left.pop(best))
        weights = weights + log_ratios[order[-1]]
    return order, np.array(losses)


def write_order(folder: Path, labels: list[str], losses: Floats) -> None:
    """Write an order of poses into a sensor's folder."""
    write_text(folder / FILE, sealed_json({"order": labels, "nll": losses.round(5).tolist()}, 1) + "\n")


def read_order(folder: Path | None) -> tuple[str, ...]:
    """The order of poses in a sensor's folder.

    Raises:
        NoOrder: there is none.
        CorruptFile: the file is damaged.
    """
    path = None if folder is None else folder / FILE
    if path is None or not path.is_file():
        raise NoOrder(
            f"there is no order of poses{f' in {folder}' if folder else ''}; activetouch rank-poses finds one"
        )
    try:
        order = unsealed_json(path.read_text(encoding="utf-8"))["order"]
        return tuple(str(label) for label in order)
    except (OSError, ValueError, KeyError, TypeError, json.JSONDecodeError) as error:
        raise CorruptFile(f"{path} is no order of poses: {error}") from error
