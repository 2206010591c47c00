"""Time series of presses: position of the object, force on it, and phase of the motion (paper §5.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Phase(StrEnum):
    """Phases of a press (paper §5.3); the paper's forward phase is split at first contact."""

    APPROACH = "approach"
    CONTACT = "contact"
    PAUSE = "pause"
    WITHDRAW = "withdraw"


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
