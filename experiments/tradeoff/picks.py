"""Pareto fronts of time and success, and recommended configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from belief.statistics import pareto_front, pareto_probabilities, wilson_interval
from experiments.tradeoff.configuration import Configuration
from experiments.tradeoff.measure import SearchResult, TouchCost

TASKS: Mapping[str, tuple[str, ...]] = {
    "four objects of four shapes": ("paper", "coarse", "gel"),
    "eight objects of twelve shapes, any mixture": ("hard",),
    "twelve objects of twelve shapes": ("many",),
}
"""Scenes with the same search task and different sensors, by task; each task has a Pareto front."""


@dataclass(frozen=True)
class Candidate:
    """A configuration with its measured result and costs."""

    result: SearchResult
    cost: TouchCost

    @property
    def configuration(self) -> Configuration:
        """The configuration."""
        return self.result.configuration

    @property
    def num_searches(self) -> int:
        """Number of searches."""
        return len(self.result.successes)

    @property
    def success(self) -> float:
        """Fraction of searches that succeeded."""
        return sum(self.result.successes) / self.num_searches

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the success rate."""
        return wilson_interval(sum(self.result.successes), self.num_searches)

    @property
    def touches(self) -> float:
        """Mean number of touches per search."""
        return float(np.mean(self.result.touches))

    @property
    def reward(self) -> float:
        """Mean return."""
        return float(np.mean(self.result.rewards))

    @cached_property
    def ms_of_searches(self) -> NDArray[np.float64]:
        """Time of every search [ms]: touches at their mean cost, and decisions."""
        per_touch = self.cost.physics + self.cost.network
        decisions = np.array(self.result.decisions) * self.result.ms_per_decision
        return np.asarray(np.array(self.result.touches) * per_touch + decisions)

    @property
    def ms_per_search(self) -> float:
        """Mean time of a search [ms]: physics, network and decisions."""
        return float(self.ms_of_searches.mean())

    @property
    def ms_per_touch(self) -> float:
        """Time from one touch to the next [ms]: physics, network and one decision."""
        return self.cost.physics + self.cost.network + self.result.ms_per_decision

    @property
    def is_playable(self) -> bool:
        """Whether ``activetouch compare`` supports it: the default number of simulations."""
        c = self.configuration
        return c.simulations == Configuration.simulations


@dataclass(frozen=True)
class Front:
    """Pareto front of a task.

    Attributes:
        task: key of :data:`TASKS`.
        points: all candidates, fastest first.
        on_front: whether each candidate is on the front: no other is both faster and at least as successful.
        probs: probability that it is on the front, given the searches.
    """

    task: str
    points: Sequence[Candidate]
    on_front: NDArray[np.bool_]
    probs: NDArray[np.float64]


def fronts(points: Sequence[Candidate], rng: np.random.Generator, num_resamples: int = 1000) -> list[Front]:
    """Pareto front of time per search and success for every task that has candidates.

    Args:
        points: candidates of all tasks.
        rng: random generator of the bootstrap.
        num_resamples: number of bootstrap resamples.
    """
    found = []
    for task, scenes in TASKS.items():
        some = sorted((p for p in points if p.configuration.scene in scenes), key=lambda p: p.ms_per_search)
        if some:
            on_front = pareto_front([p.ms_per_search for p in some], [p.success for p in some])
            found.append(Front(task, some, on_front, pareto_probabilities(*_resampled(some, rng, num_resamples))))
    return found


def _resampled(
    points: Sequence[Candidate], rng: np.random.Generator, num_resamples: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bayesian bootstrap of time and success, each of shape ``(num_resamples, len(points))``.

    Candidates that played the same episodes share the weights of a resample, so that the difficulty of an episode
    cancels in comparisons. Half a success and half a failure are added to each candidate; the marginal distribution of
    its success is then Beta(s + ½, f + ½), which has a positive variance even without failures.
    """
    shared: dict[tuple[str, int], NDArray[np.float64]] = {}
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
    """Recommended candidate for a question; None if no candidate satisfies it."""

    question: str
    point: Candidate | None


def picks(front: Front, least_success: float, most_ms: float) -> list[Pick]:
    """Recommend the fastest candidate that is accurate enough, and the most accurate one that is fast enough.

    Accuracy is the lower end of the interval of the success rate. Equally accurate candidates are ranked by touches per
    search, because a touch of a real robot takes longer than the computation.

    Args:
        front: candidates of a task.
        least_success: lowest acceptable accuracy.
        most_ms: longest acceptable time per touch [ms].
    """
    playable = [point for point in front.points if point.is_playable]
    good = [point for point in playable if point.interval[0] >= least_success]
    fast = [point for point in playable if point.ms_per_touch <= most_ms]
    return [
        Pick(f"the fastest with success ≥ {least_success:g} (lower end of its interval)", good[0] if good else None),
        Pick(
            f"the most accurate under {most_ms:g} ms per touch, with the fewest touches among equals",
            max(fast, key=lambda point: (point.interval[0], -point.touches, -point.ms_per_search)) if fast else None,
        ),
    ]
