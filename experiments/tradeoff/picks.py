"""Pareto fronts of time and success, and recommended configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from belief.statistics import pareto_front
from experiments.tradeoff.measure import Measured

TASKS: Mapping[str, tuple[str, ...]] = {
    "four objects of four shapes": ("paper", "coarse", "gel"),
    "eight objects of twelve shapes, any mixture": ("hard",),
    "twelve objects of twelve shapes": ("many",),
}
"""Scenes with the same search task and different sensors, by task; each task has a Pareto front."""


@dataclass(frozen=True)
class Front:
    """Pareto front of a task.

    Attributes:
        task: key of :data:`TASKS`.
        points: all configurations, fastest first.
        on_front: whether each is on the front: no other is both faster and at least as successful.
    """

    task: str
    points: Sequence[Measured]
    on_front: NDArray[np.bool_]


def fronts(points: Sequence[Measured]) -> list[Front]:
    """Pareto front of time per search and success for every task that has configurations."""
    found = []
    for task, scenes in TASKS.items():
        of_task = sorted((p for p in points if p.configuration.scene in scenes), key=lambda p: p.ms_per_search)
        if of_task:
            on_front = pareto_front([p.ms_per_search for p in of_task], [p.success for p in of_task])
            found.append(Front(task, of_task, on_front))
    return found


@dataclass(frozen=True)
class Pick:
    """Recommended configuration for a question; None if no configuration satisfies it."""

    question: str
    point: Measured | None


def picks(front: Front, least_success: float, most_ms: float) -> list[Pick]:
    """Recommend the fastest configuration that is accurate enough, and the most accurate one that is fast enough.

    Accuracy is the lower end of the interval of the success rate. Equally accurate configurations are ranked by touches
    per search, because a touch of a real robot takes longer than the computation.

    Args:
        front: configurations of a task.
        least_success: lowest acceptable accuracy.
        most_ms: longest acceptable time per touch [ms].
    """
    good = [point for point in front.points if point.interval[0] >= least_success]
    fast = [point for point in front.points if point.ms_per_touch <= most_ms]
    return [
        Pick(f"the fastest with success ≥ {least_success:g} (lower end of its interval)", good[0] if good else None),
        Pick(
            f"the most accurate under {most_ms:g} ms per touch, with the fewest touches among equals",
            max(fast, key=lambda p: (p.interval[0], -p.mean_touches, -p.ms_per_search)) if fast else None,
        ),
    ]
