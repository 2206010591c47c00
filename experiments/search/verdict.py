"""Verdict of a comparison in sentences: significant differences, and the searches needed to resolve the others."""

from __future__ import annotations

import math
from statistics import fmean

from belief.statistics.power import LEVEL, POWER
from experiments.search.cards import ENOUGH, by_return, is_small, tie_sentence, tied
from experiments.search.paired import Difference
from experiments.search.selective import Selective
from experiments.search.summary import ALL, Comparison
from planners.bounds.one_touch import one_touch_bound


def verdict_sentences(comparison: Comparison) -> list[str]:
    """Sentences on the best decider, on the differences from the reference, and on stated confidence."""
    sentences = [_best(comparison), _frame(comparison)]
    sentences += [_against(name, difference, comparison) for name, difference in comparison.differences.items()]
    sentences += _calibration(comparison)
    sentences += [_selective(name, found) for name, found in comparison.selective.items() if found is not None]
    if comparison.pressed_again:
        sentences.append(f"{comparison.pressed_again} presses did not settle and were repeated.")
    return sentences


def _best(comparison: Comparison) -> str:
    names, equals = by_return(comparison), tied(comparison)
    best = comparison.cells[names[0], ALL]
    low, high = best.success_interval
    said = (
        f"{names[0]} is best: it succeeds in {_share(best.success)} [{_share(low)}, {_share(high)}] of "
        f"{best.num_episodes} searches with {best.touches:.1f} touches on average, a return of {best.reward:.3f}."
    )
    if len(names) == 1:
        return said.replace("is best: it succeeds", "succeeds")
    highest = said.replace("is best: it", "has the highest return: it")
    if is_small(comparison):
        return f"{highest} To call a decider the best takes at least {ENOUGH} searches."
    if len(equals) > 1:
        return f"{highest} {tie_sentence(equals, comparison)}"
    sure = comparison.prob_best[names[0]]
    if sure > 0.999:
        return f"{said} Its return is almost certainly the highest of the {len(names)}."
    return (
        f"{said} Its return is very probably the highest of the {len(names)}: it is the highest in {100 * sure:.0f} % "
        f"of bootstrap resamples of the episodes. The second best is {names[1]} with a return of "
        f"{comparison.cells[names[1], ALL].reward:.3f}."
    )


def _frame(comparison: Comparison) -> str:
    solved, tried = comparison.oracle
    most = fmean(one_touch_bound(comparison.problem, target) for target in comparison.targets)
    return (
        f"The no-touch baseline succeeds in {_share(comparison.no_touch_baseline)} of searches. The full-information "
        f"oracle, which touches every object in every pose before it answers, succeeds in {solved} of {tried}. "
        f"With any sensor, the expected return is at most {most:.3f}, that of touches which reveal the shape."
        f"{_revealed_body(comparison)}{_bound(comparison)}"
    )


def _revealed_body(comparison: Comparison) -> str:
    """Bound for deciders that are shown the body; empty if it is not known."""
    found = comparison.revealed_body
    if found is None:
        return ""
    return (
        " If orientation and size of each object were revealed at first sight, and touches were as the "
        f"sensor model predicts them, it is at most {found.mean:.3f} (standard error {found.standard_error:.3f})."
    )


def _bound(comparison: Comparison) -> str:
    """Comparison of the best decider with the upper bound of the discretised sensor model; empty without a bound."""
    name = max(comparison.deciders, key=lambda name: comparison.cells[name, ALL].reward)
    gap = comparison.gap[name]
    if gap is None:
        return ""
    mean, low, high = gap
    bound = comparison.cells[name, ALL].reward + mean
    return (
        f" The upper bound on the expected return is {bound:.3f} for the discretised sensor model, in which touches "
        f"are independent given the shape; live returns can exceed it. {name} is {abs(mean):.3f} "
        f"{'below' if mean >= 0.0 else 'above'} [{low:+.3f}, {high:+.3f}]."
    )


