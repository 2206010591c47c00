"""Certificates of stops on recordings of real objects: made from calibration sessions, tried on later or other ones.

    python -m benchmarks.recorded_certificates tests/fixtures/bts3 --format bts3
    python -m benchmarks.recorded_certificates cy101.npz --format npz --task categories

An object is touched in its calibration sessions, in random order, and thresholds for each number of touches are made
from these sequences (:func:`belief.observation_model.certified_stops`); each object is one item, so a set of few
objects promises nothing at a small risk. The same thresholds, and a plain stop at 0.95, are then tried on the touches
that no part was fitted to, ``--rounds`` times in other orders. The correlations of touches are fitted to the
calibration sequences, too, so the promise is as good as these few numbers are general.

Prints, by risk: how many objects the certificate knows, the least finite threshold, stops of all sequences, what they
state, the share that is right with an interval that resamples objects, and touches until the stop.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from activetouch.recorded import RecordedTouches, check_recorded, read_recorded
from activetouch.recorded.reader import Reading, read
from activetouch.recorded.touches import TASKS, Split, splits_of
from belief.observation_model import certified_stops
from belief.observation_model.action_kernel import ActionKernelModel, sequences
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.selection import log_posteriors_by_touch
from belief.touch_batch import TouchBatch
from experiments.sensor.scores import accuracy_of_objects

PLAIN = 0.95
RISKS = 0.05, 0.1, 0.2
Integers: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Part:
    """A split that was read, and its observation model, for which every touch is a new one."""

    touches: RecordedTouches
    split: Split
    reading: Reading
    model: ActionKernelModel

    @classmethod
    def of(cls, touches: RecordedTouches, split: Split) -> Part:
        """Read a split, and fit correlations."""
        reading = read(touches, split)
        return cls(touches, split, reading, reading.model(touches))


def drawn(data: LabelledTouches, sessions: Integers, seed: list[int]) -> list[Integers]:
    """Rows of one sequence of touches of every object."""
    every = sequences(data, sessions, np.random.default_rng(seed))
    _, first = np.unique(data.objects[every[:, 0]], return_index=True)
    return [row[row >= 0] for row in every[first]]


def thresholds(fold: Part, risk: float, seed: int) -> tuple[tuple[float, ...], int]:
    """Certified thresholds by number of touches, and the number of objects that they know."""
    rows = fold.reading.calibration_rows
    data = fold.touches.labelled(rows, fold.reading.calibration_ratios)
    found = drawn(data, fold.touches.sessions_of(rows), [seed, 0])
    groups = np.repeat(np.arange(len(found)), [len(row) for row in found])
    touched = np.concatenate(found)
    known = data.logits[touched], data.shapes[touched], groups
    made = certified_stops(fold.model, *known, risk=risk, poses=data.poses[touched])
    return made.thresholds, len(found)


def stops(fold: Part, limits: tuple[float, ...], rounds: int, seed: int) -> NDArray[np.float64]:
    """Object, whether it stopped, stated, whether it was right, and touches of every test sequence, ``(S, 5)``."""
    rows, model, found = fold.split.test, fold.model, []
    data, names = fold.touches.labelled(rows, fold.reading.test_ratios), fold.touches.sessions_of(rows)
    for number in range(rounds):
        for row in drawn(data, names, [seed, 1, number]):
            batch = TouchBatch(data.poses[row][None], data.logits[row][None])
            probs = np.exp(log_posteriors_by_touch(model, batch)[0])
            least = np.array([*limits, *[limits[-1]] * len(row)][: len(row)])
            is_end = probs.max(axis=1) >= least
            end = int(is_end.argmax()) if is_end.any() else len(row) - 1
            is_right = probs[end].argmax() == data.shapes[row[0]]
            found.append((data.objects[row[0]], is_end.any(), probs[end].max(), is_right, end + 1))
    return np.array(found, np.float64)


def line(found: NDArray[np.float64]) -> str:
    """The figures of all sequences."""
    ended = found[found[:, 1] == 1.0]
    if not len(ended):
        return f"no stop of {len(found)}"
    right, low, high = accuracy_of_objects(ended[:, 3], ended[:, 0], np.random.default_rng(0))
    return (
        f"{len(ended)} stops of {len(found)}, {len(np.unique(ended[:, 0]))} objects: stated {ended[:, 2].mean():.3f}, "
        f"right {right:.3f} [{low:.3f}, {high:.3f}], {ended[:, 4].mean():.2f} touches"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--format", default="npz")
    parser.add_argument("--task", default="objects", choices=TASKS)
    parser.add_argument("--folds", type=int, default=5)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    touches, _ = read_recorded(given.data, given.format)
    touches = touches.for_task(given.task)
    check_recorded(touches)
    folds = [Part.of(touches, split) for split in splits_of(touches, given.folds)]
    print(f"{given.data.name}, {given.task}, {len(folds)} splits, seed {given.seed}")

    def tried(limits: list[tuple[float, ...]]) -> NDArray[np.float64]:
        parts = [stops(fold, each, given.rounds, given.seed) for fold, each in zip(folds, limits, strict=True)]
        for index, part in enumerate(parts):
            part[:, 0] += 1e6 * index  # objects of another split are others
        return np.concatenate(parts)

    print(f"stop at {PLAIN:g}: {line(tried([(PLAIN,)] * len(folds)))}")
    for risk in RISKS:
        made = [thresholds(fold, risk, given.seed) for fold in folds]
        finite = [value for limits, _ in made for value in limits if np.isfinite(value)]
        least = f"thresholds from {min(finite):.3f}" if finite else "nothing is promised"
        known = ", ".join(str(number) for _, number in made)
        print(f"risk {risk:g}, {known} objects, {least}: {line(tried([limits for limits, _ in made]))}")


if __name__ == "__main__":
    main()
