"""pomdp-py's planners: models that agree with themselves and with the search, and what a rollout makes of them."""

import random
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from belief import Belief, Composition, Confirm, Counts, Probe, Reject, SceneBelief, SearchProblem, Touch
from belief.observation_model import OutcomeTable
from benchmarks.tabular_model import TabularModel
from planners import InformationState, make_decider

adapter = pytest.importorskip("pomdp_py") and pytest.importorskip("planners.pomdp_py_adapter")

TABLE = OutcomeTable(
    [[[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.2, 0.7]], [[0.6, 0.4, 0.0], [0.2, 0.2, 0.6], [0, 0, 1]]]
)
POSES = ("p", "q")


def problem_of(composition=Composition.DISTINCT, num_objects=2, touch_cost=0.02):
    return SearchProblem(tuple("abc"), POSES, num_objects, composition, touch_cost)


@pytest.mark.parametrize("composition", ["distinct", "independent", Counts({"a": 2, "b": 1})])
def test_a_rejected_object_gives_way_to_one_drawn_from_what_is_left(composition):
    rules = adapter.Rules(problem_of(composition), 0, TABLE)
    model = adapter.SearchModel(rules, np.random.default_rng(0))
    for shape in range(3):
        state = rules.states[0, shape, 0]
        following = [model.sample(state, adapter.REJECT)[0].data for _ in range(2000)]
        assert {(number, missed) for number, _, missed in following} == {(1, int(shape == 0))}
        drawn = np.bincount([kind for _, kind, _ in following], minlength=3) / 2000
        assert drawn == pytest.approx(rules.shape_probs[1, int(shape == 0)], abs=0.04)
        assert model.sample(state, adapter.CONFIRM)[0] is adapter.END


def test_outcomes_are_drawn_as_often_as_the_table_says():
    rng = np.random.default_rng(0)
    rules = adapter.Rules(problem_of(), 0, TABLE)
    model = adapter.SearchModel(rules, rng)
    [_, _, _, second_pose] = rules.actions
    felt = [model.sample(rules.states[0, 1, 0], second_pose)[1].data for _ in range(5000)]
    assert np.bincount(felt, minlength=3) / 5000 == pytest.approx(TABLE.probs[1, 1], abs=0.03)


@pytest.mark.parametrize("composition", ["distinct", "independent"])
def test_rewards_add_up_to_the_reward_of_a_search(composition):
    rng = np.random.default_rng(1)
    problem = problem_of(composition)
    rules = adapter.Rules(problem, 0, TABLE)
    model = adapter.SearchModel(rules, rng)
    actions = list(rules.actions)
    for _ in range(300):
        state = rules.states[0, int(rng.integers(3)), 0]
        shapes, total, touches, confirmed = [state.data[1]], 0.0, 0, None
        while state != adapter.END:
            action = actions[rng.integers(len(actions))]
            following, _, reward, _ = model.sample(state, action)
            total += reward
            touches += action.name in rules.poses
            if action == adapter.CONFIRM:
                confirmed = state.data[1]
            state = following
            if action == adapter.REJECT and state != adapter.END:
                shapes.append(state.data[1])
        assert total == pytest.approx(problem.reward(confirmed, 0, touches, 0 in shapes))
        assert model.sample(adapter.END, actions[0])[2] == 0.0


def test_the_belief_knows_what_may_have_been_given_away():
    model = TabularModel(tuple("abc"), TABLE)
    for composition in ("distinct", "independent"):
        problem = problem_of(composition, 3)
        scene = SceneBelief(problem, model)
        scene.update(0, [Touch(0, np.log(TABLE.probs[0, :, 0]))])
        info = InformationState.of(problem, 0, scene, 1)
        rules = adapter.Rules(problem, 0, TABLE)
        histogram = rules.histogram(info)
        assert sum(histogram.values()) == pytest.approx(1.0)
        given_away = sum(prob for state, prob in histogram.items() if state.data[2])
        assert given_away == pytest.approx(scene.belief(0).probs[0])  # the chance that the first object was the target


def test_pythons_own_generator_is_left_as_it_was_and_plays_no_part():
    decider = adapter.Pouct(TABLE, 60)
    problem = problem_of()
    info = InformationState(problem, 0, Belief.uniform(tuple("abc")))
    decisions = []
    for seed in (1, 2):
        random.seed(seed)
        before = random.getstate()
        decisions.append(decider.decide(info, np.random.default_rng(3)))
        assert random.getstate() == before
    assert decisions[0] == decisions[1]
    assert decider.decide(info, np.random.default_rng(4)) != decisions[0]


def test_enough_simulations_touch_when_unsure_and_stop_when_sure():
    decider = adapter.Pouct(TABLE, 400)
    problem = problem_of(Composition.INDEPENDENT, 1)
    for probs, expected in (([0.5, 0.3, 0.2], Probe), ([0.995, 0.005, 0], Confirm), ([0.005, 0.99, 0.005], Reject)):
        info = InformationState(problem, 0, Belief.from_probs(tuple("abc"), probs))
        assert isinstance(decider.decide(info, np.random.default_rng(0)).action, expected)


