"""Paired differences between deciders on the same episodes, and the probability that each is best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from belief.problem import SearchProblem
from belief.statistics import McNemar, mcnemar_test, paired_bootstrap
from belief.statistics.power import LEVEL, episodes_for_success, holm
from planners import Episode

_RESAMPLES, _ROWS = 2000, 200  # bootstrap resamples, and how many are drawn at once


@dataclass(frozen=True)
class Difference:
    """Results of a decider minus those of the reference on the same episodes.

    Attributes:
        success: mean difference in success and its 95 % bootstrap interval.
        touches: the same for touches per search.
        reward: the same for returns.
        mcnemar: McNemar's test of the success rates; "first" is the decider, "second" the reference.
        p_value: mid-p value of this test, corrected for the number of deciders (Holm).
        episodes_for_success: episodes at which the corrected test would detect the observed difference in success with
            80 % power, even if it is the only difference; None if there is no difference.
    """

    success: tuple[float, float, float]
    touches: tuple[float, float, float]
    reward: tuple[float, float, float]
    mcnemar: McNemar
    p_value: float
    episodes_for_success: int | None


def differences(
    by_decider: Mapping[str, Sequence[Episode]], reference: str, problem: SearchProblem, rng: np.random.Generator
) -> dict[str, Difference]:
    """Paired differences of all other deciders to the reference.

    Args:
        by_decider: episodes by decider, the same in the same order.
        reference: decider that the others are compared with.
        problem: rules of the search.
        rng: random generator of the bootstraps.
    """
    base = by_decider[reference]
    others = {name: episodes for name, episodes in by_decider.items() if name != reference}
    level = LEVEL / max(len(others), 1)  # what Holm's correction asks of the smallest p-value
    found = {name: _difference(episodes, base, problem, rng, level) for name, episodes in others.items()}
    corrected = holm([difference.mcnemar.mid_p_value for difference in found.values()])
    return {
        name: replace(difference, p_value=p_value)
        for (name, difference), p_value in zip(found.items(), corrected, strict=True)
    }


def _difference(
    episodes: Sequence[Episode],
    base: Sequence[Episode],
    problem: SearchProblem,
    rng: np.random.Generator,
    level: float,
) -> Difference:
    right, base_right = ([bool(e.success) for e in some] for some in (episodes, base))
    rewards, base_rewards = ([e.reward(problem) for e in some] for some in (episodes, base))
    pairs = mcnemar_test(right, base_right)
    return Difference(
        success=paired_bootstrap(right, base_right, rng),
        touches=paired_bootstrap([e.num_touches for e in episodes], [e.num_touches for e in base], rng),
        reward=paired_bootstrap(rewards, base_rewards, rng),
        mcnemar=pairs,
        p_value=pairs.mid_p_value,
        episodes_for_success=episodes_for_success(pairs, level),
    )


def prob_best(rewards: Mapping[str, Sequence[float]], rng: np.random.Generator) -> dict[str, float]:
    """Fraction of bootstrap resamples of the episodes in which each decider has the highest mean return.

    Args:
        rewards: returns by decider, on the same episodes in the same order.
        rng: random generator of the resamples.

    Returns:
        Fraction by decider; the fractions sum to 1. Deciders that tie in a resample count equally.
    """
    table = np.array(list(rewards.values())).T  # (episodes, deciders)
    num_episodes = len(table)
    won = np.zeros(table.shape[1])
    for _ in range(0, _RESAMPLES, _ROWS):
        counts = rng.multinomial(num_episodes, np.full(num_episodes, 1.0 / num_episodes), size=_ROWS)
        means = counts @ table / num_episodes
        best = np.isclose(means, means.max(axis=1, keepdims=True), rtol=0.0, atol=1e-12)
        won += (best / best.sum(axis=1, keepdims=True)).sum(axis=0)
    return dict(zip(rewards, (won / _RESAMPLES).tolist(), strict=True))
