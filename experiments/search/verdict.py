"""Verdict and tables of a comparison: how often each decider is right and how fast, why it fails, what is significant.

The answer comes first, in plain words; returns, intervals, tests and bootstraps are details.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from statistics import fmean, median
from typing import NamedTuple

from belief.metrics.calibration_at_stop import StopScore
from belief.naming import UNLISTED
from belief.problem import Confirm, Reject
from belief.statistics.comparison import LEVEL, POWER
from belief.table import Table, Value, ends, interval
from experiments.search.play import FULL_INFORMATION
from experiments.search.summary import ALL, Cell, Difference, Summary
from planners import Episode, Outcome
from planners.episode import judged
from planners.solve import one_touch_bound

LEAST_DOUBT = 0.025
"""A decider whose return is the highest in at least this fraction of bootstrap resamples may be the best."""
ENOUGH = 20
"""Least number of searches after which a decider is called the best; resamples of fewer are too much alike."""
GUESS = "random_confirm"
"""The decider that answers without a touch on purpose."""
_ROLES = {
    "threshold": ", the paper's rule,",
    GUESS: ", which guesses,",
    FULL_INFORMATION: ", which touches all objects in all poses,",
}
_MOST_NAMED, _MOST_REASONS, _MOST_PAIRS = 6, 3, 2  # deciders in the answer; of each, reasons of failures and pairs
_PROBABLE, _POSSIBLE = 0.5, 0.05  # probabilities of the target at a wrong decision


def tied(comparison: Summary) -> list[str]:
    """Deciders that may be the best, by return; more than one is a tie."""
    names = by_return(comparison)
    found = [name for name in names if comparison.prob_best[name] >= LEAST_DOUBT]
    return found or names[:1]


def is_small(comparison: Summary) -> bool:
    """Whether there are too few searches to tell deciders apart."""
    return comparison.cells[comparison.reference, ALL].num_episodes < ENOUGH


def by_return(comparison: Summary) -> list[str]:
    """All deciders, the highest mean return first."""
    return sorted(comparison.deciders, key=lambda name: -comparison.cells[name, ALL].reward)


def verdict_sentences(comparison: Summary) -> list[str]:
    """The answer, then its details."""
    return [*answer_sentences(comparison), *detail_sentences(comparison)]


def answer_sentences(comparison: Summary) -> list[str]:
    """Sentences in plain words: how often each decider is right and with how many touches, and why others fail.

    Also who is surer, or less sure, than it should be.
    """
    names = called(comparison)
    reasons = [failure_sentence(names[name], comparison.of(name)) for name in by_return(comparison)]
    return [_answer(comparison), *filter(None, reasons), *_miscalibrated(comparison)]


def called(comparison: Summary) -> dict[str, str]:
    """Deciders by name as text calls them: without settings, if no other is called so."""
    short = {name: name.partition("(")[0] for name in comparison.deciders}
    number = Counter(short.values())
    return {name: word if number[word] == 1 else name for name, word in short.items()}


def detail_sentences(comparison: Summary) -> list[str]:
    """Sentences on returns, bounds, differences from the reference and their significance, and stated confidence."""
    sentences = [_best(comparison), _frame(comparison)]
    sentences += [
        f"{success_sentence(name, comparison.reference, found, len(comparison.targets))}. "
        f"{_touches(name, found, comparison)}"
        for name, found in comparison.differences.items()
    ]
    sentences += _calibrated(comparison)
    if comparison.is_selective:
        sentences += [_unsure(name, comparison.cells[name, ALL]) for name in comparison.deciders]
    if comparison.pressed_again:
        sentences.append(f"{comparison.pressed_again} presses did not settle and were repeated.")
    return sentences


def _answer(comparison: Summary) -> str:
    """How often each decider is right and with how many touches, the best first, and whether there is a best one."""
    words, small, number = called(comparison), is_small(comparison), len(comparison.of(comparison.reference))
    ranked = {name: comparison.cells[name, ALL] for name in by_return(comparison)}
    best, *_ = ranked
    equals = [best] if small else [name for name in ranked if name in tied(comparison)]
    in_words = [f"{words[name]}{_ROLES.get(words[name], '')}" for name in ranked]
    told = [f" in {_told(cell)}" for cell in ranked.values()]
    listed = [f"{who}{share}" for who, share in zip(in_words, told, strict=True)]
    is_there = all(one.target in one.arrangement for one in comparison.of(best))
    subject, ends = in_words[0], ""
    if len(equals) > 1:
        ends = f": as far as {number} searches tell, they are equally good"
    elif len(ranked) > 1 and not small:
        is_most = ranked[best].successes == max(cell.successes for cell in ranked.values())
        cost = "" if is_most else f", where a touch costs {comparison.problem.touch_cost:g} of a success"
        subject = f"{words[best]} is best{cost}: it"
    found = "found the target in" if is_there else "is right in"
    sentences = [f"{subject} {found} {_told(ranked[best], in_full=True)}{_listed(listed[1 : len(equals)])}{ends}"]
    if (next_best := len(equals)) < len(ranked):
        verb = "found it" if is_there else "is right"
        sentences.append(f"{in_words[next_best]} {verb}{told[next_best]}{_listed(listed[next_best + 1 :])}")
    sentences.append(f"The best guess without a touch is right in {100 * comparison.no_touch_baseline:.0f} %")
    if small and len(ranked) > 1:
        sentences.append(f"To call a decider the best takes at least {ENOUGH} searches")
    return f"{'. '.join(sentences)}."


def _listed(told: Sequence[str]) -> str:
    """What is told of each decider, to follow another one; of many, the first ones and the last."""
    shown = [f"; {one}" for one in told]
    if len(shown) > _MOST_NAMED:
        shown = [*shown[: _MOST_NAMED - 1], f"; {len(shown) - _MOST_NAMED} more", shown[-1]]
    return "".join(shown)


def _told(cell: Cell, in_full: bool = False) -> str:
    """Successes and touches in words: all 100 searches, with 3.8 touches on average."""
    share = f"{cell.successes} of {cell.num_episodes}" if in_full else f"{cell.successes}"
    if cell.successes in (0, cell.num_episodes) and cell.num_episodes > 1:
        share = f"all {cell.num_episodes}" if cell.successes else f"none{f' of {cell.num_episodes}' * in_full}"
    touches = f"with {cell.touches:.1f}{' touches on average' * in_full}" if cell.touches else "without a touch"
    return f"{share}{' searches' * in_full}, {touches}"


def failure_sentence(name: str, episodes: Sequence[Episode]) -> str:
    """Why a decider failed, the most frequent reason first; empty if it never failed, or its role says it."""
    failed = [episode for episode in judged(episodes) if not episode.success]
    if not failed or name in (FULL_INFORMATION, GUESS):
        return ""
    if not any(episode.num_touches for episode in episodes):
        first = {type(episode.steps[0].decision.action) for episode in episodes}
        rejects = ", and rejects every object" * all(one.outcome is Outcome.EXHAUSTED for one in episodes)
        how = rejects or ", and confirms the first object" * (first == {Confirm})
        return f"Why {name} fails in {len(failed)}: it answers without a touch{how}."
    by_words = defaultdict[str, list[Failure]](list)
    for failure in map(why_failed, failed):
        by_words[failure.words].append(failure)
    groups = sorted(by_words.values(), key=len, reverse=True)
    told = []
    for found in groups[:_MOST_REASONS]:
        prob, touches = median(one.prob for one in found), median(one.touches for one in found)
        touched = f"{touches:g} touch{'es' * (touches != 1)} of it, probability {prob:.2f}"
        numbers = f" ({'median: ' * (len(found) > 1)}{touched})" if touches else ""
        told.append(f"{f'in {len(found)} ' * (len(groups) > 1)}it {found[0].words}{numbers}")
    rest = sum(map(len, groups[_MOST_REASONS:]))
    told += [f"{rest} have other reasons"] * (rest > 0)
    return f"Why {name} fails in {len(failed)}: {'; '.join(told)}.{_confused(failed)}"


def _confused(failed: Sequence[Episode]) -> str:
    """Which objects were most often taken for which target, as a sentence; empty if none was."""
    pairs = Counter((one.confirmed_shape, one.target) for one in failed if one.confirmed_shape is not None)
    labels = failed[0].steps[0].belief.labels
    shown = [
        f"{'an unlisted object' if shape == UNLISTED else labels[shape]} was taken for {labels[target]}"
        f"{f' {number} times' * (number > 1)}"
        for (shape, target), number in pairs.most_common(_MOST_PAIRS)
    ]
    where = "Most often" if len(pairs) > len(shown) else "There"
    return f" {where}, {' and '.join(shown)}." if shown else ""


class Failure(NamedTuple):
    """The first wrong step of a search: in words, the probability of the target there, and touches of that object."""

    words: str
    prob: float
    touches: int


def why_failed(episode: Episode) -> Failure:
    """The first wrong step of a search that failed; what follows a rejected target is its consequence.

    The probability is that of the belief from all touches, which a decider need not go by.
    """
    touched = Counter[int]()
    for step in episode.steps:
        action, here = step.decision.action, episode.arrangement[step.object_index] == episode.target
        prob, touches = float(step.belief.probs[episode.target]), touched[step.object_index]
        touched[step.object_index] += step.touch is not None
        is_probable, is_possible = prob >= _PROBABLE, prob >= _POSSIBLE
        if isinstance(action, Reject) and here:
            if not touches:
                scores = step.decision.scores
                planned = scores.get("value", math.inf) <= scores.get("value_reject", -math.inf)
                why = ", as its plan expects a touch to cost more than it tells" * planned
                return Failure(f"passed the target over without touching it{why}", prob, touches)
            if is_probable:
                return Failure("gave the target up although all touches together make it probable", prob, touches)
            if is_possible:
                return Failure("gave the target up while it was still possible", prob, touches)
            return Failure("was misled: the touches of the target speak against it", prob, touches)
        if isinstance(action, Confirm):
            if not touches:
                return Failure("confirmed another object without touching it", prob, touches)
            if is_probable:
                return Failure("was misled: the touches of another object speak for it", prob, touches)
            return Failure("confirmed another object although touches do not make it probable", prob, touches)
    words = {Outcome.UNSURE: "answered “I do not know”", Outcome.TRUNCATED: "used up its touches before an answer"}
    return Failure(words.get(episode.outcome, "rejected every object"), prob, touches)


def _best(comparison: Summary) -> str:
    names, equals = by_return(comparison), tied(comparison)
    best = comparison.cells[names[0], ALL]
    low, high = ends(*best.success_interval, ".3f")
    said = (
        f"{names[0]} is best: it succeeds in {_share(best.success)} [{low}, {high}] of "
        f"{best.num_episodes} searches with {best.touches:.1f} touches on average, a return of {best.reward:.3f}."
    )
    if len(names) == 1:
        return said.replace("is best: it succeeds", "succeeds")
    highest = said.replace("is best: it", "has the highest return in the mean: it")
    if is_small(comparison):
        return f"{highest} To call a decider the best takes at least {ENOUGH} searches."
    returns = [found.reward for found in comparison.differences.values()]
    if len(equals) == len(names) and all(found == (0.0, 0.0, 0.0) for found in returns):
        return (
            f"No difference: the return is {best.reward:.3f} for each of {_and(names)}, and the same in every search."
        )
    if len(equals) > 1:
        shares = ", ".join(f"that of {name} in {100 * comparison.prob_best[name]:.0f} %" for name in equals)
        return (
            f"This is a tie of {len(equals)}: no return is certainly the highest. In bootstrap resamples of the "
            f"episodes, the highest return is {shares}. {highest}"
        )
    sure = comparison.prob_best[names[0]]
    if sure > 0.999:
        return f"{said} Its return is almost certainly the highest of the {len(names)}."
    return (
        f"{said} Its return is very probably the highest of the {len(names)}: it is the highest in {100 * sure:.0f} % "
        f"of bootstrap resamples of the episodes. The second best is {names[1]} with a return of "
        f"{comparison.cells[names[1], ALL].reward:.3f}."
    )


def _frame(comparison: Summary) -> str:
    most = fmean(one_touch_bound(comparison.problem, target) for target in comparison.targets)
    is_above = max(comparison.cells[name, ALL].reward for name in comparison.deciders) > most
    return (
        f"The no-touch baseline succeeds in {_share(comparison.no_touch_baseline)} of searches. With any sensor, the "
        f"expected return is at most {most:.3f}, that of touches which reveal the shape"
        f"{'; the mean of few searches can lie above it' * is_above}."
    )


def success_sentence(name: str, reference: str, difference: Difference, num_targets: int | None = None) -> str:
    """Success beside the reference, without a full stop; with ``num_targets`` also how many --episodes are needed."""
    pairs = difference.mcnemar
    p = "< 0.001" if difference.p_value < 0.001 else f"= {difference.p_value:.2g}"
    either = (
        f"of {pairs.num_episodes} episodes, {pairs.first_only} succeed only with {name} and {pairs.second_only} only "
        f"with {reference} (p {p})"
    )
    if difference.p_value < LEVEL:
        more = "more" if pairs.difference > 0 else "less"
        if pairs.num_episodes < ENOUGH:
            return f"{name} succeeds {more} often than {reference}, in too few episodes to rely on: {either}"
        return f"{name} succeeds significantly {more} often than {reference}: {either}"
    needed = _needed(difference, num_targets)
    return f"{name} and {reference} do not differ significantly in success: {either}; {needed}"


def _needed(difference: Difference, num_targets: int | None) -> str:
    """Number of further searches at which the difference would probably be significant, in words."""
    pairs, needed = difference.mcnemar, difference.episodes_for_success
    if needed is None:
        most = 1.0 - (1.0 - 0.95) ** (1.0 / pairs.num_episodes)
        if pairs.first_only + pairs.second_only == 0:
            return f"they differ in fewer than {100 * most:.2g} % of all searches (95 % confidence)"
        return "they succeed equally often, so the number of searches needed cannot be estimated"
    more = needed - pairs.num_episodes
    each = "" if num_targets == 1 else " for each target"
    option = "" if num_targets is None else f" (in all --episodes {_round(math.ceil(needed / num_targets))}{each})"
    return (
        f"if the true difference is the observed {abs(pairs.difference):.2g}, about {_round(more)} more searches would "
        f"show it with a probability of {POWER:g}{option}"
    )


def _touches(name: str, difference: Difference, comparison: Summary) -> str:
    assert difference.touches is not None, "searches have touches"
    mean, low, high = difference.touches
    if is_small(comparison):
        return (
            f"In touches {name} minus {comparison.reference} is {mean:+.2f}; to tell this from chance takes at least "
            f"{ENOUGH} searches."
        )
    if low <= 0.0 <= high:
        return f"They do not differ significantly in touches ({interval(mean, low, high, spec='+.2f')})."
    more, between = "more" if mean > 0 else "fewer", ", ".join(ends(low, high, "+.2f"))
    return f"{name} takes {abs(mean):.2f} touches {more} than {comparison.reference} [{between}]."


def is_calibrated(score: StopScore) -> str:
    """Whether stated confidence and success agree: no disagreement, too few, overconfident or underconfident."""
    if score.is_consistent:
        return "no disagreement" if score.count >= ENOUGH else "too few"
    return "overconfident" if score.mean_stated > score.high else "underconfident"


def _calibrated(comparison: Summary) -> list[str]:
    """Sentences on deciders whose stated confidence agrees with success, or confirm too seldom to say."""
    scores = {name: found.overall for name, found in comparison.calibration.items() if found is not None}
    words = {name: is_calibrated(score) for name, score in scores.items()}
    sentences = []
    if kept := [name for name, word in words.items() if word == "no disagreement"]:
        sentences.append(f"No disagreement between stated confidence and success was found for {_and(kept)}.")
    if few := [f"{name} ({scores[name].count})" for name, word in words.items() if word == "too few"]:
        sentences.append(f"There are too few confirmations to judge the stated confidence of {_and(few)}.")
    return sentences


def _miscalibrated(comparison: Summary) -> list[str]:
    """Sentences on deciders whose stated confidence disagrees with their success."""
    scores = {name: found.overall for name, found in comparison.calibration.items() if found is not None}
    return [
        f"{called(comparison)[name]} is {is_calibrated(score)} when confirming: its mean stated confidence is "
        f"{_share(score.mean_stated)}, "
        f"and it is right in {_share(score.share_right)} [{_share(score.low)}, {_share(score.high)}]."
        for name, score in scores.items()
        if not score.is_consistent
    ]


def _unsure(name: str, cell: Cell) -> str:
    said = f"{name} answers “I do not know” in {_share(cell.unsure / cell.num_episodes)} of the searches"
    answered = cell.num_episodes - cell.unsure - cell.truncated
    return f"{said}; it is right in {cell.successes} of its {answered} other answers."


def _and(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _share(value: float) -> str:
    return f"{value:.3f}"


def _round(number: int) -> str:
    """Round up to two digits."""
    step = 10 ** max(len(str(number)) - 2, 0)
    return str(-(-number // step) * step)


_MOST_ROWS = 40  # a longer table has no rows of single targets


def comparison_tables(comparison: Summary) -> list[Table]:
    """All tables of a comparison."""
    results = results_table(comparison)
    return [
        results if comparison.is_selective else results.without(["unsure"]),
        _differences(comparison),
        _stated_confidence(comparison),
        _times(comparison),
    ]


def results_table(comparison: Summary) -> Table:
    """Results of every decider for every target, and for all of them."""
    rows, unsure = [], comparison.problem.unsure_reward
    unsure_words = "" if unsure is None else f"{unsure:g} for “I do not know”, "
    for decider in comparison.deciders:
        for target in [*comparison.targets, ALL]:
            cell = comparison.cells[decider, target]
            counts = (cell.wrong, cell.none, cell.truncated, cell.unsure)
            touched = (cell.touches, *cell.touch_quantiles)
            returned = (cell.reward, comparison.prob_best[decider] if target == ALL else None)
            rows.append(
                (decider, target, cell.num_episodes, cell.success, cell.success_interval, *counts, *touched, *returned)
            )
    return Table(
        "Success by target",
        [
            *("decider", ("target", ""), ("searches", "d", "episodes"), ("success", ".3f"), ("95 %", ".3f")),
            *(("wrong", "d"), ("none", "d"), ("cut off", "d", "truncated"), ("unsure", "d"), ("touches", ".2f")),
            *(("half ≤", "d", "touches_median"), ("90 % ≤", "d", "touches_90"), ("most", "d", "touches_most")),
            *(("return", ".3f"), ("P(best)", ".3f", "prob_best")),
        ],
        rows,
        "Wilson intervals. Wrong: the decider confirmed an object of another shape. None: it rejected every object "
        "although the target was there. Cut off: the search reached the touch limit. "
        + ("Unsure: it answered “I do not know”. " if comparison.is_selective else "")
        + f"Return: +1 for success, {unsure_words}−1 otherwise, minus {comparison.problem.touch_cost:g} per touch. "
        "P(best): fraction of bootstrap resamples of the episodes in which the mean return is the highest.",
        "results",
    )


def _differences(comparison: Summary) -> Table:
    rows = [(name, *found.cells) for name, found in comparison.differences.items()]
    return Table(
        f"Difference from {comparison.reference} on the same episodes",
        [
            *("decider", ("success", "+.3f"), ("95 %", "+.3f")),
            *(("only this succeeds", "d"), ("only the reference", "d"), ("p", ".2g"), ("searches needed", ",d")),
            *(("touches", "+.2f"), ("95 %", "+.2f"), ("return", "+.3f"), ("95 %", "+.3f")),
        ],
        rows,
        "Mean differences with 95 % bootstrap intervals over pairs, which are too narrow for fewer than "
        f"{ENOUGH} searches. p: McNemar's test (mid-p), corrected by Holm for "
        "the number of deciders. Searches needed: number of searches per decider at which this test detects a "
        "difference of the observed size with 80 % power."
        + (" A search that ends with “I do not know” does not succeed." if comparison.is_selective else ""),
        "differences",
    )


def _stated_confidence(comparison: Summary) -> Table:
    rows: list[Sequence[Value]] = []
    for name, found in comparison.calibration.items():
        if found is None:
            rows.append((name, 0, None, None, None, "never confirmed"))
            continue
        s = found.overall
        errors = 1.0 - s.mean_stated, 1.0 - s.share_right, (1.0 - s.high, 1.0 - s.low)
        rows.append((name, s.count, *errors, is_calibrated(s)))
    return Table(
        "Stated and observed error of confirmations",
        [
            *("decider", ("confirmed", "d"), ("stated error", ".4f"), ("observed error", ".4f")),
            *(("95 %", ".4f"), ("calibrated", "")),
        ],
        rows,
        "Stated error: mean posterior probability at confirmation that the object is not the target. Observed error: "
        "fraction of confirmed objects that were not the target, with Clopper-Pearson intervals.",
        "stated_confidence",
    )


def _times(comparison: Summary) -> Table:
    rows = []
    for name in comparison.deciders:
        seconds = comparison.cells[name, ALL].seconds
        if seconds.num_touches:
            ms = seconds.ms_per_touch()
            rows.append((name, seconds.num_touches, *ms.values(), sum(ms.values())))
    parts = ((part, ".2f") for part in ("physics", "network", "decision", "sum"))
    return Table("Milliseconds per touch", ["decider", ("touches", "d"), *parts], rows, name="times")


def terminal_table(comparison: Summary) -> Table:
    """The comparison as a table for a terminal: a row for each target below the name of each decider."""
    by_target = len(comparison.deciders) * (len(comparison.targets) + 1) <= _MOST_ROWS
    rows: list[tuple[str, ...]] = []
    for decider in comparison.deciders:
        rows.append((decider,))
        for target in [*(comparison.targets if by_target else ()), ALL]:
            cell = comparison.cells[decider, target]
            success = "–".join(ends(*cell.success_interval, ".2f"))
            ms = "+".join(f"{part:.{part < 10:d}f}" for part in cell.seconds.ms_per_touch().values())
            counts = (str(cell.wrong), str(cell.none + cell.truncated), str(cell.unsure), f"{cell.touches:.2f}")
            rows.append((f"  {target}", f"{cell.success:.3f}", success, *counts, ms if cell.touches else "–"))
    table = Table(
        "",
        ["target", "success", "95 %", "wrong", "none", "unsure", "touches", "ms/touch"],
        rows,
        f"{next(iter(comparison.cells.values())).num_episodes} live searches per decider and target, 95 % Wilson "
        f"intervals. No-touch baseline {comparison.no_touch_baseline:.2f}. ms/touch = physics+network+decision",
    )
    return table if comparison.is_selective else table.without(["unsure"])
