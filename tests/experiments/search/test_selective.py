"""Abstention in the numbers, tables and sentences of a comparison, on episodes made by hand."""

import numpy as np
import pytest

from belief import Belief, Confirm, Probe, Reject, SearchProblem, Touch, Unsure
from belief.statistics import clopper_pearson_interval
from experiments.search.figures import pictures
from experiments.search.play import Seconds
from experiments.search.selective import RANKINGS, selective
from experiments.search.summary import ALL, Summary
from experiments.search.tables import comparison_tables, terminal_table
from experiments.search.verdict import verdict_sentences
from planners import Decision, Episode, Outcome, Step

PROBLEM = SearchProblem(("a", "b"), ("p",), num_objects=2, touch_cost=0.1, unsure_reward=-0.25)


def search(end, number=0, arrangement=(0, 1), **scores):
    """One touch, then an end: "c" confirms the first object, "r" rejects both, "u" is unsure; the target is "a"."""
    belief = Belief.from_probs(tuple("ab"), (0.5, 0.5))
    ends = {"c": [Confirm()], "r": [Reject(), Reject()], "u": [Unsure()], "t": [Probe(0)]}[end]
    steps = [Step(0, belief, Decision(Probe(0)), Touch(0, np.zeros(2)))]
    for index, action in enumerate(ends):
        steps.append(Step(index, belief, Decision(action, scores), None))
    outcome = {"c": Outcome.CONFIRMED, "r": Outcome.EXHAUSTED, "u": Outcome.UNSURE, "t": Outcome.TRUNCATED}[end]
    return Episode((0, 0, number), 0, arrangement, tuple(steps), outcome)


def answer(prob, conflict, is_right=True, number=0, end="c"):
    arrangement = (0, 1) if is_right == (end == "c") else (1, 1)
    return search(end, number, arrangement, answer_prob=prob, log_conflict=conflict)


def unsure(reason="is_conflict", **scores):
    return search("u", log_conflict=4.0, **{reason: 1.0}, **scores)


EPISODES = [
    *(answer(0.99, -1.0) for _ in range(6)),
    answer(0.98, 0.5, end="r"),
    answer(0.96, 2.0, is_right=False),
    unsure(),
    unsure("is_doubtful", answer_prob=0.7),
    search("t", log_conflict=0.0),
]


def compared(by_decider, rng, problem=PROBLEM):
    return Summary.from_episodes(
        problem,
        {(name, "a"): some for name, some in by_decider.items()},
        {(name, "a"): Seconds(0.1, 0.2, 0.3, 10) for name in by_decider},
        next(iter(by_decider)),
        rng,
    )


def test_shares_are_of_all_searches_and_confidence_is_of_the_answers(rng):
    found = selective(EPISODES, rng)
    assert found.num_episodes == 11
    assert found.unsure == (2 / 11, *clopper_pearson_interval(2, 11))
    assert found.wrong == (1 / 11, *clopper_pearson_interval(1, 11))
    assert dict(found.reasons) == {"is_conflict": 1, "is_doubtful": 1, "is_suspicious": 0, "is_cut_off": 0}
    assert found.num_answered == 8
    assert found.stated == pytest.approx((6 * 0.99 + 0.98 + 0.96) / 8)
    assert found.achieved == (7 / 8, *clopper_pearson_interval(7, 8))


def test_a_decider_that_is_always_unsure_has_no_risk_and_no_curve(rng):
    found = selective([unsure()] * 3, rng)
    assert (found.unsure[0], found.num_answered, found.stated, found.achieved) == (1.0, 0, None, None)
    assert not found.curves
    comparison = compared({"shy": [unsure()] * 3, "x": [search("c")] * 3}, rng)
    assert any("gives no other answer" in sentence for sentence in verdict_sentences(comparison))
    for table in comparison_tables(comparison):
        assert table.csv()
    for picture in pictures(comparison):
        assert all("<svg" in panel for panel in picture.inline())


def test_unsure_searches_are_counted_priced_and_shown(rng):
    comparison = compared({"x": EPISODES, "bare": [search("c")] * 11}, rng)
    cell = comparison.cells["x", ALL]
    assert (cell.successes, cell.wrong, cell.none, cell.truncated, cell.unsure) == (7, 1, 0, 1, 2)
    assert cell.reward == pytest.approx((7 - 1 - 1 - 2 * 0.25) / 11 - 0.1)
    assert comparison.differences["bare"].mcnemar.first_only == 4  # one that is unsure does not succeed
    tables = {table.name: table for table in comparison_tables(comparison)}
    assert tables["results"].rows[0][tables["results"].headings.index("unsure")] == 2
    [row] = tables["abstention"].rows
    assert dict(zip(tables["abstention"].headings, row, strict=True))["doubtful"] == 1
    assert len(tables["selective_risk"].rows) == len(RANKINGS)
    assert "-0.25 for “I do not know”" in tables["results"].note
    assert "unsure" in terminal_table(comparison, 200).headings
    assert any("0.182" in sentence and "8 other answers" in sentence for sentence in verdict_sentences(comparison))
