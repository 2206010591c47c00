"""Numbers of a comparison, computed from its episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.metrics import CalibrationAtStop, calibration_at_stop
from belief.problem import Confirm, SearchProblem
from belief.statistics import McNemar, mcnemar_test, paired_bootstrap, wilson_interval
from belief.statistics.comparison import LEVEL, episodes_for_success, holm
from belief.table import Value
from belief.validation import Floats
from experiments.search.play import Seconds
from planners import Episode, Outcome
from planners.episode import judged

ALL = "all"
"""Stands for all targets together in the keys of :attr:`Comparison.cells`."""
_RESAMPLES, _ROWS = 2000, 200  # bootstrap resamples, and how many are drawn at once
Rows: TypeAlias = slice | NDArray[np.bool_]
MeanInterval: TypeAlias = tuple[float, float, float]
"""A mean and its 95 % bootstrap interval."""


@dataclass(frozen=True)
class Difference:
    """Results of a decider minus those of the reference on the same episodes; None for what is not known.

    In ``mcnemar``, "first" is the decider and "second" the reference; ``p_value`` is its mid-p value, corrected for the
    number of deciders (Holm). ``episodes_for_success`` are the episodes at which the corrected test would detect this
    difference with 80 % power, even if it is the only one; None if there is no difference.
    """

    success: MeanInterval
    touches: MeanInterval | None
    reward: MeanInterval | None
    mcnemar: McNemar
    p_value: float
    episodes_for_success: int | None

    @property
    def cells(self) -> list[Value]:
        """Success, its interval, discordant pairs, p-value, episodes needed; touches and reward with intervals."""
        means = [(None, None) if mean is None else (mean[0], mean[1:]) for mean in (self.touches, self.reward)]
        pairs = self.mcnemar.first_only, self.mcnemar.second_only
        return [self.success[0], self.success[1:], *pairs, self.p_value, self.episodes_for_success, *chain(*means)]


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What a decider or policy reached in N episodes, ``(N,)`` each; touches, or steps, and rewards may be NaN."""

    success: NDArray[np.bool_]
    touches: Floats
    reward: Floats

    def minus(self, other: Outcomes, rows: Rows, rng: np.random.Generator) -> Difference:
        """The difference from another decider in some of the same episodes; its p-value is not corrected."""
        success = self.success[rows], other.success[rows]
        mean, test = paired_bootstrap(*success, rng), mcnemar_test(*success)
        pairs = [(one[rows], two[rows]) for one, two in ((self.touches, other.touches), (self.reward, other.reward))]
        touches, reward = (paired_bootstrap(*pair, rng) if np.isfinite(pair).all() else None for pair in pairs)
        return Difference(mean, touches, reward, test, test.mid_p_value, None)


def differences(
    others: Mapping[str, str], outcomes: Mapping[str, Outcomes], groups: Mapping[str, Rows], rng: np.random.Generator
) -> dict[tuple[str, str], Difference]:
    """By (name, group), each decider minus another; ``groups`` are rows of episodes by task, and :data:`ALL`.

    All tasks together are one question, each of them another: p-values and the episodes needed are corrected for the
    number of differences in each.
    """
    found = {
        (name, group): outcomes[name].minus(outcomes[other], rows, rng)
        for (name, other), (group, rows) in product(others.items(), groups.items())
    }
    for together in (True, False):
        keys = [key for key in found if (key[1] == ALL) is together]
        level = LEVEL / max(len(keys), 1)  # what Holm's correction asks of the smallest p-value
        for key, p_value in zip(keys, holm([found[key].p_value for key in keys]), strict=True):
            needed = episodes_for_success(found[key].mcnemar, level)
            found[key] = replace(found[key], p_value=p_value, episodes_for_success=needed)
    return found


def prob_best(rewards: Mapping[str, ArrayLike], rng: np.random.Generator) -> dict[str, float]:
    """Share of bootstrap resamples in which each decider has the highest mean return; ties count equally."""
    table = np.array(list(rewards.values())).T  # (episodes, deciders)
    num_episodes = len(table)
    won = np.zeros(table.shape[1])
    for _ in range(0, _RESAMPLES, _ROWS):
        counts = rng.multinomial(num_episodes, np.full(num_episodes, 1.0 / num_episodes), size=_ROWS)
        means = counts @ table / num_episodes
        best = np.isclose(means, means.max(axis=1, keepdims=True), rtol=0.0, atol=1e-12)
        won += (best / best.sum(axis=1, keepdims=True)).sum(axis=0)
    return dict(zip(rewards, (won / _RESAMPLES).tolist(), strict=True))


@dataclass(frozen=True)
class Cell:
    """Results of one decider for one target, or for all targets.

    Attributes:
        success_interval: 95 % Wilson interval of the success rate.
        wrong: failed searches that confirmed an object of another shape.
        none: failed searches that rejected every object.
        truncated: failed searches that reached the touch limit.
        unsure: searches that ended with "I do not know".
        touch_quantiles: median, 90 % quantile and maximum of the touches per search.
    """

    num_episodes: int
    successes: int
    success_interval: tuple[float, float]
    wrong: int
    none: int
    truncated: int
    unsure: int
    touches: float
    touch_quantiles: tuple[int, int, int]
    reward: float
    seconds: Seconds

    @property
    def success(self) -> float:
        """Fraction of searches that succeeded."""
        return self.successes / self.num_episodes


