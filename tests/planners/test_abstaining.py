"""The wrapper that answers "I do not know": when it does, when it does not, and what the scores say about it."""

import math

import numpy as np
import pytest

from belief import Belief, Composition, Confirm, Probe, Reject, SceneBelief, SceneView, SearchProblem, Unsure
from belief.errors import ActiveTouchError, BrokenContract, InvalidArgument
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import Decision, InformationState, Outcome, check_decider, make_decider, search_lockstep
from planners.abstaining import ANSWER, CONFLICT, REASONS, Abstaining, answer_prob


class Always:
    """A decider with one decision."""

    def __init__(self, action, **scores):
        self.decision = Decision(action, scores)

    def decide(self, info, rng):
        return self.decision


class Conflicting(SceneView):
    """A scene whose conflict test has a given statistic."""

    conflict = 0.0

    @property
    def log_conflict(self):
        return type(self).conflict


def state(model, conflict=0.0, touches=(), object_index=0, num_objects=2, **rules):
    """The state after touches of the first objects, as (object, pose); the scene's conflict is made up."""
    rules = {"unsure_reward": 0.0, "composition": Composition.INDEPENDENT, **rules}
    problem = SearchProblem(model.shape_labels, ("p0", "p1", "p2"), num_objects, **rules)
    scene = SceneBelief(problem, model)
    rng = np.random.default_rng(0)
    for index, pose in touches:
        scene.update(index, model.sample(1, [pose], rng))
    view = type("Scene", (Conflicting,), {"conflict": conflict})(scene)
    return InformationState(problem, 0, scene.belief(object_index), scene.touches(object_index), object_index, view)


def reasons(decision):
    return [reason for reason in REASONS if reason in decision.scores]


ALARM = math.log(1 / 0.02)


@pytest.mark.parametrize("action", [Probe(1), Confirm(), Reject()])
def test_an_alarm_ends_the_search_before_any_further_decision(action, model, rng):
    decider = Abstaining(Always(action), promise=0.0, suspicion=np.inf)
    decision = decider.decide(state(model, ALARM), rng)
    assert decision.action == Unsure()
    assert reasons(decision) == ["is_conflict"]
    assert decision.scores[CONFLICT] == pytest.approx(ALARM)
    below = decider.decide(state(model, ALARM - 1e-9), rng)
    assert below.action == action
    assert not reasons(below)


def test_a_suspicion_forbids_answers_and_no_touches_and_passes_when_the_conflict_falls(model, rng):
    suspicious, calm = state(model, math.log(3.51)), state(model, math.log(3.49))
    wrapped = {action: Abstaining(Always(action), promise=0.0) for action in (Probe(0), Reject(), Confirm())}
    assert [decider.decide(suspicious, rng).action for decider in wrapped.values()] == [Probe(0), Reject(), Unsure()]
    assert reasons(wrapped[Confirm()].decide(suspicious, rng)) == ["is_suspicious"]
    assert wrapped[Confirm()].decide(calm, rng).action == Confirm()


@pytest.mark.parametrize(("conflict", "is_alarm"), [(np.inf, True), (-np.inf, False), (1e300, True)])
def test_infinite_conflict_is_recorded_as_a_finite_score(conflict, is_alarm, model, rng):
    decision = Abstaining(Always(Probe(0))).decide(state(model, conflict), rng)
    assert (decision.action == Unsure()) == is_alarm
    assert np.isfinite(decision.scores[CONFLICT])


def test_a_conflict_that_is_no_number_is_an_error_and_no_silence(model, rng):
    with pytest.raises(BrokenContract, match="NaN"):
        Abstaining(Always(Probe(0))).decide(state(model, np.nan), rng)


def test_a_confirmation_below_the_promise_is_not_made(model, rng):
    info = state(model, touches=[(0, 0)])
    kept = Abstaining(Always(Confirm(), own=7.0), promise=info.target_prob).decide(info, rng)
    assert kept.action == Confirm()
    assert kept.scores == {"own": 7.0, CONFLICT: 0.0, ANSWER: info.target_prob}
    broken = Abstaining(Always(Confirm(), own=7.0), promise=info.target_prob + 1e-9).decide(info, rng)
    assert broken.action == Unsure()
    assert reasons(broken) == ["is_doubtful"]
    assert broken.scores["own"] == 7.0


def test_rejecting_an_earlier_object_is_no_answer_and_rejecting_the_last_is(model, rng):
    decider = Abstaining(Always(Reject()), promise=0.9)
    assert decider.decide(state(model), rng).action == Reject()
    last = decider.decide(state(model, object_index=1), rng)
    assert last.action == Unsure()
    assert last.scores[ANSWER] == pytest.approx(0.75**2)  # neither of two untouched objects of four shapes


