"""The stopping rules on information states worked out by hand."""

import numpy as np
import pytest

from belief import Belief, Composition, Confirm, Reject, SearchProblem, Touch
from planners import InformationState
from planners.stopping import ConsecutiveFrames, PosteriorThresholds

PROBLEM = SearchProblem(("a", "b", "c", "d"), ("p", "q"), num_objects=4)


def info(*frame_probs, posterior=0.25, object_index=0, problem=PROBLEM):
    """Target "a"; one touch for every frame probability, and this posterior."""
    touches = tuple(Touch(0, np.log([p, *[(1 - p) / 3] * 3])) for p in frame_probs)
    belief = Belief.from_probs("abcd", [posterior, *[(1 - posterior) / 3] * 3])
    return InformationState(problem, 0, belief, touches, object_index)


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
    rule = ConsecutiveFrames(high=0.9, low=0.1, max_touches=4)
    assert action(rule.stop(info(*frames))) == expected


def test_the_papers_rule_ignores_the_fused_belief():
    assert ConsecutiveFrames().stop(info(0.5, posterior=0.999999)) is None


@pytest.mark.parametrize(
    ("posterior", "expected"), [(0.991, Confirm()), (0.98, None), (0.02, None), (0.009, Reject()), (0.0, Reject())]
)
def test_posterior_thresholds_stop_beyond_either_threshold(posterior, expected):
    assert action(PosteriorThresholds(0.99, 0.01).stop(info(posterior=posterior))) == expected


@pytest.mark.parametrize(("posterior", "expected"), [(0.6, Confirm()), (0.4, Reject())])
def test_after_the_last_touch_the_likelier_decision_is_taken(posterior, expected):
    assert action(PosteriorThresholds(max_touches=2).stop(info(0.5, 0.5, posterior=posterior))) == expected


def test_the_last_of_all_distinct_objects_is_confirmed_untouched():
    assert action(PosteriorThresholds().stop(info(posterior=0.3, object_index=3))) == Confirm()


def test_the_last_object_is_tested_when_the_target_may_be_absent():
    problem = SearchProblem(tuple("abcd"), ("p", "q"), 4, Composition.INDEPENDENT)
    assert PosteriorThresholds().stop(info(posterior=0.3, object_index=3, problem=problem)) is None
    fewer = SearchProblem(tuple("abcd"), ("p", "q"), 3)
    assert PosteriorThresholds().stop(info(posterior=0.3, object_index=2, problem=fewer)) is None


def test_a_target_ruled_out_is_never_confirmed_not_even_on_the_last_object():
    assert action(PosteriorThresholds().stop(info(posterior=0.0, object_index=3))) == Reject()


@pytest.mark.parametrize(("confirm", "reject"), [(0.1, 0.9), (0.5, 0.5), (1.1, 0.0), (0.9, -0.1)])
def test_thresholds_in_the_wrong_order_are_refused(confirm, reject):
    with pytest.raises(ValueError, match="reject < confirm"):
        PosteriorThresholds(confirm, reject)
