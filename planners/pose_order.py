"""The best fixed order of poses: how it is found, and its file in a sensor's folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

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
    """
    order: tuple[int, ...] = ()
    losses: list[float] = []
    while len(order) < length:
        found = {(*order, pose): loss((*order, pose)) for pose in range(num_poses) if pose not in order}
        order = min(found, key=lambda poses: found[poses])
        losses.append(found[order])
    return order, np.array(losses)


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
