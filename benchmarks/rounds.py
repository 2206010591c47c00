"""Processor time of several cases in interleaved rounds, so that the machine's changes of speed affect all of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray


def time_in_rounds(
    cases: Mapping[str, Callable[[int], object]], rounds: int, per_round: int
) -> dict[str, NDArray[np.float64]]:
    """Processor time per call of each case and round [ms], ``(rounds,)``; a first round is not counted."""
    milliseconds: dict[str, list[float]] = {name: [] for name in cases}
    for round_ in range(rounds + 1):
        for name, function in cases.items():
            started = time.process_time()
            for index in range(per_round):
                function(index)
            if round_ > 0:  # the first round warms up
                milliseconds[name].append(1e3 * (time.process_time() - started) / per_round)
    return {name: np.array(times) for name, times in milliseconds.items()}
