"""Leak controls: how well the label is read where it should not be readable, or not that well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from activetouch.recorded.reader import Reading, read
from activetouch.recorded.splits import Split, by_session
from activetouch.recorded.touches import TaskTouches
from belief.statistics import cluster_bootstrap
from experiments.recorded.fold import Fold, labelled
from experiments.recorded.order import by_session as table_by_session

ALL = "all features"


@dataclass(frozen=True)
class Control:
    """Accuracy of one reading of the touches.

    Attributes:
        split: how touches were held out.
        features: what was read.
        accuracy: of one touch, with its interval over objects.
        all_actions: of one touch with each action, without correlations; None where no session has all actions.
    """

    split: str
    features: str
    accuracy: tuple[float, float, float]
    all_actions: float | None


def controls(touches: TaskTouches, folds: list[Fold], main: str, seed: int, num_random: int) -> list[Control]:
    """The main reading, that of a random split, and those of the set's controls.

    Args:
        touches: of the task.
        folds: of the main split.
        main: name of the main split.
        seed: of random splits and intervals.
        num_random: number of random splits.
    """
    splits = [fold.split for fold in folds]
    found = [_control(touches, splits, [fold.reading for fold in folds], main, ALL, seed)]
    drawn = [by_session(touches, np.random.default_rng([seed, number])) for number in range(num_random)]
    name = "random sessions" if touches.task == "objects" else "random sessions of objects that were learned too"
    found.append(_control(touches, drawn, [read(touches, split) for split in drawn], name, ALL, seed))
    for control in touches.source.controls:
        readings = [read(touches, split, control) for split in splits]
        found.append(_control(touches, splits, readings, main, control, seed))
    return found


def _control(
    touches: TaskTouches, splits: list[Split], readings: list[Reading], split_name: str, features: str, seed: int
) -> Control:
    right, owners, together = [], [], []
    for split, reading in zip(splits, readings, strict=True):
        data = labelled(touches, split.test, reading.test_ratios)
        right.append(reading.test_ratios.argmax(axis=1) == touches.labels[split.test])
        owners.append(touches.objects[split.test])
        ratios, labels = table_by_session(data, touches.sessions_of(split.test))
        together.append(ratios.sum(axis=1).argmax(axis=1) == labels)
    accuracy = cluster_bootstrap(np.concatenate(right), np.concatenate(owners), np.random.default_rng(seed))
    every = np.concatenate(together)
    return Control(split_name, features, accuracy, float(every.mean()) if every.size else None)