def test_no_target_is_stated_with_the_probability_that_no_object_is_one(rng):
    sharp = random_model(np.random.default_rng(5), sharpness=6.0)
    poses = [0, 1, 2] * 3
    touched = [(0, pose) for pose in poses] + [(1, pose) for pose in poses]
    both = state(sharp, touches=touched, object_index=1)
    assert Abstaining(Always(Reject())).decide(both, rng).action == Reject()
    # The last object is no target, but the first was rejected untouched: it may have been.
    one = state(sharp, touches=touched[9:], object_index=1)
    assert one.target_prob < 0.01
    assert Abstaining(Always(Reject())).decide(one, rng).action == Unsure()


def test_where_the_touch_limit_forbids_a_touch_the_search_ends_unsure(model, rng):
    touches = [(0, 0), (0, 1), (1, 0)]
    decider = Abstaining(Always(Probe(2)))
    assert decider.decide(state(model, touches=touches, object_index=1, touch_limit=4), rng).action == Probe(2)
    over = decider.decide(state(model, touches=touches, object_index=1, touch_limit=3), rng)
    assert over.action == Unsure()
    assert reasons(over) == ["is_cut_off"]


def test_a_search_without_the_answer_unsure_is_refused_at_once(model, rng):
    with pytest.raises(InvalidArgument, match="unsure_reward"):
        Abstaining(Always(Probe(0))).decide(state(model, unsure_reward=None), rng)


@pytest.mark.parametrize(
    "settings",
    [{"false_alarm": value} for value in (0.0, 1.0, -0.1, np.nan)]
    + [{"promise": value} for value in (-0.1, 1.1, np.nan)]
    + [{"suspicion": value} for value in (1.0, 0.0, -np.inf, np.nan)],
)
def test_numbers_out_of_range_are_refused(settings):
    with pytest.raises(InvalidArgument, match=next(iter(settings))):
        Abstaining(Always(Confirm()), **settings)


def test_without_a_joint_belief_the_current_object_alone_counts(model, rng):
    labels = model.shape_labels
    problem = SearchProblem(labels, ("p0", "p1", "p2"), 1, Composition.INDEPENDENT, unsure_reward=0.0)
    info = InformationState(problem, 0, Belief.from_probs(labels, [0.01, 0.33, 0.33, 0.33]))
    decision = Abstaining(Always(Reject())).decide(info, rng)
    assert decision.action == Reject()
    assert decision.scores[ANSWER] == pytest.approx(0.99)


def played(model, wrap, number=150, **rules):
    problem = SearchProblem(model.shape_labels, ("p0", "p1", "p2"), 2, Composition.INDEPENDENT, **rules)
    worlds = [SyntheticWorld(model, sample_arrangement(problem, np.random.default_rng([s, 9]))) for s in range(number)]
    decider = wrap(make_decider("fixed_poses(max_touches=3)", model.outcome_table()))
    return search_lockstep(worlds, decider, problem, [0] * number, model, [(s,) for s in range(number)])


def test_searches_differ_from_those_of_the_bare_decider_only_where_they_end_unsure(model):
    bare, wrapped = played(model, lambda d: d), played(model, Abstaining, unsure_reward=0.0)
    unsure = 0
    for one, other in zip(bare, wrapped, strict=True):
        if other.outcome is Outcome.UNSURE:
            unsure += 1
            assert reasons(other.steps[-1].decision)
            assert one.num_touches >= other.num_touches
        else:
            assert [s.decision.action for s in one.steps] == [s.decision.action for s in other.steps]
            assert other.steps[-1].decision.scores[ANSWER] >= 0.95
    assert 10 < unsure < 145  # three touches are often too few here for 0.95


def test_answers_that_are_given_keep_the_promise(model):
    # 200 searches in an exact world; the bare decider, with three touches an object, is wrong more often.
    given = [e for e in played(model, Abstaining, 200, unsure_reward=0.0) if e.is_answered]
    assert len(given) > 30
    wrong = sum(not e.success for e in given)
    assert wrong <= 0.05 * len(given) + 3 * math.sqrt(0.05 * 0.95 * len(given))
    bare = played(model, lambda d: d, 200)
    assert sum(not e.success for e in bare) > 2 * wrong + 0.04 * len(bare)


def test_it_is_a_decider(model, rng):
    inner = make_decider("information_gain", model.outcome_table())
    assert check_decider(Abstaining(inner), rng, model, unsure_reward=0.0)
    with pytest.raises(ActiveTouchError, match="I do not know"):
        check_decider(Abstaining(inner), rng, model)


def test_i_do_not_know_is_no_answer_about_the_last_object_either(model, rng):
    info = state(model, object_index=1)
    assert answer_prob(Unsure(), info) is None
    decision = Abstaining(Always(Unsure(), own=1.0)).decide(info, rng)
    assert decision == Decision(Unsure(), {"own": 1.0, CONFLICT: 0.0})
