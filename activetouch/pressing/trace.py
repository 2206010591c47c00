"""Time series of presses: position of the object, force on it, and phase of the motion (paper §5.4).

contact = Dynamic(traced=True).press(setup, placement, target_force=2.0)
write_csv(Path("cone.csv"), [contact.trace])
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from belief.files import atomic_path

Floats = NDArray[np.float64]
COLUMNS = ("cycle", "time", "x", "y", "z", "fx", "fy", "fz", "phase")


class Phase(StrEnum):
    """Phases of a press (paper §5.3); the paper's forward phase is split at first contact."""

    APPROACH = "approach"
    CONTACT = "contact"
    PAUSE = "pause"
    WITHDRAW = "withdraw"
    ROTATE = "rotate"


@dataclass(frozen=True, eq=False)
class Trace:
    """Time series of a press with T steps.

    Attributes:
        time: since the start [s], ``(T,)``.
        position: of the object's centre [m], ``(T, 3)``, world frame.
        force: of the pad on the object [N], ``(T, 3)``, world frame; +x points away from the pad.
        point: where the force acts, along y and z from the pad's centre [m], ``(T, 2)``; 0 without contact.
        phase: of the motion, ``(T,)``.
    """

    time: Floats
    position: Floats
    force: Floats
    point: Floats
    phase: Sequence[Phase]

    def __len__(self) -> int:
        return len(self.time)

    def select(self, rows: slice) -> Trace:
        """The steps in a slice."""
        return Trace(self.time[rows], self.position[rows], self.force[rows], self.point[rows], self.phase[rows])

    @property
    def end_of_pause(self) -> int:
        """Index of the step after the pause; 0 without a pause, as in a miss."""
        return next((row for row in range(len(self), 0, -1) if self.phase[row - 1] is Phase.PAUSE), 0)


def join(traces: Iterable[Trace]) -> Trace:
    """Concatenate traces; time continues from one to the next.

    Raises:
        ValueError: there is no trace.
    """
    parts, start = [], 0.0
    for trace in traces:
        parts.append(replace(trace, time=trace.time + start))
        start = parts[-1].time[-1] if len(trace) else start
    if not parts:
        raise ValueError("there is no trace to join")
    columns = ("time", "position", "force", "point")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in columns}
    return Trace(**joined, phase=[phase for part in parts for phase in part.phase])


def write_csv(path: Path, cycles: Sequence[Trace]) -> None:
    """Write one row per step with the columns :data:`COLUMNS`, atomically; time continues across cycles."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        start = 0.0
        for number, cycle in enumerate(cycles):
            rows = zip(cycle.time + start, cycle.position, cycle.force, cycle.phase, strict=True)
            writer.writerows((number, float(t), *map(float, x), *map(float, f), phase.value) for t, x, f, phase in rows)
            start += float(cycle.time[-1]) if len(cycle) else 0.0
