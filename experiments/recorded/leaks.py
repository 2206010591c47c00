"""Leak controls: how well the label is read where it should not be readable, or not that well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from activetouch.recorded.reader import Reading, read
from activetouch.recorded.splits import Split, by_session
from activetouch.recorded.touches import TaskTouches
from belief.table import Table, Value, interval
from experiments.recorded.fold import whole_sessions
from experiments.sensor.scores import accuracy_of_objects

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


def controls(
    touches: TaskTouches, splits: list[Split], readings: list[Reading], main: str, seed: int, num_random: int
) -> list[Control]:
    """The main reading, the most frequent label, the reading of random splits, and those of the set's controls.

    The calibrations of all are of the kind of the first main reading.
    There are no random splits where no object has the three sessions of an action that they take.

    Args:
        touches: of the task.
        splits: the main ones.
        readings: of each of them.
        main: name of the main split.
        seed: of random splits and intervals.
        num_random: number of random splits.
    """
    found = [_control(touches, splits, readings, main, ALL, seed), _most_frequent(touches, splits, main, seed)]
    kind = readings[0].reader.calibration.kind
    drawn = [by_session(touches, np.random.default_rng([seed, number])) for number in range(num_random)]
    drawn = [split for split in drawn if len(split.test)]
    name = "random sessions" if touches.task == "objects" else "random sessions of objects that were learned too"
    if drawn:
        random = [read(touches, split, None, kind) for split in drawn]
        found.append(_control(touches, drawn, random, name, ALL, seed))
    for control in touches.source.controls:
        known = [read(touches, split, control, kind) for split in splits]
        found.append(_control(touches, splits, known, main, control, seed))
    return found


def _most_frequent(touches: TaskTouches, splits: list[Split], split_name: str, seed: int) -> Control:
    """Always the label with the most touches: the best that a guess can be."""
    rows = np.concatenate([split.test for split in splits])
    right = touches.labels[rows] == np.bincount(touches.labels).argmax()
    accuracy = accuracy_of_objects(right, touches.objects[rows], np.random.default_rng(seed))
    return Control(split_name, "none: always the most frequent label", accuracy, None)


def control_table(found: Sequence[Control], num_labels: int) -> Table:
    """Leak controls as a table."""
    rows: list[Sequence[Value]] = [(one.split, one.features, interval(*one.accuracy), one.all_actions) for one in found]
    rows.append(("–", "a guess", f"{1 / num_labels:.3f}", 1 / num_labels))
    return Table(
        "Leak controls: accuracy by split and features",
        ("split", "features", "one touch [95 %]", ("one of each action", ".3f")),
        rows,
        "Intervals resample objects. Accuracy that remains without the pattern of a touch, or where nothing was "
        "touched, comes from force, size or session.",
        "controls",
    )


def doubts(found: Sequence[Control]) -> list[str]:
    """A sentence for each control on the main split that is as accurate as the touch, within the touch's interval."""
    touch, *others = found
    return [
        f'The leak control "{one.features}" is as accurate as the touch itself ({one.accuracy[0]:.3f} and '
        f"{interval(*touch.accuracy)}, one touch): these results do not show that the pattern of a touch is read."
        for one in others
        if one.split == touch.split and one.accuracy[0] >= touch.accuracy[1]
    ]


def _control(
    touches: TaskTouches, splits: list[Split], readings: list[Reading], split_name: str, features: str, seed: int
) -> Control:
    right, owners, together = [], [], []
    for split, reading in zip(splits, readings, strict=True):
        data = touches.labelled(split.test, reading.test_ratios)
        right.append(reading.test_ratios.argmax(axis=1) == touches.labels[split.test])
        owners.append(touches.objects[split.test])
        ratios, labels = whole_sessions(data, touches.sessions_of(split.test))
        together.append(ratios.sum(axis=1).argmax(axis=1) == labels)
    accuracy = accuracy_of_objects(np.concatenate(right), np.concatenate(owners), np.random.default_rng(seed))
    every = np.concatenate(together)
    return Control(split_name, features, accuracy, float(every.mean()) if every.size else None)
