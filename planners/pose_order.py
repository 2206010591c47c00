"""The best fixed order of poses: how it is found, and its file in a sensor's folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from belief.errors import ActiveTouchError, CorruptFile
from belief.files import sealed_json, unsealed_json, write_text
from belief.validation import Floats

FILE = "order.json"
"""Name of the file in a sensor's folder."""


class NoOrder(ActiveTouchError, FileNotFoundError):
    """A sensor has no best order of poses."""


def greedy_order(
    num_poses: int, length: int, loss: Callable[[tuple[int, ...]], float]
) -> tuple[tuple[int, ...], Floats]:
    """Poses one by one, each the one with which the touches so far have the lowest loss; of equal ones the first.

    Args:
        num_poses: P.
        length: of the order, at most P.
        loss: of touches in some poses, without one of them twice.

    Returns:
        The order, and the loss after each of its touches.

    >>> worth = {0: 1.0, 1: 3.0, 2: 2.0}
    >>> greedy_order(3, 2, lambda poses: -sum(worth[pose] for pose in poses))[0]
    (1, 2)
    """
    order: tuple[int, ...] = ()
    losses: list[float] = []
    while len(order) < length:
        found = {(*order, pose): loss((*order, pose)) for pose in range(num_poses) if pose not in order}
        order = min(found, key=lambda poses: found[poses])
        losses.append(found[order])
    return order, np.array(losses)


def hypothesis_order(
    log_ratios: NDArray[np.floating], shapes: NDArray[np.integer], length: int
) -> tuple[tuple[int, ...], Floats]:
    """The greedy order by the NLL of the shape, with touches that share hypotheses about the object.

    Args:
        log_ratios: log p(touch | shape, hypothesis) of a touch of S objects in every pose, ``(P, S, K, N)``.
        shapes: the true shape of each, ``(S,)``.
        length: of the order, at most P.

    Returns:
        The order, and the NLL after each of its touches [nats].

    >>> tells, silent = np.log([[[0.9], [0.1]], [[0.1], [0.9]]]), np.zeros((2, 2, 1))
    >>> order, losses = hypothesis_order(np.stack([silent, tells]), np.array([0, 1]), 2)
    >>> order, losses.round(3).tolist()
    ((1, 0), [0.105, 0.105])
    """
    rows = np.arange(len(shapes))

    @lru_cache(maxsize=1)
    def before(poses: tuple[int, ...]) -> NDArray[np.floating]:
        return np.asarray(sum((log_ratios[pose] for pose in poses), np.zeros(log_ratios.shape[1:], np.float32)))

    def loss(poses: tuple[int, ...]) -> float:
        totals = logsumexp(before(poses[:-1]) + log_ratios[poses[-1]], axis=2)  # (S, K)
        return float((logsumexp(totals, axis=1) - totals[rows, shapes]).mean())

    return greedy_order(len(log_ratios), length, loss)


def write_order(folder: Path, labels: Sequence[str], losses: Floats) -> None:
    """Write an order of poses into a sensor's folder."""
    write_text(folder / FILE, sealed_json({"order": list(labels), "nll": losses.round(5).tolist()}, 1) + "\n")


def read_order(folder: Path | None) -> tuple[str, ...]:
    """The order of poses in a sensor's folder.

    Raises:
        NoOrder: there is none.
        CorruptFile: the file is damaged.
    """
    path = None if folder is None else folder / FILE
    if path is None or not path.is_file():
        raise NoOrder(f"there is no order of poses{f' in {folder}' if folder else ''}; activetouch calibrate finds one")
    try:
        order = unsealed_json(path.read_text(encoding="utf-8"))["order"]
        return tuple(str(label) for label in order)
    except (OSError, ValueError, KeyError, TypeError, json.JSONDecodeError) as error:
        raise CorruptFile(f"{path} is no order of poses: {error}") from error