def test_too_few_simulations_to_try_every_action_are_refused():
    with pytest.raises(ValueError, match="2 poses need at least 5 simulations, got 4"):
        make_decider("pouct", TABLE, simulations=4)


def test_a_target_ruled_out_is_not_confirmed_by_few_simulations():
    problem = problem_of(Composition.INDEPENDENT, 2)
    info = InformationState(problem, 0, Belief.from_probs(tuple("abc"), [0, 0.5, 0.5]))
    for seed in range(20):
        action = make_decider("pouct", TABLE, simulations=5).decide(info, np.random.default_rng(seed)).action
        assert not isinstance(action, Confirm)


def test_a_pose_used_before_gives_way_to_one_that_is_not():
    same = OutcomeTable(np.repeat(TABLE.probs[:1], 2, axis=0))
    problem = problem_of(Composition.INDEPENDENT, 1)
    for used in (0, 1):
        info = InformationState(
            problem, 0, Belief.from_probs(tuple("abc"), [0.5, 0.3, 0.2]), (Touch(used, np.zeros(3)),)
        )
        assert adapter.Pouct(same, 200).decide(info, np.random.default_rng(0)).action == Probe(1 - used)


def test_the_only_pose_that_tells_anything_is_touched_again():
    table = OutcomeTable([[[0.5, 0.5], [0.5, 0.5]], [[0.8, 0.2], [0.2, 0.8]]])
    problem = SearchProblem(("a", "b"), POSES, 1, "independent", touch_cost=0.001)
    info = InformationState(problem, 0, Belief.from_probs(("a", "b"), [0.8, 0.2]), (Touch(1, np.zeros(2)),))
    assert adapter.Pouct(table, 500).decide(info, np.random.default_rng(0)).action == Probe(1)


def test_no_touch_is_planned_where_those_of_the_search_are_used():
    model, problem = TabularModel(tuple("abc"), TABLE), SearchProblem(tuple("abc"), POSES, 3, touch_limit=1)
    scene = SceneBelief(problem, model)
    for index, is_over in ((0, False), (1, True)):
        rules, info = adapter.Rules(problem, 0, TABLE), InformationState.of(problem, 0, scene, index)
        names = [action.name for action in adapter._root_actions(rules, info)]
        assert names == ["confirm", "reject"] + ([] if is_over else ["probe_0", "probe_1"])
        scene.update(0, [Touch(0, np.log([0.1, 0.5, 0.4]))])


def test_several_threads_decide_as_each_would_alone():
    decider, problem = adapter.Pouct(TABLE, 120), problem_of()
    infos = [
        InformationState(problem, 0, Belief.from_probs(tuple("abc"), [p, 0.9 - p, 0.1])) for p in (0.2, 0.4, 0.6, 0.7)
    ]

    def decide(number):
        return decider.decide(infos[number % 4], np.random.default_rng(number))

    alone = [decide(number) for number in range(24)]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)  # threads are interrupted in the middle of a plan
    try:
        with ThreadPoolExecutor(8) as threads:
            assert list(threads.map(decide, range(24))) == alone
    finally:
        sys.setswitchinterval(interval)


@pytest.mark.parametrize("sharpness", [0.0, 1e-3], ids=["useless", "not worth its cost"])
def test_poses_that_cannot_pay_are_not_touched(sharpness):
    table = OutcomeTable(np.tile([[0.5 + sharpness, 0.5 - sharpness], [0.5 - sharpness, 0.5 + sharpness]], (3, 1, 1)))
    problem = SearchProblem(("a", "b"), ("p", "q", "r"), 2, "independent")
    assert adapter.useful_poses(problem, table) == []
    info = InformationState(problem, 0, Belief.uniform(("a", "b")))
    assert not isinstance(adapter.Pouct(table, 300).decide(info, np.random.default_rng(0)).action, Probe)


def test_more_simulations_make_a_wrong_first_pose_rarer():
    """With the least exploration for any number, POUCT chose the worse of the first two for 5 seeds of 30."""
    poses, better = [[[0.55, 0.45], [0.45, 0.55]], [[0.9, 0.1], [0.1, 0.9]]], 1
    info = InformationState(SearchProblem(("a", "b"), POSES, 1, "independent"), 0, Belief.uniform(("a", "b")))
    wrong = {}
    for simulations in (50, 400):
        decider = adapter.Pouct(OutcomeTable(poses), simulations)
        chosen = [decider.decide(info, np.random.default_rng(seed)).action for seed in range(30)]
        wrong[simulations] = sum(action != Probe(better) for action in chosen)
    assert wrong[400] < wrong[50] / 4
