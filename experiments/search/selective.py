"""Searches that may end with "I do not know": how many do, why, and how reliable the answers of the others are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from belief.metrics import RiskCoverage, risk_coverage
from belief.statistics import clopper_pearson_interval
from planners import Episode, Outcome
from planners.abstaining import ANSWER, CONFLICT, REASONS
from planners.episode import judged

RANKINGS = ("stated confidence", "conflict")
"""Scores by which answers are ranked: the most confident first, those with the least conflict first."""
Share: TypeAlias = tuple[float, float, float]
"""A fraction and its 95 % Clopper-Pearson interval."""


@dataclass(frozen=True)
class Selective:
    """Answers of one decider, and the searches that it did not answer.

    Attributes:
        num_episodes: number of searches.
        unsure: fraction that ended with "I do not know".
        wrong: fraction that ended with a wrong answer: another object, or "no target" although there is one.
        reasons: number of searches that ended with "I do not know", by the score that names the reason.
        num_answered: searches with an answer. The others ended with "I do not know" or at the touch limit.
        stated: mean stated probability that an answer is right; None without answers.
        achieved: fraction of answers that are right; None without answers.
        curves: selective risk against coverage, by ranking; empty without answers.
    """

    num_episodes: int
    unsure: Share
    wrong: Share
    reasons: Mapping[str, int]
    num_answered: int
    stated: float | None
    achieved: Share | None
    curves: Mapping[str, RiskCoverage]


def selective(episodes: Sequence[Episode], rng: np.random.Generator) -> Selective | None:
    """Numbers on the searches of a decider that may answer "I do not know".

    Args:
        episodes: its searches, at least one with known truth.
        rng: random generator of the bootstraps.

    Returns:
        None if not all answers carry the scores of :class:`planners.abstaining.Abstaining`.
    """
    episodes = judged(episodes)
    ends = [(episode, episode.steps[-1].decision.scores) for episode in episodes if episode.steps]
    answers = [(bool(episode.success), scores) for episode, scores in ends if episode.is_answered]
    if not all(name in scores for _, scores in answers for name in (ANSWER, CONFLICT)):
        return None
    unsure = [scores for episode, scores in ends if episode.outcome is Outcome.UNSURE]
    if not answers and not any(CONFLICT in scores for scores in unsure):
        return None
    right = [success for success, _ in answers]
    number, stated = len(episodes), [scores[ANSWER] for _, scores in answers]
    trusts = (stated, [-scores[CONFLICT] for _, scores in answers])
    return Selective(
        num_episodes=number,
        unsure=_share(len(unsure), number),
        wrong=_share(len(right) - sum(right), number),
        reasons={reason: sum(reason in scores for scores in unsure) for reason in REASONS},
        num_answered=len(answers),
        stated=float(np.mean(stated)) if answers else None,
        achieved=_share(sum(right), len(right)) if answers else None,
        curves={
            ranking: risk_coverage(trust, right, rng, number - len(answers))
            for ranking, trust in zip(RANKINGS, trusts, strict=True)
            if answers
        },
    )


def _share(count: int, number: int) -> Share:
    return (count / number, *clopper_pearson_interval(count, number))