def _against(name: str, difference: Difference, comparison: Comparison) -> str:
    pairs, reference = difference.mcnemar, comparison.reference
    either = (
        f"of {pairs.num_episodes} episodes, {pairs.first_only} succeed only with {name} and {pairs.second_only} only "
        f"with {reference}"
    )
    if difference.p_value < LEVEL:
        more = "more" if pairs.difference > 0 else "less"
        success = f"succeeds significantly {more} often than {reference}: {either} (p {_p(difference.p_value)})"
    else:
        success = (
            f"and {reference} do not differ significantly in success: {either} (p {_p(difference.p_value)}); "
            f"{_needed(difference, comparison)}"
        )
    return f"{name} {success}. {_touches(name, difference, comparison)}"


def _needed(difference: Difference, comparison: Comparison) -> str:
    """Number of further searches at which the difference would probably be significant, in words."""
    pairs, needed = difference.mcnemar, difference.episodes_for_success
    if needed is None:
        most = 1.0 - (1.0 - 0.95) ** (1.0 / pairs.num_episodes)
        if pairs.first_only + pairs.second_only == 0:
            return f"they differ in fewer than {100 * most:.2g} % of all searches (95 % confidence)"
        return "they succeed equally often, so the number of searches needed cannot be estimated"
    more, each = needed - pairs.num_episodes, math.ceil(needed / len(comparison.targets))
    return (
        f"if the true difference is the observed {abs(pairs.difference):.2g}, about {_round(more)} more searches would "
        f"show it with a probability of {POWER:g} (--episodes {_round(each)})"
    )


def _touches(name: str, difference: Difference, comparison: Comparison) -> str:
    mean, low, high = difference.touches
    if is_small(comparison):
        return (
            f"In touches {name} minus {comparison.reference} is {mean:+.2f}; to tell this from chance takes at least "
            f"{ENOUGH} searches."
        )
    if low <= 0.0 <= high:
        return f"They do not differ significantly in touches ({mean:+.2f} [{low:+.2f}, {high:+.2f}])."
    more = "more" if mean > 0 else "fewer"
    return f"{name} takes {abs(mean):.2f} touches {more} than {comparison.reference} [{low:+.2f}, {high:+.2f}]."


def _calibration(comparison: Comparison) -> list[str]:
    """Sentences on the agreement of stated confidence and fraction correct, for each decider."""
    scores = {name: found.overall for name, found in comparison.calibration.items() if found is not None}
    kept = [name for name, score in scores.items() if score.is_consistent]
    sentences = []
    if kept:
        counts = _and([str(scores[name].count) for name in kept])
        sentences.append(
            f"The stated confidence of {_and(kept)} when confirming agrees with what is right: it is within the 95 % "
            f"interval of {counts} confirmations{', in this order' if len(kept) > 1 else ''}."
        )
    for name, score in scores.items():
        if not score.is_consistent:
            word = "overconfident" if score.mean_stated > score.high else "underconfident"
            sentences.append(
                f"{name} is {word} when confirming: its mean stated confidence is {_share(score.mean_stated)}, and it "
                f"is right in {_share(score.share_right)} [{_share(score.low)}, {_share(score.high)}]."
            )
    return sentences


def _selective(name: str, found: Selective) -> str:
    share, low, high = found.unsure
    said = f"{name} answers “I do not know” in {_share(share)} [{_share(low)}, {_share(high)}] of searches"
    if found.achieved is None or found.stated is None:
        return f"{said}, and gives no other answer."
    right, low, high = found.achieved
    return (
        f"{said}; of its {found.num_answered} other answers {_share(right)} [{_share(low)}, {_share(high)}] are right, "
        f"at a stated confidence of {_share(found.stated)}."
    )


def _and(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _share(value: float) -> str:
    return f"{value:.3f}"


def _p(value: float) -> str:
    return "< 0.001" if value < 0.001 else f"= {value:.2g}"


def _round(number: int) -> str:
    """Round up to two digits."""
    step = 10 ** max(len(str(number)) - 2, 0)
    return str(-(-number // step) * step)
