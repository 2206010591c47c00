"""Deciders against a reference on the same episodes, and which of them is best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from belief import SearchProblem
from belief.statistics import McNemar, mcnemar_test, paired_bootstrap
from belief.statistics.power import episodes_for_mean, episodes_for_success, holm
from planners import Episode

_RESAMPLES, _ROWS = 2000, 200  # of the episodes, and how many are drawn at once


@dataclass(frozen=True)
class Difference:
    """A decider less the reference, over the same episodes.

    Attributes:
        success: mean difference and 95 % bootstrap interval.
        touches: the same of touches.
        reward: the same of returns.
        mcnemar: test of the success rates; "first" is the decider, "second" the reference.
        p_value: of that test (mid-p), corrected for the number of deciders compared (Holm).
        episodes_for_success: pairs that would probably settle a difference in success as large; None if it is 0.
        episodes_for_reward: the same for returns.
    """

    success: tuple[float, float, float]
    touches: tuple[float, float, float]
    reward: tuple[float, float, float]
    mcnemar: McNemar
    p_value: float
    episodes_for_success: int | None
    episodes_for_reward: int | None


def differences(
    by_decider: Mapping[str, Sequence[Episode]], reference: str, problem: SearchProblem, rng: np.random.Generator
) -> dict[str, Difference]:
    """Each other decider against the reference, on the same episodes in the same order."""
    base = by_decider[reference]
    found = {
        name: _difference(episodes, base, problem, rng) for name, episodes in by_decider.items() if name != reference
    }
    corrected = holm([difference.mcnemar.mid_p_value for difference in found.values()])
    return {
        name: replace(difference, p_value=p_value)
        for (name, difference), p_value in zip(found.items(), corrected, strict=True)
    }


def _difference(
    episodes: Sequence[Episode], base: Sequence[Episode], problem: SearchProblem, rng: np.random.Generator
) -> Difference:
    right, base_right = ([e.success for e in some] for some in (episodes, base))
    rewards, base_rewards = ([e.reward(problem) for e in some] for some in (episodes, base))
    pairs = mcnemar_test(right, base_right)
    return Difference(
        success=paired_bootstrap(right, base_right, rng),
        touches=paired_bootstrap([e.num_touches for e in episodes], [e.num_touches for e in base], rng),
        reward=paired_bootstrap(rewards, base_rewards, rng),
        mcnemar=pairs,
        p_value=pairs.mid_p_value,
        episodes_for_success=episodes_for_success(pairs),
        episodes_for_reward=episodes_for_mean(np.subtract(rewards, base_rewards).tolist()),
    )


def prob_best(rewards: Mapping[str, Sequence[float]], rng: np.random.Generator) -> dict[str, float]:
    """How probably each decider has the highest mean return: its share of bootstrap resamples of the episodes.

    Args:
        rewards: returns of every decider on the same episodes in the same order.
        rng: source of the resamples.

    Returns:
        By decider; they sum to one. Those that tie in a resample share it.
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
