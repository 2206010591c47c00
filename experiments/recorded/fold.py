"""One split of recorded touches, ready for searches: the reader's test touches, and observation models of every law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from activetouch.recorded.reader import Reading, read
from activetouch.recorded.splits import Split, by_object, by_session
from activetouch.recorded.touches import TaskTouches
from activetouch.recorded.world import RecordedBank
from belief.observation_model.action_kernel import ActionKernelModel, Law
from belief.observation_model.calibration_data import LabelledTouches
from experiments.recorded.order import best_order

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
