"""Searches that end with "I do not know" in the numbers, tables and sentences of a comparison."""

import numpy as np
import pytest

from belief import Belief, Confirm, Probe, SearchProblem, Touch, Unsure
from experiments.search.play import Seconds
from experiments.search.summary import ALL, Summary
from experiments.search.verdict import comparison_tables, terminal_table, verdict_sentences
from planners import Decision, Episode, Outcome, Step

PROBLEM = SearchProblem(("a", "b"), ("p",), num_objects=2, touch_cost=0.1, unsure_reward=-0.25)


def search(outcome, shapes=(0, 1)):
    """One touch, then an end; the target is "a"."""
    belief = Belief.from_probs(tuple("ab"), (0.5, 0.5))
    ends = {Outcome.CONFIRMED: Confirm(), Outcome.UNSURE: Unsure(), Outcome.TRUNCATED: Probe(0)}
    touched = Step(0, belief, Decision(Probe(0)), Touch(0, np.zeros(2)))
    return Episode((0, 0, 0), 0, shapes, (touched, Step(0, belief, Decision(ends[outcome]), None)), outcome)


def test_unsure_searches_are_counted_priced_and_shown(rng):
    right, wrong = search(Outcome.CONFIRMED), search(Outcome.CONFIRMED, (1, 0))
    mixed = [*[right] * 6, wrong, *[search(Outcome.UNSURE)] * 2, search(Outcome.TRUNCATED)]
    comparison = Summary.from_episodes(
        PROBLEM,
        {("x", "a"): mixed, ("bare", "a"): [right] * 10},
        {(name, "a"): Seconds(0.1, 0.2, 0.3, 10) for name in ("x", "bare")},
        "x",
        rng,
    )
    cell = comparison.cells["x", ALL]
    assert (cell.successes, cell.wrong, cell.none, cell.truncated, cell.unsure) == (6, 1, 0, 1, 2)
    assert cell.reward == pytest.approx((6 - 1 - 1 - 2 * 0.25) / 10 - 0.1)
    assert comparison.differences["bare"].mcnemar.first_only == 4  # one that is unsure does not succeed
    results = {table.name: table for table in comparison_tables(comparison)}["results"]
    assert results.rows[0][results.headings.index("unsure")] == 2
    assert "-0.25 for “I do not know”" in results.note
    assert "unsure" in terminal_table(comparison).headings
    assert any("in 0.200 of the searches; it is right in 6 of its 7" in said for said in verdict_sentences(comparison))
