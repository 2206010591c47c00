"""Tables of a comparison whose deciders may answer "I do not know"."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.reporting.tables import Table, Value
from experiments.search.summary import ALL, Comparison


def abstention_table(comparison: Comparison) -> Table:
    """Success, wrong answers and abstention of every decider; stated and achieved confidence of its answers."""
    rows: list[Sequence[Value]] = []
    for name, found in comparison.selective.items():
        if found is None:
            continue
        achieved: tuple[Value, Value] = (
            (None, None) if found.achieved is None else (found.achieved[0], found.achieved[1:])
        )
        unsure: tuple[Value, ...] = (found.unsure[0], found.unsure[1:], *found.reasons.values())
        rows.append(
            (
                *(name, found.num_episodes, comparison.cells[name, ALL].success, found.wrong[0], found.wrong[1:]),
                *unsure,
                *(found.num_answered, found.stated, *achieved),
            )
        )
    return Table(
        "Answers and “I do not know”",
        [
            *("decider", ("searches", "d"), ("success", ".3f"), ("wrong", ".3f"), ("95 %", ".3f")),
            *(
                ("unsure", ".3f"),
                ("95 % ", ".3f"),
                ("conflict", "d"),
                ("doubtful", "d"),
                ("suspicious", "d"),
                ("touch limit", "d"),
            ),
            *(("answered", "d"), ("stated", ".3f"), ("right", ".3f"), ("95 %  ", ".3f")),
        ],
        rows,
        "Fractions of all searches with Clopper-Pearson intervals: success, wrong answer, “I do not know” (unsure). "
        "Conflict: the touches do not fit the world that the sensor knows. Doubtful: the answer would have been right "
        "with too small a probability. Touch limit: a further touch was not allowed. Stated: mean stated probability "
        "that an answer is right. Right: fraction of answers that are.",
        "abstention",
    )


def selective_risk_table(comparison: Comparison) -> Table:
    """Selective risk of every decider at full and at half coverage, and the area under its curve."""
    rows: list[Sequence[Value]] = []
    for name, found in comparison.selective.items():
        for ranking, curve in ({} if found is None else found.curves).items():
            half = float(curve.risk[(len(curve.risk) - 1) // 2])
            rows.append((name, ranking, curve.coverage[-1], curve.full_risk, half, curve.area, curve.interval))
    return Table(
        "Selective risk",
        [
            *("decider", ("ranked by", ""), ("coverage", ".3f"), ("risk", ".4f"), ("risk of the better half", ".4f")),
            *(("area", ".4f"), ("95 %", ".4f")),
        ],
        rows,
        "Coverage: fraction of searches that were answered. Risk: fraction of these answers that are wrong. The better "
        "half: the answers with the highest stated confidence, or with the least conflict. Area: mean risk over all "
        "coverages, with a bootstrap interval over answers; without a wrong answer it is [0, 0], which does not mean "
        "that no answer can be wrong.",
        "selective_risk",
    )
