"""The stopping rules on information states worked out by hand."""

import numpy as np
import pytest
from scipy import stats

from belief import Belief, Composition, Confirm, Probe, Reject, SearchProblem, Touch
from belief.errors import InvalidArgument
from belief.observation_model import OutcomeTable
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import Decision, InformationState, Outcome, make_decider, search, search_lockstep
from planners.decider import SequentialDecider
from planners.probing import FixedOrder
from planners.registry import DECIDERS, NEED_FILES
from planners.stopping import PosteriorThresholds, StopOverride, ThresholdRule

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


class Always:
    def __init__(self, action):
        self.action = action

    def decide(self, info, rng):
        return Decision(self.action, {"own": 7.0})


def confident(action):
    return StopOverride(PosteriorThresholds(0.9, 0.1), Always(action), FixedOrder())


@pytest.mark.parametrize("action", [Probe(1), Confirm(), Reject()])
def test_the_rule_is_asked_first(action, rng):
    assert confident(action).decide(info(posterior=0.95), rng).action == Confirm()
    assert confident(action).decide(info(posterior=0.05), rng).action == Reject()


def test_otherwise_the_deciders_probe_is_taken_with_its_scores(rng):
    decision = confident(Probe(1)).decide(info(posterior=0.5), rng)
    assert decision == Decision(Probe(1), {"own": 7.0})


@pytest.mark.parametrize("action", [Confirm(), Reject()])
def test_a_decider_that_would_stop_too_soon_is_overruled(action, rng):
    decision = confident(action).decide(info(posterior=0.5), rng)
    assert decision.action == Probe(0)
    assert decision.scores["overruled"] == 1.0


def test_stops_keep_the_rules_promise_whatever_the_decider():
    model = random_model(np.random.default_rng(3), sharpness=3.0)
    problem = SearchProblem(model.shape_labels, ("p0", "p1", "p2"), 4, touch_limit=200)
    worlds = [SyntheticWorld(model, sample_arrangement(problem, np.random.default_rng([s, 9]))) for s in range(300)]
    decider = StopOverride(PosteriorThresholds(0.95, 0.05, max_touches=100), Always(Confirm()), FixedOrder())
    episodes = search_lockstep(worlds, decider, problem, [0] * 300, model, [(s,) for s in range(300)])
    stops = [
        e.success
        for e in episodes
        if e.outcome is Outcome.CONFIRMED and e.steps[-1].decision.scores["target_prob"] >= 0.95
    ]
    assert len(stops) > 200
    assert stats.binomtest(sum(stops), len(stops), 0.95, alternative="less").pvalue > 1e-3
