"""The stopping rules on information states worked out by hand."""

import numpy as np
import pytest

from belief import Belief, Composition, Confirm, Probe, Reject, SearchProblem, Touch
from belief.observation_model import OutcomeTable
from belief.synthetic import SyntheticWorld, random_model
from planners import InformationState, make_decider, search
from planners.decider import SequentialDecider
from planners.registry import DECIDERS, NEED_FILES
from planners.stopping import PosteriorThresholds

PROBLEM = SearchProblem(("a", "b", "c", "d"), ("p", "q"), num_objects=4)


def info(*frame_probs, posterior=0.25, object_index=0, problem=PROBLEM):
    """Target "a"; one touch for every frame probability, and this posterior."""
    touches = tuple(Touch(0, np.log([p, *[(1 - p) / 3] * 3])) for p in frame_probs)
    belief = Belief.from_probs(tuple("abcd"), [posterior, *[(1 - posterior) / 3] * 3])
    return InformationState(problem, 0, belief, touches, object_index)


def action(decision):
    return None if decision is None else decision.action


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


WITH_A_RULE = [
    name
    for name in DECIDERS
    if not {name} & {*NEED_FILES, "pouct"}
    and isinstance(make_decider(name, OutcomeTable(np.eye(2)[None])), SequentialDecider)
]


@pytest.mark.parametrize("num_shapes", [100, 1000])
@pytest.mark.parametrize("name", WITH_A_RULE)
def test_searches_among_very_many_shapes_touch_and_find_the_target(name, num_shapes):
    """Each reading names the true shape with probability above 0.99, so one of 9 objects fails with less than 0.09."""
    model = random_model(np.random.default_rng(0), num_shapes, 3, sharpness=6.0 + np.log(num_shapes))
    problem = SearchProblem(model.shape_labels, ("a", "b", "c"), 3, "independent")
    decider, target = make_decider(name, model.outcome_table(), model), num_shapes // 2
    for place in range(3):
        world = SyntheticWorld(model, [target if index == place else index for index in range(3)])
        episode = search(world, decider, problem, target, model, (0, place))
        assert (episode.success, episode.num_touches > place) == (True, True)


@pytest.mark.parametrize("num_shapes", [2, 4, 12, 13, 99, 100, 200, 1000, 10**6])
@pytest.mark.parametrize("reject", [0.0, 0.01, 0.02, 0.1, 0.5, 0.9])
def test_the_number_of_shapes_alone_rejects_nothing(num_shapes, reject):
    prior, rule = 1 / num_shapes, PosteriorThresholds(0.99, reject)
    assert rule.reject_at(prior) <= min(reject, prior / 2)
    if num_shapes <= 12 and reject <= prior / 2:
        assert rule.reject_at(prior) == reject


def test_an_object_that_others_have_ruled_out_is_rejected_untouched_among_any_number_of_shapes():
    labels = tuple(f"shape_{index}" for index in range(200))
    problem = SearchProblem(labels, ("p",), 4)
    ruled_out = Belief.from_probs(labels, [1e-6, *[(1 - 1e-6) / 199] * 199])
    assert action(PosteriorThresholds().stop(InformationState(problem, 0, ruled_out, (), 1))) == Reject()


@pytest.mark.parametrize("name", ["value_of_information(depth=1)", "value_of_information", "point_based(rounds=(20,))"])
@pytest.mark.parametrize("num_shapes", [100, 200, 1000])
def test_deciders_by_value_reject_untouched_only_where_not_even_a_perfect_touch_pays(name, num_shapes):
    """A perfect touch of the only object raises the return of rejecting it from 1 - 2 / K to 1."""
    labels = tuple(f"shape_{index}" for index in range(num_shapes))
    table = OutcomeTable(np.eye(2)[None, (np.arange(num_shapes) > 0).astype(int)])
    for share, expected in ((0.9, Probe(0)), (1.1, Reject())):
        cost = share * 2 / num_shapes
        problem = SearchProblem(labels, ("p",), 1, "independent", touch_cost=cost, touch_limit=1)
        info = InformationState(problem, 0, Belief.uniform(labels))
        assert make_decider(name, table).decide(info, np.random.default_rng(0)).action == expected
