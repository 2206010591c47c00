"""Inputs and results of an estimator of the Bayes-optimal accuracy of one touch."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.scene import Scene
from activetouch.sensor import TactileSensor
from belief.files import write_text
from belief.observation_model.selection import log_posteriors
from belief.statistics import paired_bootstrap, wilson_interval
from experiments.bayes_error.held_out import Stream, held_out_readings
from experiments.parallel import run_tasks
from experiments.reporting.tables import Table
from experiments.sensor.scores import read_images

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LimitStudy:
    """A sensor in its scene, and the number of touches to measure.

    Attributes:
        sensor: with the classifier that is compared with the limit.
        touches: number of held-out touches, each of another object.
        seed: of all randomness.
        jobs: processes; the results do not depend on it.
        folder: for figures.
    """

    sensor: TactileSensor
    touches: int
    seed: int
    jobs: int
    folder: Path

    @property
    def scene(self) -> Scene:
        """The world of the touches."""
        return self.sensor.scene

    @property
    def shapes(self) -> NDArray[np.int64]:
        """True shapes of the test touches, ``(N,)``."""
        return np.arange(self.touches) % len(self.scene.shapes)

    def read(self) -> NDArray[np.uint8]:
        """Readings of the test touches, ``(N, H, W)`` or ``(N, H, W, 3)``."""
        tasks = [
            partial(held_out_readings, self.scene, self.seed, Stream.TEST, numbers)
            for numbers in chunks(self.touches, 50)
        ]
        parts = sorted(run_tasks(tasks, self.jobs, "touching held-out objects"), key=lambda part: part[0])
        return np.concatenate([readings for _, readings in parts])

    def classify(self, readings: NDArray[np.uint8]) -> Floats:
        """Calibrated log probabilities of the classifier, ``(N, K)``."""
        poses = np.arange(self.touches) // len(self.scene.shapes) % len(self.scene.poses)  # as in held_out_touch
        touches = read_images(self.sensor.reader, readings, poses, "reading with the classifier")
        return log_posteriors(self.sensor.model, touches.reshaped((-1, 1)))


@dataclass(frozen=True)
class Findings:
    """Results of an estimator.

    Attributes:
        title: one line.
        sentences: method, reason for it, and interpretation.
        tables: tables.
        numbers: all results, for programs.
    """

    title: str
    sentences: Sequence[str]
    tables: Sequence[Table]
    numbers: dict[str, Any]

    def write(self, folder: Path, identity: dict[str, Any]) -> None:
        """Write ``limit.json`` and ``limit.md``."""
        write_text(folder / "limit.json", json.dumps({**identity, **self.numbers}, indent=1) + "\n")
        text = "\n\n".join([f"# {self.title}", *self.sentences, *(table.markdown() for table in self.tables)])
        write_text(folder / "limit.md", text + "\n")


class Estimator(Protocol):
    """A method to estimate the Bayes-optimal accuracy of one touch."""

    def measure(self, study: LimitStudy) -> Findings:
        """Measure, and write figures into the study's folder."""


def chunks(count: int, size: int) -> list[range]:
    """The numbers below ``count`` in order, in blocks of ``size``."""
    return [range(first, min(first + size, count)) for first in range(0, count, size)]


def share(right: NDArray[np.bool_]) -> dict[str, Any]:
    """A proportion of independent touches, with its 95 % Wilson interval."""
    return {"value": float(right.mean()), "interval": wilson_interval(int(right.sum()), len(right))}


def paired_difference(first: NDArray[Any], second: NDArray[Any], seed: int) -> dict[str, Any]:
    """Mean of ``first - second`` over the same touches, with its 95 % bootstrap interval."""
    mean, low, high = paired_bootstrap(first.astype(float), second.astype(float), np.random.default_rng(seed))
    return {"value": mean, "interval": (low, high)}


def words(entry: dict[str, Any], sign: str = "") -> str:
    """A value and its interval as text; ``sign="+"`` shows the sign of positive values."""
    low, high = entry["interval"]
    return f"{entry['value']:{sign}.4f} [{low:{sign}.4f}, {high:{sign}.4f}]"
