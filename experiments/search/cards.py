"""Summary cards of a comparison: what each decider reached, best first, and whether the best are tied."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from experiments.search.summary import ALL, Comparison

LEAST_DOUBT = 0.025
"""A decider whose return is the highest in at least this fraction of bootstrap resamples may be the best."""
ENOUGH = 20
"""Least number of searches after which a decider is called the best; resamples of fewer are too much alike."""


class Card(NamedTuple):
    """What a decider reached, as text and numbers.

    Attributes:
        name: of the decider.
        rank: "best", "tied for best", or "".
        success: fraction of searches, with its interval.
        touches: mean number of a search.
        reward: mean return.
        stated: how stated confidence and fraction correct agree, in words.
    """

    name: str
    rank: str
    success: tuple[float, float, float]
    touches: float
    reward: float
    stated: str


def tied(comparison: Comparison) -> list[str]:
    """Deciders that may be the best, by return; more than one is a tie."""
    names = by_return(comparison)
    found = [name for name in names if comparison.prob_best[name] >= LEAST_DOUBT]
    return found or names[:1]


def is_small(comparison: Comparison) -> bool:
    """Whether there are too few searches to tell deciders apart."""
    return comparison.cells[comparison.reference, ALL].num_episodes < ENOUGH


def by_return(comparison: Comparison) -> list[str]:
    """All deciders, the highest mean return first."""
    return sorted(comparison.deciders, key=lambda name: -comparison.cells[name, ALL].reward)


def cards(comparison: Comparison) -> list[Card]:
    """A card for each decider, the highest return first."""
    best, found = tied(comparison), []
    for name in by_return(comparison):
        cell = comparison.cells[name, ALL]
        is_ranked = name in best and len(comparison.deciders) > 1 and not is_small(comparison)
        rank = ("tied for best" if len(best) > 1 else "best") if is_ranked else ""
        success = (cell.success, *cell.success_interval)
        found.append(Card(name, rank, success, cell.touches, cell.reward, _stated(comparison, name)))
    return found


def tie_sentence(names: Sequence[str], comparison: Comparison) -> str:
    """A tie in words; empty where one decider is certainly the best."""
    if len(names) < 2:
        return ""
    shares = ", ".join(f"that of {name} in {100 * comparison.prob_best[name]:.0f} %" for name in names)
    return (
        f"This is a tie of {len(names)}: no return is certainly the highest. In bootstrap resamples of the episodes, "
        f"the highest return is {shares}."
    )


def _stated(comparison: Comparison, name: str) -> str:
    found = comparison.calibration[name]
    if found is None:
        return "never confirmed"
    score = found.overall
    word = (
        "as stated"
        if score.is_consistent
        else ("overconfident" if score.mean_stated > score.high else "underconfident")
    )
    return f"{word}: {score.share_right:.3f} right, {score.mean_stated:.3f} stated"
