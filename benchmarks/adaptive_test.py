"""An adaptive test that classifies examinees, against a fixed length and Wald's sequential test of the same items.

    python -m benchmarks.adaptive_test --examinees 2000

A bank of 300 items of the three-parameter logistic model; abilities are standard normal, and whoever is above the cut
passes. The usual rules ask the items with the largest Fisher information at the cut: a fixed number of them, or until
the likelihood ratio of two abilities beside the cut is large enough (SPRT). Here the ability is the context of the
classes "fails" and "passes", and stops are planned for a cost of errors. All tests end after 60 items.

Of each usual rule, the fewest items are shown with which it errs no more often *on the same examinees*, where one of
two settings may be drawn by chance for each of them (else it depends on which settings were tried): of SPRT with
abilities 0.2 beside the cut, eight error rates; of "best SPRT" also six distances, 48 settings. The certificate is made
and checked 1000 times, each time with other examinees.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit
from scipy.stats import norm

from belief.statistics.stop_thresholds import CandidateStops, certified_thresholds
from belief.table import Table
from planners import ActiveClassification

ITEMS, LONGEST, CUT, GRID = 300, 60, 0.5, 24
WIDTH = 0.2  # of SPRT as it is usual
CERTIFIED = 20  # items of the test that is certified
Floats = NDArray[np.float64]


def bank(rng: np.random.Generator) -> Floats:
    """Discrimination, difficulty and chance level of each item, ``(P, 3)``."""
    return np.stack([rng.lognormal(0.0, 0.3, ITEMS), rng.normal(0.0, 1.0, ITEMS), rng.uniform(0.0, 0.2, ITEMS)], axis=1)


def right_probs(items: Floats, abilities: Floats) -> Floats:
    """p(right answer | item, ability), ``(P, …)``."""
    a, b, c = (items[:, i].reshape(-1, *[1] * np.ndim(abilities)) for i in range(3))
    return np.asarray(c + (1.0 - c) * expit(1.7 * a * (abilities - b)))


def task_of(items: Floats, longest: int) -> ActiveClassification:
    """The test as a task: abilities of equal probability on each side of the cut are contexts."""
    below = norm.cdf(CUT)
    middles = (np.arange(GRID) + 0.5) / GRID
    abilities = norm.ppf(np.stack([below * middles, below + (1.0 - below) * middles]))
    probs = right_probs(items, abilities)
    return ActiveClassification.from_probs(
        np.stack([1.0 - probs, probs], axis=-1),
        ("fails", "passes"),
        prior=np.array([below, 1.0 - below]),
        stop=np.inf,
        max_actions=longest,
        depth=1,
    )


def usual(items: Floats, answers: NDArray[np.int64], passes: NDArray[np.bool_]) -> dict[str, list[tuple[float, float]]]:
    """Mean number of items and share of errors of the usual rules, for many settings of each."""
    probs = right_probs(items, np.array([CUT]))[:, 0]
    chance, slope = items[:, 2], 1.7 * items[:, 0]
    information = slope**2 * (1 - probs) / probs * ((probs - chance) / (1 - chance)) ** 2
    order = np.argsort(-information)[:LONGEST]
    given, found = answers[:, order], {"fixed length": [], "SPRT": [], "best SPRT": []}
    grid = np.linspace(-3.5, 3.5, 81)
    curve = right_probs(items[order], grid)
    logs = np.cumsum(np.where(given[..., None], np.log(curve), np.log1p(-curve)), axis=1) + norm.logpdf(grid)
    above = np.exp(np.logaddexp.reduce(logs[..., grid > CUT], axis=2) - np.logaddexp.reduce(logs, axis=2))
    for number in range(1, LONGEST + 1):
        found["fixed length"].append((float(number), float(((above[:, number - 1] > 0.5) != passes).mean())))
    for width in (0.1, 0.2, 0.3, 0.4, 0.5, 0.7):
        low, high = right_probs(items[order], np.array([CUT - width, CUT + width])).T
        ratio = np.cumsum(np.where(given, np.log(high / low), np.log((1 - high) / (1 - low))), axis=1)
        for risk in (0.2, 0.15, 0.1, 0.07, 0.05, 0.03, 0.02, 0.01):
            over = np.abs(ratio) >= np.log((1 - risk) / risk)
            over[:, -1] = True
            last = over.argmax(axis=1)
            errors = (ratio[np.arange(len(last)), last] > 0.0) != passes
            for name in ("SPRT", "best SPRT") if width == WIDTH else ("best SPRT",):
                found[name].append((float((last + 1).mean()), float(errors.mean())))
    return found


def fewest_items(settings: list[tuple[float, float]], wrong: float) -> float | None:
    """Mean number of items with which a rule errs in ``wrong``, by chance between two settings; None if in none."""
    low = [one for one in settings if one[1] <= wrong]
    pairs = [(one, two) for one in low for two in settings if two[0] < one[0] and two[1] > wrong]
    between = [two[0] + (one[0] - two[0]) * (two[1] - wrong) / (two[1] - one[1]) for one, two in pairs]
    return min([*between, *(one[0] for one in low)], default=None)


def kept(candidates: CandidateStops, risk: float, replays: int, each: int, rng: np.random.Generator) -> float:
    """Share of replays in which, after each number of items, at most a share ``risk`` of all stops is wrong."""
    good = 0
    for _ in range(replays):
        drawn = rng.permutation(candidates.num_searches)
        found = certified_thresholds(candidates.of(drawn[:each]), risk, 0.9)
        stops, wrong = candidates.of(drawn[each:]).counts(found.thresholds)
        good += bool((wrong <= risk * np.maximum(stops, 1) + 1e-12).all())
    return good / replays


def main() -> None:
    """Simulate examinees, and print items and errors of all rules."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--examinees", type=int, default=2_000)
    parser.add_argument("--planned", type=int, default=300, help="examinees of the model, for which stops are planned")
    parser.add_argument("--replays", type=int, default=1_000)
    given = parser.parse_args()
    rng = np.random.default_rng(0)
    items, abilities = bank(rng), rng.normal(size=given.examinees)
    answers = (rng.random((len(abilities), ITEMS)) < right_probs(items, abilities).T).astype(np.int64)
    passes, rules = abilities > CUT, usual(items, answers, abilities > CUT)
    rows, task = [], task_of(items, LONGEST)
    for cost in (300.0, 1000.0):
        planned = task.planned(cost, num_cases=given.planned)
        found = planned.evaluate(answers, passes.astype(int), ("adaptive",)).rows()[0]
        row = [f"an error costs {cost:g} items", found["actions"], 1.0 - found["right"], found["stated"]]
        for rule in ("fixed length", "SPRT", "best SPRT"):
            least = fewest_items(rules[rule], row[2])
            row += [least, None if least is None else 1.0 - row[1] / least]
        rows.append(row)
    columns = ["stops", ("items", ".1f"), ("wrong", ".3f"), ("stated", ".3f")]
    for rule in ("fixed length", "SPRT", "best SPRT"):
        columns += [(rule, ".1f"), (f"fewer than {rule}", ".0%")]
    print(Table("", columns, rows, f"{len(abilities)} examinees."))
    whole = task_of(items, CERTIFIED).evaluate(answers, passes.astype(int), ("adaptive",)).answers["adaptive"]
    probs = np.array([one.probs for one in whole])
    searches, steps = np.divmod(np.arange(probs.shape[0] * probs.shape[1]), probs.shape[1])
    named = probs.argmax(axis=2) != passes[:, None].astype(int)
    candidates = CandidateStops(searches, steps, np.minimum(probs.max(axis=2), 1.0).ravel(), named.ravel(), len(probs))
    share = kept(candidates, 0.1, given.replays, len(probs) // 2, rng)
    print(f"certificate, wrong ≤ 0.1 with confidence 0.9: kept in {share:.3f} of {given.replays} replays")


if __name__ == "__main__":
    main()
