"""What every decider of the table does on information states it may come to, and in searches at the edge."""

import json
from dataclasses import replace

import numpy as np
import pytest

from belief import (
    Belief,
    Composition,
    Confirm,
    Counts,
    Probe,
    Reject,
    SceneBelief,
    SearchProblem,
)
from belief.observation_model import OutcomeTable
from belief.synthetic import SyntheticWorld, sample_arrangement
from benchmarks.tabular_model import TabularModel
from planners import DECIDERS, InformationState, Outcome, search_lockstep
from planners import make_decider as make_any_decider
from planners.registry import NEED_FILES

# Confirming at random and the paper's rule on single frames use no belief, and are held to the laws of those that do
# nowhere.
UNTRAINED = [name for name in DECIDERS if name not in NEED_FILES]
BELIEVERS = [name for name in UNTRAINED if name not in ("random_confirm", "threshold")]
every_decider = pytest.mark.parametrize("name", UNTRAINED)
every_believer = pytest.mark.parametrize("name", BELIEVERS)
# Their few simulations are no proof: what tree search does is a matter of chance where actions are nearly as good.
TREE_SEARCHERS = ("pouct",)
every_exact_believer = pytest.mark.parametrize("name", [name for name in BELIEVERS if name not in TREE_SEARCHERS])
COMPOSITIONS = (Composition.DISTINCT, Composition.INDEPENDENT, Counts({"a": 2, "b": 1, "c": 2}))


def make_decider(name, table):
    return make_any_decider(name, table, simulations=30)


def random_table(rng, num_poses=3, num_shapes=4, num_outcomes=5):
    return OutcomeTable(rng.dirichlet(np.full(num_outcomes, 0.5), size=(num_poses, num_shapes)))


def information_states(table, number, rng):
    """States of searches that touched and rejected at random; some objects were touched, some rejected untouched."""
    model = TabularModel(tuple("abcdefghijkl"[: table.num_shapes]), table)
    for index in range(number):
        composition = COMPOSITIONS[index % len(COMPOSITIONS)]
        problem = SearchProblem(
            model.shape_labels, tuple(f"p{i}" for i in range(table.num_poses)), rng.integers(1, 5), composition
        )
        arrangement = sample_arrangement(problem, rng)
        target, current = int(rng.integers(3)), int(rng.integers(problem.num_objects))
        scene = SceneBelief(problem, model)
        for number_of_object in range(current + 1):
            poses = rng.integers(table.num_poses, size=rng.integers(5)).tolist()
            scene.update(number_of_object, model.sample(arrangement[number_of_object], poses, rng))
        yield InformationState.of(problem, target, scene, current)


def state(probs, num_objects=1, composition=Composition.INDEPENDENT, num_poses=3, **rules):
    labels = tuple("abcdefghijkl"[: len(probs)])
    poses = tuple(f"p{i}" for i in range(num_poses))
    problem = SearchProblem(labels, poses, num_objects, composition, **rules)
    return InformationState(problem, 0, Belief.from_probs(labels, probs))


def play(name, table, problem, number, target=0, absent=False):
    model = TabularModel(tuple(problem.shape_labels), table)
    arrangements = [sample_arrangement(problem, np.random.default_rng([s, 99])) for s in range(number)]
    if absent:
        arrangements = [tuple(shape if shape != target else target + 1 for shape in a) for a in arrangements]
    worlds = [SyntheticWorld(model, arrangement) for arrangement in arrangements]
    decider = make_decider(name, table)
    return search_lockstep(worlds, decider, problem, [target] * number, model, [(s,) for s in range(number)])


@every_decider
def test_every_decision_is_legal_and_can_be_written_down(name, rng):
    table = random_table(rng)
    decider = make_decider(name, table)
    for info in information_states(table, 9, rng):
        decision = decider.decide(info, rng)
        match decision.action:
            case Probe(pose):
                assert isinstance(pose, int)
                assert 0 <= pose < info.problem.num_poses
            case action:
                assert isinstance(action, Confirm | Reject)
        assert np.isfinite(list(decision.scores.values())).all()
        json.dumps(dict(decision.scores), allow_nan=False)


@every_decider
def test_a_decider_needs_no_joint_belief(name, rng):
    table = random_table(rng)
    decider = make_decider(name, table)
    for info in information_states(table, 6, rng):
        assert decider.decide(replace(info, scene=None), rng).action is not None


@every_exact_believer
def test_certainty_stops_at_once(name, rng):
    decider = make_decider(name, random_table(rng))
    for composition in (Composition.DISTINCT, Composition.INDEPENDENT):
        for num_objects in (1, 3):
            assert decider.decide(state([1, 0, 0, 0], num_objects, composition), rng).action == Confirm()
            assert decider.decide(state([0, 0.5, 0.5, 0], num_objects, composition), rng).action == Reject()


@every_believer
def test_a_target_ruled_out_is_never_confirmed(name, rng):
    table = OutcomeTable(np.tile(np.eye(4)[[0, 1, 1, 2]], (3, 1, 1)))  # the first touch rules it in or out
    decider, confirmed = make_decider(name, table), 0
    for info in information_states(table, 30, rng):
        if isinstance(decider.decide(info, rng).action, Confirm):
            confirmed += 1
            assert info.target_prob > 0.0
    assert confirmed


@every_exact_believer
@pytest.mark.parametrize("num_shapes", [1, 2, 12])
def test_one_object_and_twelve_are_searched(name, num_shapes):
    table = OutcomeTable(np.tile(0.9 * np.eye(num_shapes) + 0.1 / num_shapes, (2, 1, 1)))
    labels = tuple("abcdefghijkl"[:num_shapes])
    problem = SearchProblem(labels, ("p", "q"), num_shapes, touch_limit=12 * num_shapes)
    episodes = play(name, table, problem, 6)
    assert sum(e.success for e in episodes) >= 5
    if num_shapes == 1:
        assert all(e.num_touches == 0 for e in episodes)  # the only object there is must be it


@every_believer
def test_an_absent_target_is_rightly_not_found(name):
    table = OutcomeTable(np.tile(0.94 * np.eye(4) + 0.06 / 4, (3, 1, 1)))
    problem = SearchProblem(tuple("abcd"), ("p", "q", "r"), 3, Composition.INDEPENDENT, touch_limit=40)
    episodes = play(name, table, problem, 20, absent=True)
    assert sum(e.outcome is Outcome.EXHAUSTED and e.success for e in episodes) >= 17


@every_exact_believer
def test_a_perfect_pose_needs_one_touch_an_object(name):
    table = OutcomeTable(np.tile(np.eye(4), (2, 1, 1)))
    problem = SearchProblem(tuple("abcd"), ("p", "q"), 4)
    for episode in play(name, table, problem, 12):
        assert episode.success
        place = episode.arrangement.index(0)
        assert episode.num_touches == min(place + 1, 3)  # the last object needs none


@every_believer
@pytest.mark.parametrize("touch_cost", [0.0, 1e-6, 5.0])
def test_searches_end_whatever_a_touch_costs_and_however_useless_it_is(name, touch_cost):
    problem = SearchProblem(tuple("abc"), ("p", "q"), 2, Composition.INDEPENDENT, touch_cost, touch_limit=24)
    for table in (OutcomeTable(np.full((2, 3, 2), 0.5)), random_table(np.random.default_rng(2), 2, 3)):
        for episode in play(name, table, problem, 4):
            assert episode.outcome is not Outcome.TRUNCATED
