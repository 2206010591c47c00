"""Numbers of a comparison, computed from its episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from belief import SearchProblem
from belief.metrics import CalibrationAtStop
from belief.statistics import wilson_interval
from experiments.search.episode_statistics import Place, by_position, claims, gap, regret
from experiments.search.paired import Difference, differences, prob_best
from experiments.search.run_folder import Seconds
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
        touch_quantiles: touches that half and nine tenths of the searches do not exceed, and the most.
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
    touch_quantiles: tuple[int, int, int]
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
    touches = [episode.num_touches for episode in episodes]
    median, most_of_them, all_of_them = np.quantile(touches, [0.5, 0.9, 1.0], method="inverted_cdf")
    return Cell(
        num_episodes=len(episodes),
        successes=successes,
        success_interval=wilson_interval(successes, len(episodes)),
        wrong=count[Outcome.CONFIRMED],
        none=count[Outcome.EXHAUSTED],
        truncated=count[Outcome.TRUNCATED],
        touches=float(np.mean(touches)),
        touch_quantiles=(int(median), int(most_of_them), int(all_of_them)),
        reward=float(np.mean([episode.reward(problem) for episode in episodes])),
        seconds=seconds,
    )


@dataclass(frozen=True)
class Comparison:
    """A finished run, read back: episodes and numbers by (decider, target).

    Attributes:
        problem: the search.
        episodes: by (decider, target label).
        cells: by (decider, target label), and by (decider, "all").
        differences: to ``reference``, over all targets.
        positions: success by where the target lay, by decider.
        claims: at the stop, by decider; None for one that never confirmed.
        regret: to the best reader of all touches, by decider: mean and 95 % interval.
        gap: of the mean return to the discretised model's upper bound, by decider, likewise; None where not known.
        prob_best: probability of the highest mean return, by decider.
        solved: whether full information solves the first episodes, by target (:mod:`experiments.search.oracle`).
        reference: the decider the others are compared with.
    """

    problem: SearchProblem
    episodes: Mapping[tuple[str, str], Sequence[Episode]]
    cells: Mapping[tuple[str, str], Cell]
    differences: Mapping[str, Difference]
    positions: Mapping[str, Sequence[Place]]
    claims: Mapping[str, CalibrationAtStop | None]
    regret: Mapping[str, tuple[float, float, float]]
    gap: Mapping[str, tuple[float, float, float] | None]
    prob_best: Mapping[str, float]
    solved: Mapping[str, Sequence[bool]]
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
    def ceiling(self) -> tuple[int, int]:
        """Episodes that full information solves, and how many it was tried on."""
        return sum(sum(some) for some in self.solved.values()), sum(len(some) for some in self.solved.values())

    @property
    def floor(self) -> float:
        """Best success without touching, mean over targets: confirm any object, or none if that is likelier right."""
        problem = self.problem
        best = np.maximum(problem.prior_probs, problem.prior_absent_probs)
        return float(np.mean([best[problem.shape_labels.index(target)] for target in self.targets]))

    def of(self, decider: str) -> list[Episode]:
        """All episodes of a decider, target by target: the same ones in the same order for every decider."""
        return [episode for target in self.targets for episode in self.episodes[decider, target]]


def compare_episodes(
    problem: SearchProblem,
    episodes: Mapping[tuple[str, str], Sequence[Episode]],
    seconds: Mapping[tuple[str, str], Seconds],
    solved: Mapping[str, Sequence[bool]],
    reference: str,
    rng: np.random.Generator,
    bounds: Mapping[str, float | None] = MappingProxyType({}),
) -> Comparison:
    """All numbers of a comparison.

    Args:
        problem: the search.
        episodes: by (decider, target label), the same ones in the same order for every decider.
        seconds: time they took.
        solved: whether full information solves the first episodes, by target.
        reference: the decider the others are compared with.
        rng: source of the bootstraps.
        bounds: upper bounds on the expected return for the discretised sensor model, by target, where known.
    """
    cells = {key: summarise(episodes[key], seconds[key], problem) for key in episodes}
    by_decider: dict[str, dict[str, Sequence[Episode]]] = {}
    for (decider, target), some in episodes.items():
        by_decider.setdefault(decider, {})[target] = some
    together = {name: [e for some in by_target.values() for e in some] for name, by_target in by_decider.items()}
    for decider, some in together.items():
        spent = sum((seconds[key] for key in episodes if key[0] == decider), Seconds())
        cells[decider, "all"] = summarise(some, spent, problem)
    return Comparison(
        problem=problem,
        episodes=episodes,
        cells=cells,
        differences=differences(together, reference, problem, rng),
        positions={name: by_position(some) for name, some in together.items()},
        claims={name: claims(some) for name, some in together.items()},
        regret={name: regret(by_target, solved, problem, rng) for name, by_target in by_decider.items()},
        gap={name: gap(by_target, bounds, problem, rng) for name, by_target in by_decider.items()},
        prob_best=prob_best({name: [e.reward(problem) for e in some] for name, some in together.items()}, rng),
        solved=solved,
        reference=reference,
    )
