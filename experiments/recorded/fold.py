"""One split of recorded touches, ready for searches: the reader's test touches, and observation models of every law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from activetouch.recorded.reader import Reading, read
from activetouch.recorded.splits import Split, by_object, by_session
from activetouch.recorded.touches import TaskTouches
from activetouch.recorded.world import RecordedBank
from belief.observation_model.action_kernel import ActionKernelModel, Law, touch_weights
from belief.observation_model.calibration_data import LabelledTouches
from belief.validation import Floats
from planners.pose_order import greedy_order

LAWS: tuple[Law, ...] = ("none", "kernel")
"""Correlations of touches: none, and a kernel by the likeness of the actions."""


@dataclass(frozen=True, eq=False)
class Fold:
    """A split after reading, calibration and the fit of correlations.

    Attributes:
        touches: of the task.
        split: the rows.
        reading: the reader and what it read.
        bank: the test touches.
        models: observation models by law, fitted to the calibration touches.
        order: names of the actions in the best fixed order on the calibration touches.
    """

    touches: TaskTouches
    split: Split
    reading: Reading
    bank: RecordedBank
    models: Mapping[Law, ActionKernelModel]
    order: tuple[str, ...]

    @property
    def test_data(self) -> LabelledTouches:
        """The test touches with their labels."""
        return self.touches.labelled(self.split.test, self.reading.test_ratios)


def main_splits(touches: TaskTouches, folds: int) -> tuple[str, list[Split]]:
    """The splits on which results are reported, and their name.

    Args:
        touches: of the task; objects are split in order of recording, categories and shapes by object.
        folds: of objects, at most.
    """
    if touches.task == "objects":
        return "in order of recording", [by_session(touches)]
    return "unseen objects", by_object(touches, min(folds, len(set(touches.objects.tolist()))))


def prepare(touches: TaskTouches, split: Split, threshold: float) -> Fold:
    """Read a split, and fit what its searches need.

    Args:
        touches: of the task.
        split: the rows.
        threshold: probability at which searches stop, for the ranking of fixed orders.
    """
    reading = read(touches, split)
    test = split.test
    bank = RecordedBank(
        touches.label_names,
        touches.source.action_names,
        reading.test_ratios,
        touches.labels[test],
        touches.objects[test],
        touches.actions[test],
        touches.sessions_of(test),
    )
    rows = reading.calibration_rows
    data = touches.labelled(rows, reading.calibration_ratios)
    models = {law: reading.model(touches, law, bank.repeats) for law in LAWS}
    order = best_order(data, touches.sessions_of(rows), models["kernel"].kernel, threshold)
    return Fold(touches, split, reading, bank, models, tuple(bank.action_names[action] for action in order))


def best_order(data: LabelledTouches, sessions: NDArray[np.int64], kernel: Floats, threshold: float) -> tuple[int, ...]:
    """The better of two greedy orders: by the negative log posterior, and by the share of certain objects.

    Better is which needs fewer touches on the calibration data until a label has the probability ``threshold``.

    Args:
        data: calibration touches.
        sessions: of each, ``(n,)``.
        kernel: correlations between actions, ``(P, P)``.
        threshold: probability at which searches stop.
    """
    ratios, labels = whole_sessions(data, sessions)
    if len(ratios) == 0 or data.num_poses == 1:
        return tuple(range(data.num_poses))

    def loss(actions: tuple[int, ...]) -> float:
        return -float(fused(ratios, kernel, actions)[np.arange(len(labels)), labels].mean())

    def uncertain(actions: tuple[int, ...]) -> float:
        certain = fused(ratios, kernel, actions).max(axis=1) >= np.log(threshold)
        return -float(certain.mean()) + 1e-3 * loss(actions)

    size = data.num_poses
    orders = [greedy_order(size, size, score)[0] for score in (loss, uncertain)]
    return min(orders, key=lambda order: _mean_touches(ratios, kernel, order, threshold))


def whole_sessions(data: LabelledTouches, sessions: NDArray[np.int64]) -> tuple[Floats, NDArray[np.int64]]:
    """Ratios of the sessions that have a touch with every action, ``(G, P, K)``, and the labels, ``(G,)``."""
    _, group = np.unique(np.stack([data.objects, sessions]), axis=1, return_inverse=True)
    table = np.full((int(group.max()) + 1, data.num_poses, data.num_shapes), np.nan)
    labels = np.zeros(len(table), np.int64)
    table[group.ravel(), data.poses] = data.logits
    labels[group.ravel()] = data.shapes
    whole = ~np.isnan(table).any(axis=(1, 2))
    return table[whole], labels[whole]


def fused(ratios: Floats, kernel: Floats, actions: tuple[int, ...]) -> Floats:
    """Log posteriors ``(G, K)`` after one touch with each of some actions."""
    counts = np.bincount(actions, minlength=len(kernel))
    weights = touch_weights(counts, kernel) * counts
    return np.asarray(log_softmax(np.einsum("p,gpk->gk", weights, ratios), axis=1))


def _mean_touches(ratios: Floats, kernel: Floats, order: tuple[int, ...], threshold: float) -> float:
    waiting, total = np.ones(len(ratios), np.bool_), 0.0
    for step in range(len(order)):
        total += waiting.mean()
        waiting &= fused(ratios, kernel, order[: step + 1]).max(axis=1) < np.log(threshold)
    return total
