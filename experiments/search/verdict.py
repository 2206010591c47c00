"""What a comparison comes to, in plain words: what is settled, how surely, and what would settle the rest."""

from __future__ import annotations

import math

from belief.statistics.power import LEVEL
from experiments.search.paired import Difference
from experiments.search.summary import Comparison
from experiments.search.tables import ALL


def verdict(comparison: Comparison) -> list[str]:
    """Sentences: who is best and how surely, then every other decider against the reference, then promises."""
    told = [_best(comparison), _frame(comparison)]
    told += [_against(name, difference, comparison) for name, difference in comparison.differences.items()]
    told += _promises(comparison)
    if comparison.pressed_again:
        told.append(f"{comparison.pressed_again} presses did not settle and were made again.")
    return told


def _best(comparison: Comparison) -> str:
    names = sorted(comparison.deciders, key=lambda name: -comparison.cells[name, ALL].reward)
    best = comparison.cells[names[0], ALL]
    low, high = best.success_interval
    said = (
        f"{names[0]} does best: it succeeds in {_share(best.success)} [{_share(low)}, {_share(high)}] of "
        f"{best.num_episodes} searches with {best.touches:.1f} touches on average, a return of {best.reward:.3f}."
    )
    if len(names) == 1:
        return said.replace("does best: it succeeds", "succeeds")
    sure = comparison.prob_best[names[0]]
    if sure > 0.999:
        return f"{said} That its return is the highest of the {len(names)} is as good as certain."
    word = "sure" if sure > 0.975 else ("likely" if sure > 0.8 else "open")
    return (
        f"{said} That its return is the highest of the {len(names)} is {word}: it is in {100 * sure:.0f} % of "
        f"resamples of the episodes; next comes {names[1]} with {comparison.cells[names[1], ALL].reward:.3f}."
    )


def _frame(comparison: Comparison) -> str:
    solved, tried = comparison.ceiling
    bound = _bound(comparison)
    return (
        f"Without a touch one succeeds in {_share(comparison.floor)} (floor); who touches everything in every pose "
        f"before answering, in {solved} of {tried} (ceiling).{bound}"
    )


def _bound(comparison: Comparison) -> str:
    """How far the best decider stays below the bound of the discretised sensor model."""
    name = max(comparison.deciders, key=lambda name: comparison.cells[name, ALL].reward)
    gap = comparison.gap[name]
    if gap is None:
        return ""
    mean, low, high = gap
    bound = comparison.cells[name, ALL].reward + mean
    return (
        f" An upper bound on the expected return is {bound:.3f} for the discretised sensor model, in which touches are "
        f"independent given the shape; live touches are neither, so live returns can exceed it. {name} is "
        f"{abs(mean):.3f} {'below' if mean >= 0.0 else 'above'} [{low:+.3f}, {high:+.3f}]."
    )


def _against(name: str, difference: Difference, comparison: Comparison) -> str:
    pairs, reference = difference.mcnemar, comparison.reference
    either = f"{pairs.first_only} of {pairs.num_episodes} go right with it alone, {pairs.second_only} with the other"
    if difference.p_value < LEVEL:
        more = "more" if pairs.difference > 0 else "less"
        success = f"succeeds {more} often than {reference}: {either} (p {_p(difference.p_value)}), which settles it"
    else:
        success = (
            f"and {reference} cannot be told apart in success: {either} (p {_p(difference.p_value)}); "
            f"{_open(difference, comparison)}"
        )
    return f"{name} {success}. {_touches(difference)}"


def _open(difference: Difference, comparison: Comparison) -> str:
    """How many more episodes would settle it."""
    pairs, needed = difference.mcnemar, difference.episodes_for_success
    if needed is None:
        most = 1.0 - (1.0 - 0.95) ** (1.0 / pairs.num_episodes)
        if pairs.first_only + pairs.second_only == 0:
            return f"they differ in fewer than {100 * most:.2g} % of all searches (95 %)"
        return "they are right equally often, so no number of searches follows from what was seen"
    more = max(needed - pairs.num_episodes, 0)
    if more == 0:
        return "as many searches again would probably settle it"
    each = math.ceil(needed / len(comparison.targets))
    return (
        f"if the difference is as large as it looks, {abs(pairs.difference):.2g}, about {_round(more)} searches more "
        f"would settle it (--episodes {_round(each)})"
    )


def _touches(difference: Difference) -> str:
    mean, low, high = difference.touches
    if low <= 0.0 <= high:
        return f"In touches they do not differ ({mean:+.2f} [{low:+.2f}, {high:+.2f}])."
    return f"It takes {abs(mean):.2f} touches {'more' if mean > 0 else 'fewer'} [{low:+.2f}, {high:+.2f}]."


def _promises(comparison: Comparison) -> list[str]:
    """Which deciders are as often right as they claim when they confirm."""
    scores = {name: found.overall for name, found in comparison.claims.items() if found is not None}
    kept = [name for name, score in scores.items() if score.is_consistent]
    told = []
    if kept:
        verb = "keeps its promise" if len(kept) == 1 else "keep their promises"
        told.append(f"When confirming, {_and(kept)} {verb}: the claimed error lies in the interval of the achieved.")
    for name, score in scores.items():
        if not score.is_consistent:
            much = "more" if score.mean_stated > score.high else "less"
            told.append(
                f"{name} claims {much} than it keeps: {_share(score.mean_stated)} on average when confirming, and is "
                f"right in {_share(score.share_right)} [{_share(score.low)}, {_share(score.high)}]."
            )
    return told


def _and(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _share(value: float) -> str:
    return f"{value:.3f}"


def _p(value: float) -> str:
    return "< .001" if value < 0.001 else f"= {value:.2g}"


def _round(number: int) -> str:
    """To two digits, upwards: an estimate is no more exact than that."""
    step = 10 ** max(len(str(number)) - 2, 0)
    return str(-(-number // step) * step)
