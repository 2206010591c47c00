"""Touches of the deciders of a comparison after the posterior was certain (paper §7.2).

Run: python -m benchmarks.overprobing runs/compare

The table counts the objects whose posterior was certain at some touch: 0.95 that the object is the target, or that it
is not. Touches after: their mean number after the first with a certain posterior. Touched again, revised: fractions of
these objects that were touched again, and of which a later touch made the posterior uncertain again. First wrong,
wrong: fractions for which a decision at the first certain posterior, and the final decision, was wrong or not made.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from belief import Confirm, Reject
from belief.statistics import wilson_interval
from belief.table import Table, Value
from experiments.search.compare import Compare
from planners import Episode

CERTAIN = 0.95
"""Posterior probability from which it counts as certain whether an object is the target."""


@dataclass(frozen=True)
class Overprobing:
    """Touches and errors of a decider after the posterior was certain whether an object is the target (paper §7.2).

    ``late_touches`` is a mean. The others are numbers of objects: certain ones, and of these those touched again, those
    uncertain again, those with a wrong first certain decision, and those with a wrong or no final decision.
    """

    objects: int
    late_touches: float
    went_on: int
    doubted: int
    first_wrong: int
    wrong: int


def overprobing(episodes: Iterable[Episode], confidence: float = CERTAIN) -> Overprobing | None:
    """Count touches and errors after certainty, over all objects; None if the posterior never became certain."""
    found = [
        counted
        for episode in episodes
        for index in range(len(episode.arrangement))
        if (counted := _after_certainty(episode, index, confidence)) is not None
    ]
    if not found:
        return None
    late, doubted, first_wrong, wrong = zip(*found, strict=True)
    went_on = sum(number > 0 for number in late)
    return Overprobing(len(found), float(np.mean(late)), went_on, sum(doubted), sum(first_wrong), sum(wrong))


def _after_certainty(episode: Episode, index: int, confidence: float) -> tuple[int, bool, bool, bool] | None:
    """Late touches, and whether the posterior was doubted, first wrong and wrong; None if it never was certain."""
    steps = [step for step in episode.steps if step.object_index == index]
    probs = np.array([step.belief.probs[episode.target] for step in steps])
    sure = np.maximum(probs, 1.0 - probs) >= confidence
    sure[:1] = False  # before the first touch
    if not sure.any():
        return None
    is_target, first, last = episode.arrangement[index] == episode.target, int(sure.argmax()), steps[-1].decision.action
    right = isinstance(last, Confirm) if is_target else isinstance(last, Reject)
    late = sum(step.touch is not None for step in steps[first:])
    return late, not bool(sure[first:].all()), bool(probs[first] >= 0.5) != is_target, not right


def table(by_decider: dict[str, list[Episode]]) -> Table:
    rows: list[tuple[Value, ...]] = []
    for name, episodes in by_decider.items():
        if (found := overprobing(episodes)) is not None:
            counts = (found.went_on, found.doubted, found.first_wrong, found.wrong)
            shares = [
                share for count in counts for share in (count / found.objects, wilson_interval(count, found.objects))
            ]
            rows.append((name, found.objects, found.late_touches, *shares))
    headings = ("touched again", "revised", "first wrong", "wrong")
    columns = [column for name in headings for column in ((name, ".3f"), (f"95 % of {name}", ".3f"))]
    return Table(
        "Touches after certainty",
        ["decider", ("objects", "d"), ("touches after", ".2f"), *columns],
        rows,
        f"Objects whose posterior reached {CERTAIN:g} at some touch, with 95 % Wilson intervals. Revised: a later "
        "touch made the posterior uncertain again. First wrong: the first certain decision would have been wrong.",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="run folder of a finished comparison")
    comparison = Compare.from_config(parser.parse_args().folder).play()
    print(table({name: comparison.of(name) for name in comparison.deciders}))


if __name__ == "__main__":
    main()
