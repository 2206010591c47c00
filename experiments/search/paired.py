"""Paired differences between deciders on the same episodes, and the probability that each is best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from belief.statistics import McNemar, mcnemar_test, paired_bootstrap
from belief.statistics.power import LEVEL, episodes_for_success, holm

_RESAMPLES, _ROWS = 2000, 200  # bootstrap resamples, and how many are drawn at once
MeanInterval: TypeAlias = tuple[float, float, float]
"""A mean and its 95 % bootstrap interval."""


@dataclass(frozen=True)
class Difference:
    """Results of a decider minus those of the reference on the same episodes.

    Attributes:
        success: mean difference in success.
        touches: the same for touches per search; None where they are not known.
        reward: the same for returns; None where they are not known.
        mcnemar: McNemar's test of the success rates; "first" is the decider, "second" the reference.
        p_value: mid-p value of this test, corrected for the number of deciders (Holm).
        episodes_for_success: episodes at which the corrected test would detect the observed difference in success with
            80 % power, even if it is the only difference; None if there is no difference.
    """

    success: MeanInterval
    touches: MeanInterval | None
    reward: MeanInterval | None
    mcnemar: McNemar
    p_value: float
    episodes_for_success: int | None


def differences(
    success: Mapping[str, ArrayLike],
    touches: Mapping[str, ArrayLike],
    reward: Mapping[str, ArrayLike] | None,
    reference: str,
    rng: np.random.Generator,
) -> dict[str, Difference]:
    """Paired differences of all other deciders to the reference, on the same N episodes in the same order.

    Values by decider are ``(N,)``; touches that are not known are NaN, rewards None.
    """

    def pair(values: Mapping[str, ArrayLike] | None, name: str) -> MeanInterval | None:
        if values is None or not np.isfinite(np.array([values[name], values[reference]], float)).all():
            return None
        return paired_bootstrap(values[name], values[reference], rng)

    others = [name for name in success if name != reference]
    tests = {name: mcnemar_test(success[name], success[reference]) for name in others}
    level = LEVEL / max(len(others), 1)  # what Holm's correction asks of the smallest p-value
    corrected = holm([test.mid_p_value for test in tests.values()])
    return {
        name: Difference(
            paired_bootstrap(success[name], success[reference], rng),
            pair(touches, name),
            pair(reward, name),
            tests[name],
            p_value,
            episodes_for_success(tests[name], level),
        )
        for name, p_value in zip(others, corrected, strict=True)
    }


def prob_best(rewards: Mapping[str, Sequence[float]], rng: np.random.Generator) -> dict[str, float]:
    """Fraction of bootstrap resamples of the same episodes in which each decider has the highest mean return.

    The fractions sum to 1. Deciders that tie in a resample count equally.
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