def summarise(episodes: Sequence[Episode], seconds: Seconds, problem: SearchProblem) -> Cell:
    """The numbers of at least one episode; episodes without a known outcome do not count."""
    episodes = judged(episodes)
    successes = sum(bool(episode.success) for episode in episodes)
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
        unsure=count[Outcome.UNSURE],
        touches=float(np.mean(touches)),
        touch_quantiles=(int(median), int(most_of_them), int(all_of_them)),
        reward=float(np.mean([episode.reward(problem) for episode in episodes])),
        seconds=seconds,
    )


def calibration_of_confirmations(episodes: Sequence[Episode]) -> CalibrationAtStop | None:
    """Calibration of the posterior at confirmation, by touches of the object; None if none was confirmed."""
    stops = [(e, e.steps[-1]) for e in judged(episodes) if e.steps and isinstance(e.steps[-1].decision.action, Confirm)]
    if not stops:
        return None
    return calibration_at_stop(
        [min(float(step.belief.probs[episode.target]), 1.0) for episode, step in stops],
        [bool(episode.success) for episode, _ in stops],
        [sum(s.touch is not None and s.object_index == last.object_index for s in e.steps) for e, last in stops],
    )


@dataclass(frozen=True)
class Summary:
    """Episodes of a comparison and the numbers computed from them.

    Attributes:
        episodes: searches by (decider, target label).
        cells: results by (decider, target label) and by (decider, :data:`ALL`).
        differences: each other decider minus ``reference``, over all targets.
        calibration: calibration at stopping, by decider; None for a decider that never confirmed.
        prob_best: fraction of bootstrap resamples in which the decider has the highest mean return, by decider.
    """

    problem: SearchProblem
    episodes: Mapping[tuple[str, str], Sequence[Episode]]
    cells: Mapping[tuple[str, str], Cell]
    differences: Mapping[str, Difference]
    calibration: Mapping[str, CalibrationAtStop | None]
    prob_best: Mapping[str, float]
    reference: str

    @property
    def deciders(self) -> list[str]:
        """Names of the deciders, in the order of the request."""
        return list(dict.fromkeys(decider for decider, _ in self.episodes))

    @property
    def targets(self) -> list[str]:
        """Labels of the targets, in the order of the request."""
        return list(dict.fromkeys(target for _, target in self.episodes))

    @property
    def is_selective(self) -> bool:
        """Whether deciders may answer "I do not know"."""
        return self.problem.unsure_reward is not None

    @property
    def pressed_again(self) -> int:
        """Number of presses that did not settle and were repeated, over all episodes."""
        return sum(self.cells[decider, ALL].seconds.pressed_again for decider in self.deciders)

    @property
    def no_touch_baseline(self) -> float:
        """Highest success rate without a touch, mean over targets: confirm any object or reject all of them."""
        problem = self.problem
        best = np.maximum(problem.prior_probs, problem.prior_absent_probs)
        return float(np.mean([best[problem.shape_labels.index(target)] for target in self.targets]))

    def of(self, decider: str) -> list[Episode]:
        """All episodes of a decider, target by target; every decider has the same ones in the same order."""
        return [episode for target in self.targets for episode in self.episodes[decider, target]]

    @classmethod
    def from_episodes(
        cls,
        problem: SearchProblem,
        episodes: Mapping[tuple[str, str], Sequence[Episode]],
        seconds: Mapping[tuple[str, str], Seconds],
        reference: str,
        rng: np.random.Generator,
        **others: Any,
    ) -> Self:
        """Compute all numbers of a comparison; ``others`` are further fields of the class.

        Episodes and seconds are by (decider, target label); every decider has the same episodes in the same order.
        """
        cells = {key: summarise(episodes[key], seconds[key], problem) for key in episodes}
        together: dict[str, list[Episode]] = {}
        for (decider, _), some in episodes.items():
            together.setdefault(decider, []).extend(some)
        outcomes = {
            name: Outcomes(
                np.array([bool(e.success) for e in some]),
                np.array([float(e.num_touches) for e in some]),
                np.array([e.reward(problem) for e in some]),
            )
            for name, some in together.items()
        }
        for decider, some in together.items():
            spent = sum((seconds[key] for key in episodes if key[0] == decider), Seconds())
            cells[decider, ALL] = summarise(some, spent, problem)
        pairs = {name: reference for name in together if name != reference}
        beside = differences(pairs, outcomes, {ALL: slice(None)}, rng)
        return cls(
            problem=problem,
            episodes=episodes,
            cells=cells,
            differences={name: found for (name, _), found in beside.items()},
            calibration={name: calibration_of_confirmations(some) for name, some in together.items()},
            prob_best=prob_best({name: found.reward for name, found in outcomes.items()}, rng),
            reference=reference,
            **others,
        )
