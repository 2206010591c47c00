"""What robots that may be unsure did is counted, by hand."""

import numpy as np
import pytest

from belief import Belief, Confirm, Probe, Reject, Touch, Unsure
from belief.statistics import clopper_pearson_interval
from benchmarks.unsure_robots import _abstention
from planners import Decision, Episode, Outcome, Step


def episode(outcome, success=False, reason=None, stated=0.9, touched=2):
    target = 0 if success or outcome is not Outcome.CONFIRMED else 1
    action = {Outcome.CONFIRMED: Confirm(), Outcome.UNSURE: Unsure(), Outcome.EXHAUSTED: Reject()}[outcome]
    belief = Belief.from_probs(("a", "b"), (0.9, 0.1))
    steps = [Step(0, belief, Decision(Probe(0)), Touch(0, np.zeros(2)))] * touched
    last = Step(0, belief, Decision(action, {"answer_prob": stated} | ({} if reason is None else {reason: 1.0})), None)
    return Episode((0, target, 0), target, (0,), (*steps, last), outcome)


def test_what_robots_that_may_be_unsure_did_is_counted():
    right, wrong = episode(Outcome.CONFIRMED, True, stated=0.97), episode(Outcome.CONFIRMED, stated=0.95, touched=4)
    doubt, alarm = (episode(Outcome.UNSURE, reason=reason) for reason in ("is_doubtful", "is_conflict"))
    found = _abstention([[right, doubt, alarm, alarm], [right, wrong, right, right], [alarm, right, right, right]])
    assert (found["alarms"], found["searches_to_alarm"]) == (2, 2.0)  # in the third search, and in the first
    assert found["touches_to_alarm"] == 4.0  # of six, and of two
    assert (found["wrong"][0], found["unsure"][0]) == (pytest.approx(1 / 12), pytest.approx(4 / 12))
    assert found["right"] == [7 / 8, *clopper_pearson_interval(7, 8)]
    for share, low, high in (found["wrong"], found["unsure"]):
        least, most = clopper_pearson_interval(round(12 * share), 12)
        assert low <= least
        assert high >= most
    for events, name in (([[doubt] * 3] * 2, "unsure"), ([[wrong] * 3] * 2, "wrong")):  # always: no point
        assert _abstention(events)[name] == [1.0, *clopper_pearson_interval(6, 6)]
    assert _abstention([[doubt]])["right"] is None
    assert _abstention([[doubt]])["searches_to_alarm"] is _abstention([[doubt]])["touches_to_alarm"] is None
