"""What counts as probing on after certainty."""

import numpy as np

from belief import Belief, Confirm, Probe, Reject, Touch
from benchmarks.overprobing import overprobing, table
from planners import Decision, Episode, Outcome, Step

LABELS = ("cube", "cone")


def episode(arrangement, decisions, outcome=Outcome.CONFIRMED):
    """Decisions are (object, probability that it is a cube when deciding, action); the cube is sought."""
    steps = []
    for index, prob, action in decisions:
        touch = Touch(action.pose, np.zeros(2)) if isinstance(action, Probe) else None
        steps.append(Step(index, Belief.from_probs(LABELS, [prob, 1 - prob]), Decision(action), touch))
    return Episode((0,), 0, arrangement, tuple(steps), outcome)


def test_touches_after_certainty_are_counted_object_by_object():
    some = [
        # The cone: sure after one touch, touched twice more, doubted, and confirmed, which is wrong.
        episode((1, 0), [(0, 0.5, Probe(0)), (0, 0.01, Probe(0)), (0, 0.6, Probe(1)), (0, 0.97, Confirm())]),
        # Rejected as soon as sure; the cube is then certain untouched, which counts nowhere.
        episode((1, 0), [(0, 0.5, Probe(0)), (0, 0.02, Reject()), (1, 0.98, Confirm())]),
        # Never sure.
        episode((0, 1), [(0, 0.5, Probe(0)), (0, 0.7, Confirm())]),
    ]
    found = overprobing(some, 0.95)
    assert (found.objects, found.late_touches) == (2, 1.0)
    assert (found.went_on, found.doubted, found.first_wrong, found.wrong) == (1, 1, 0, 1)


def test_a_search_cut_off_after_certainty_decided_nothing_and_counts_as_wrong():
    cut = episode((0, 1), [(0, 0.5, Probe(0)), (0, 0.99, Probe(0))], Outcome.TRUNCATED)
    assert overprobing([cut], 0.95).wrong == 1


def test_the_table_has_a_row_for_each_decider_that_was_certain():
    sure = episode((0, 1), [(0, 0.5, Probe(0)), (0, 0.99, Confirm())])
    never = episode((0, 1), [(0, 0.5, Confirm())])
    [row] = table({"sure": [sure], "never": [never]}).rows
    assert row[:4] == ("sure", 1, 0.0, 0.0)
