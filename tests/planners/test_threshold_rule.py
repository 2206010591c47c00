"""The paper's threshold rule on information states that were worked out by hand."""

import numpy as np
import pytest

from belief import Belief, Confirm, Reject, SearchProblem, Touch
from belief.errors import InvalidArgument
from planners import InformationState
from planners.stopping import ThresholdRule

PROBLEM = SearchProblem(("a", "b", "c", "d"), ("p", "q"), num_objects=4)


def info(*frame_probs, posterior=0.25):
    """Target "a"; one touch for every frame probability, and this posterior."""
    touches = tuple(Touch(0, np.log([p, *[(1 - p) / 3] * 3])) for p in frame_probs)
    belief = Belief.from_probs(tuple("abcd"), [posterior, *[(1 - posterior) / 3] * 3])
    return InformationState(PROBLEM, 0, belief, touches)


def action(decision):
    return None if decision is None else decision.action


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        ((), None),
        ((0.95,), None),
        ((0.95, 0.95), Confirm()),
        ((0.95, 0.5, 0.95), None),
        ((0.5, 0.95, 0.95), Confirm()),
        ((0.05,), Reject()),
        ((0.95, 0.05), Reject()),
        ((0.5, 0.5), None),
        ((0.5,) * 4, Reject()),
    ],
)
def test_the_papers_rule_looks_at_the_last_two_frames(frames, expected):
    rule = ThresholdRule(high=0.9, low=0.1, max_touches=4)
    decision = rule.stop(info(*frames))
    assert action(decision) == expected
    if decision is not None:
        assert decision.scores == pytest.approx({"frame_prob": frames[-1], "target_prob": 0.25})


def test_a_frame_at_both_thresholds_neither_confirms_nor_rejects():
    state = InformationState(PROBLEM, 0, Belief.uniform(PROBLEM.shape_labels), (Touch(0, np.zeros(4)),))
    assert ThresholdRule(high=0.25, low=0.25, num_consecutive=1).stop(state) is None


@pytest.mark.parametrize(("high", "low"), [(1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (0.5, 0.5)])
def test_thresholds_at_the_ends_and_equal_ones_are_thresholds(high, low):
    assert ThresholdRule(high=high, low=low).stop(info()) is None


def test_the_papers_rule_ignores_the_fused_belief():
    assert ThresholdRule().stop(info(0.5, posterior=0.999999)) is None


def test_touches_without_logits_are_refused():
    history = (Touch(1, features=np.zeros(3)),)
    with pytest.raises(InvalidArgument, match="pose 1 has no logits"):
        ThresholdRule().stop(InformationState(PROBLEM, 0, Belief.uniform(tuple("abcd")), history))
