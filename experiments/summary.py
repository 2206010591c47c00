"""Numbers of a comparison, computed from its episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from belief import SearchProblem
from belief.statistics import paired_bootstrap, wilson_interval
from experiments.results import Seconds
from planners import Episode, Outcome


@dataclass(frozen=True)
class Cell:
    """One decider on one target, or on all of them.

    Attributes:
        num_episodes: searches.
        successes: that ended with the right object.
        success_interval: Wilson, 95 %.
        wrong: confirmed something else.
        none: rejected everything.
        truncated: ran into the touch limit.
        touches: mean per search.
        reward: mean return.
        seconds: time spent.
    """

    num_episodes: int
    successes: int
    success_interval: tuple[float, float]
    wrong: int
    none: int
    truncated: int
    touches: float
    reward: float
    seconds: Seconds

    @property
    def success(self) -> float:
        """Share of searches that succeeded."""
        return self.successes / self.num_episodes


def summarise(episodes: Sequence[Episode], seconds: Seconds, problem: SearchProblem) -> Cell:
    """The numbers of one set of episodes."""
    successes = sum(episode.success for episode in episodes)
    failures = [episode for episode in episodes if not episode.success]
    count = {outcome: sum(episode.outcome is outcome for episode in failures) for outcome in Outcome}
    return Cell(
        num_episodes=len(episodes),
        successes=successes,
        success_interval=wilson_interval(successes, len(episodes)),
        wrong=count[Outcome.CONFIRMED],
        none=count[Outcome.EXHAUSTED],
        truncated=count[Outcome.TRUNCATED],
        touches=float(np.mean([episode.num_touches for episode in episodes])),
        reward=float(np.mean([episode.reward(problem) for episode in episodes])),
        seconds=seconds,
    )


@dataclass(frozen=True)
class Difference:
    """Paired difference of a decider to the reference, mean and 95 % bootstrap interval."""

    success: tuple[float, float, float]
    touches: tuple[float, float, float]


def differences(
    by_decider: Mapping[str, Sequence[Episode]], reference: str, rng: np.random.Generator
) -> dict[str, Difference]:
    """Each other decider against the reference, on the same episodes in the same order."""
    base = by_decider[reference]
    return {
        name: Difference(
            paired_bootstrap([e.success for e in episodes], [e.success for e in base], rng),
            paired_bootstrap([e.num_touches for e in episodes], [e.num_touches for e in base], rng),
        )
        for name, episodes in by_decider.items()
        if name != reference
    }


@dataclass(frozen=True)
class Comparison:
    """A finished run, read back: episodes and numbers by (decider, target).

    Attributes:
        problem: the search.
        episodes: by (decider, target label).
        cells: by (decider, target label), and by (decider, "all").
        differences: to ``reference``, over all targets.
        ceiling: successes and episodes with full information (:mod:`experiments.ceiling`).
        reference: the decider the others are compared with.
    """

    problem: SearchProblem
    episodes: Mapping[tuple[str, str], Sequence[Episode]]
    cells: Mapping[tuple[str, str], Cell]
    differences: Mapping[str, Difference]
    ceiling: tuple[int, int]
    reference: str

    @property
    def deciders(self) -> list[str]:
        """Names, in the order they were asked for."""
        return list(dict.fromkeys(decider for decider, _ in self.episodes))

    @property
    def targets(self) -> list[str]:
        """Labels, in the order they were asked for."""
        return list(dict.fromkeys(target for _, target in self.episodes))

    @property
    def pressed_again(self) -> int:
        """Presses, in all episodes, that did not settle and were made again."""
        return sum(self.cells[decider, "all"].seconds.pressed_again for decider in self.deciders)

    @property
    def floor(self) -> float:
        """Best success without touching, mean over targets: confirm any object, or none if that is likelier right."""
        problem = self.problem
        best = np.maximum(problem.prior_probs, problem.prior_absent_probs)
        return float(np.mean([best[problem.shape_labels.index(target)] for target in self.targets]))


def compare_episodes(
    problem: SearchProblem,
    episodes: Mapping[tuple[str, str], Sequence[Episode]],
    seconds: Mapping[tuple[str, str], Seconds],
    ceiling: tuple[int, int],
    reference: str,
    rng: np.random.Generator,
) -> Comparison:
    """All numbers of a comparison."""
    cells = {key: summarise(episodes[key], seconds[key], problem) for key in episodes}
    by_decider: dict[str, list[Episode]] = {}
    for (decider, _), some in episodes.items():
        by_decider.setdefault(decider, []).extend(some)
    for decider, some in by_decider.items():
        spent = sum((seconds[key] for key in episodes if key[0] == decider), Seconds())
        cells[decider, "all"] = summarise(some, spent, problem)
    return Comparison(problem, episodes, cells, differences(by_decider, reference, rng), ceiling, reference)
