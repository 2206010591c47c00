"""From results to answers: what a configuration costs, which are on the front, and which to take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from belief.statistics import pareto_front, pareto_probabilities, wilson_interval
from experiments.tradeoff.configuration import Configuration
from experiments.tradeoff.measure import Result, TouchCost

Floats = NDArray[np.float64]

TASKS: Mapping[str, tuple[str, ...]] = {
    "four objects of four shapes": ("paper", "coarse", "gel"),
    "eight objects of twelve shapes, any mixture": ("hard",),
    "twelve objects of twelve shapes": ("many",),
}
"""Scenes in which the same is sought, with different sensors: among these one may choose."""


@dataclass(frozen=True)
class Point:
    """A configuration with its result and its costs."""

    result: Result
    cost: TouchCost

    @property
    def configuration(self) -> Configuration:
        """Which."""
        return self.result.configuration

    @property
    def num_searches(self) -> int:
        """Behind every mean."""
        return len(self.result.successes)

    @property
    def success(self) -> float:
        """Share of the searches."""
        return sum(self.result.successes) / self.num_searches

    @property
    def interval(self) -> tuple[float, float]:
        """Of the success, Wilson, 95 %."""
        return wilson_interval(sum(self.result.successes), self.num_searches)

    @property
    def touches(self) -> float:
        """Mean of a search."""
        return float(np.mean(self.result.touches))

    @property
    def reward(self) -> float:
        """Mean return of a search."""
        return float(np.mean(self.result.rewards))

    @cached_property
    def ms_of_searches(self) -> Floats:
        """Of every search: its touches at what one costs, and its decisions."""
        per_touch = self.cost.physics + self.cost.network
        decisions = np.array(self.result.decisions) * self.result.ms_per_decision
        return np.asarray(np.array(self.result.touches) * per_touch + decisions)

    @property
    def ms_per_search(self) -> float:
        """Physics, network and decisions."""
        return float(self.ms_of_searches.mean())

    @property
    def ms_per_touch(self) -> float:
        """From one touch to the next: physics, network and the decision."""
        return self.cost.physics + self.cost.network + self.result.ms_per_decision

    @property
    def is_playable(self) -> bool:
        """Whether ``activetouch compare`` can play it: it reads in single precision, with as many simulations."""
        c = self.configuration
        return c.precision == "fp32" and c.simulations == Configuration.simulations


@dataclass(frozen=True)
class Front:
    """The points of a task, and which of them are worth having.

    Attributes:
        task: a key of :data:`TASKS`.
        points: cheapest first.
        on_front: whether no other is both cheaper and at least as successful.
        probs: that each is, given the searches.
    """

    task: str
    points: Sequence[Point]
    on_front: NDArray[np.bool_]
    probs: Floats


def fronts(points: Sequence[Point], rng: np.random.Generator, num_resamples: int = 1000) -> list[Front]:
    """The front of every task that has points, on time per search and success."""
    found = []
    for task, scenes in TASKS.items():
        some = sorted((p for p in points if p.configuration.scene in scenes), key=lambda p: p.ms_per_search)
        if some:
            on_front = pareto_front([p.ms_per_search for p in some], [p.success for p in some])
            found.append(Front(task, some, on_front, pareto_probabilities(*_resampled(some, rng, num_resamples))))
    return found


def _resampled(points: Sequence[Point], rng: np.random.Generator, num_resamples: int) -> tuple[Floats, Floats]:
    """Time and success as they may truly be, given the searches, each ``(S, C)``: a Bayesian bootstrap.

    Configurations that played the same episodes share the weights of a resample, so that what all found hard is no
    noise between them. Half a success and half a failure of its own is added to each, which makes the success of each
    by itself Beta(s + ½, f + ½): where nothing failed, something still may.
    """
    shared: dict[tuple[str, int], Floats] = {}
    columns = []
    for point in points:
        key = (point.configuration.scene, point.num_searches)
        if key not in shared:
            shared[key] = rng.standard_exponential((num_resamples, point.num_searches))
        weights = shared[key]
        total, (won, lost) = weights.sum(axis=1), rng.standard_gamma(0.5, (2, num_resamples))
        success = (weights @ np.array(point.result.successes, float) + won) / (total + won + lost)
        columns.append((weights @ point.ms_of_searches / total, success))
    costs, qualities = (np.stack(column, axis=1) for column in zip(*columns, strict=True))
    return costs, qualities


@dataclass(frozen=True)
class Pick:
    """An answer to a question: the point, or None where none will do."""

    question: str
    point: Point | None


def picks(front: Front, least_success: float, most_ms: float) -> list[Pick]:
    """The fastest that is good enough, and the best that is fast enough.

    Good is what the lower end of the interval of the success says. Of equally good ones the best touches least, since
    a touch takes a robot longer than any of this.
    """
    playable = [point for point in front.points if point.is_playable]
    good = [point for point in playable if point.interval[0] >= least_success]
    fast = [point for point in playable if point.ms_per_touch <= most_ms]
    return [
        Pick(f"the fastest with success ≥ {least_success:g} (lower end of its interval)", good[0] if good else None),
        Pick(
            f"the most accurate under {most_ms:g} ms a touch, of equals the one that touches least",
            max(fast, key=lambda point: (point.interval[0], -point.touches, -point.ms_per_search)) if fast else None,
        ),
    ]
