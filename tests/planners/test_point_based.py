"""The planner in whole searches: its plans are followed, repeats are priced, extremes are survived."""

import ast

import numpy as np
import pytest

from belief import Belief, Composition, Confirm, Counts, Probe, Reject, SceneBelief, SearchProblem, Touch
from belief.observation_model import ConfusionModel, OutcomeTable
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import InformationState, make_decider, search
from planners.continuation_value import belief_with_missed
from planners.point_based import PointBased, stages_by_target
from planners.probing import RepeatDiscount
from planners.solve import SearchTouchProblem, solve

POSES = ("p0", "p1", "p2")


class FlatRepeats:
    """A user's own discount: every repeat is worth the same."""

    def __init__(self, weight):
        self.weight = weight

    def weights(self, uses):
        return np.where(np.asarray(uses) > 0, self.weight, 1.0)

    def __repr__(self):
        return "FlatRepeats"


def problem_of(model, num_objects, composition=Composition.DISTINCT, **options):
    return SearchProblem(model.shape_labels, POSES, num_objects, composition, **options)


def play(decider, model, problem, target, number):
    arrangement = sample_arrangement(problem, np.random.default_rng([number, 1]))
    return search(SyntheticWorld(model, arrangement), decider, problem, target, model, (number, 0, 7))


def test_searches_return_what_the_plan_promises():
    model = random_model(np.random.default_rng(0), sharpness=2.5)
    problem = problem_of(model, 4, touch_cost=0.05)
    decider = PointBased(model.outcome_table(), RepeatDiscount(0.0))
    policy = solve(SearchTouchProblem(model.outcome_table().probs, 4, "distinct", 1, 0.05))
    returns = np.array([play(decider, model, problem, 1, n).reward(problem) for n in range(300)])
    error = returns.std() / np.sqrt(len(returns))
    assert abs(returns.mean() - policy.initial_value) < 4 * error  # fails once in 10^4
    assert returns.mean() > policy.initial_value - 0.1


@pytest.mark.parametrize(
    ("num_objects", "num_shapes", "composition", "exact"),
    [
        (1, 4, Composition.DISTINCT, True),
        (4, 4, Composition.DISTINCT, True),
        (3, 5, Composition.DISTINCT, True),
        (12, 12, Composition.DISTINCT, False),
        (8, 12, Composition.INDEPENDENT, True),
        (4, 3, Counts({"shape_0": 2, "shape_1": 1, "shape_2": 2}), False),
    ],
)
def test_any_composition_is_planned_for_and_searched(num_objects, num_shapes, composition, exact):
    model = random_model(np.random.default_rng(1), num_shapes, sharpness=5.0)
    problem = problem_of(model, num_objects, composition, touch_limit=12 * num_objects)
    decider = PointBased(model.outcome_table(), rounds=(50, 100))
    assert isinstance(decider.policy(problem, 0).problem, SearchTouchProblem) is exact
    successes = [play(decider, model, problem, 0, n).success for n in range(12)]
    assert np.mean(successes) > 0.6  # the floor is at most one half


def test_independent_objects_of_very_many_shapes_are_planned_for_exactly():
    rng, labels = np.random.default_rng(0), tuple(f"shape_{number}" for number in range(101))
    problem = SearchProblem(labels, ("p",), 2, "independent")
    decider = PointBased(OutcomeTable(rng.dirichlet(np.ones(3), size=(1, 101))), rounds=(5,))
    policy = decider.policy(problem, 100)
    assert isinstance(policy.problem, SearchTouchProblem)
    assert policy.search.initial.size == 2 * 101
    for prob, action in ((0.999, Confirm()), (1e-6, Reject())):
        probs = np.append(np.full(100, (1.0 - prob) / 100), prob)
        assert decider.decide(InformationState(problem, 100, Belief.from_probs(labels, probs)), rng).action == action


@pytest.mark.parametrize("num_targets", [1, 2, 3])
def test_a_belief_by_target_has_the_exact_marginals_and_says_whether_a_target_was_rejected(num_targets):
    model = random_model(np.random.default_rng(1), sharpness=2.0)
    problem = problem_of(model, 4, Counts({"shape_0": 2, "shape_1": 1, "shape_2": num_targets}))
    for number in range(20):
        scene, rng = SceneBelief(problem, model), np.random.default_rng(number)
        arrangement = sample_arrangement(problem, rng)
        for index, shape in enumerate(arrangement):
            scene.update(index, model.sample(shape, rng.integers(3, size=rng.integers(4)).tolist(), rng))
        for index in range(4):
            unmissed, missed = belief_with_missed(InformationState.of(problem, 2, scene, index))
            np.testing.assert_allclose(unmissed + missed, scene.belief(index).probs, atol=1e-12)
            assert min(unmissed.min(), missed.min()) >= 0.0
            before = np.array([scene.belief(earlier).prob(2) for earlier in range(index)])
            # One target is here or there, not in two places; several are taken as independent of each other.
            expected = before.sum() if num_targets == 1 else 1.0 - np.prod(1.0 - before)
            assert missed.sum() == pytest.approx(expected, abs=1e-9)
            assert num_targets > 1 or missed[2] == 0.0


@pytest.mark.parametrize("counts", [{"shape_0": 1, "shape_1": 5}, {"shape_0": 3}, {"shape_1": 2, "shape_2": 2}])
def test_stages_by_target_are_stochastic_for_any_bag(counts):
    model = random_model(np.random.default_rng(2), 3)
    for target in range(3):
        num_objects = sum(counts.values()) - 1
        staged = stages_by_target(
            problem_of(model, num_objects, Counts(counts)), model.outcome_table().probs, target, 0.1
        )
        assert len(staged.stages) == num_objects
        for stage in staged.stages[:-1]:
            assert stage.moves.sum(axis=1) == pytest.approx(np.ones(6))
            assert (stage.moves >= 0.0).all()


def test_a_repeat_that_tells_nothing_is_not_bought():
    table = OutcomeTable(np.array([[[0.8, 0.2], [0.2, 0.8]]]))
    problem = SearchProblem(("a", "b"), ("p",), 1, Composition.INDEPENDENT, touch_cost=0.02)
    touch = Touch(0, np.log([0.6, 0.4]))
    info = InformationState(problem, 0, Belief.from_probs(("a", "b"), [0.6, 0.4]), (touch,))
    rng = np.random.default_rng(0)
    assert PointBased(table, RepeatDiscount(0.0)).decide(info, rng).action == Probe(0)
    assert PointBased(table, RepeatDiscount(1.0)).decide(info, rng).action == Confirm()


def test_a_pose_that_was_not_used_is_preferred_to_its_twin():
    table = OutcomeTable(np.repeat(np.array([[[0.8, 0.2], [0.2, 0.8]]]), 2, axis=0))
    problem = SearchProblem(("a", "b"), ("p", "q"), 1, Composition.INDEPENDENT, touch_cost=0.02)
    info = InformationState(problem, 0, Belief.from_probs(("a", "b"), [0.5, 0.5]), (Touch(0, np.zeros(2)),))
    assert PointBased(table, RepeatDiscount(0.4)).decide(info, np.random.default_rng(0)).action == Probe(1)


def test_scores_say_why_it_stopped():
    model = random_model(np.random.default_rng(0), sharpness=4.0)
    problem = problem_of(model, 4)
    episode = play(make_decider("point_based", model.outcome_table(), model), model, problem, 0, 3)
    last = episode.steps[-1].decision
    assert isinstance(last.action, Confirm)
    assert last.scores["value_confirm"] >= last.scores["value_reject"]


@pytest.mark.parametrize(
    ("num_objects", "composition"),
    [(3, "distinct"), (3, "independent"), (3, Counts({"shape_0": 1, "shape_1": 2, "shape_2": 2}))],
)
def test_its_values_of_answers_follow_from_the_exact_belief(num_objects, composition):
    model = random_model(np.random.default_rng(1), 3, sharpness=2.0)
    problem = problem_of(model, num_objects, composition)
    decider, rng = PointBased(model.outcome_table(), RepeatDiscount(0.3), rounds=(50, 100)), np.random.default_rng(0)
    for number in range(30):
        scene = SceneBelief(problem, model)
        arrangement = sample_arrangement(problem, np.random.default_rng(number))
        for index in range(num_objects):
            untouched = decider.decide(InformationState.of(problem, 0, scene, index), rng)
            answers = untouched.scores["value_confirm"], untouched.scores["value_reject"]
            if not isinstance(untouched.action, Probe):
                assert untouched.scores["value"] == pytest.approx(max(answers))
                assert isinstance(untouched.action, Confirm) == (answers[0] > answers[1])
            poses = rng.integers(len(POSES), size=rng.integers(1, 4)).tolist()
            scene.update(index, model.sample(arrangement[index], poses, rng))
            touched = decider.decide(InformationState.of(problem, 0, scene, index), rng)
            action, scores = touched.action, touched.scores
            assert scores["value_confirm"] == pytest.approx(2.0 * scores["target_prob"] - 1.0)
            if isinstance(action, Probe):
                values = [scores[f"value_{pose}"] for pose in POSES]
                assert values[action.pose] == max(*values, scores["value_confirm"], scores["value_reject"])
        if not isinstance(composition, Counts):  # whose hidden states are not exact
            assert scores["value_reject"] == pytest.approx(1.0 - 2.0 * scene.prob_present(0))


def test_free_touches_are_planned_for_and_end():
    model = random_model(np.random.default_rng(0), sharpness=1.0)
    problem = problem_of(model, 2, touch_cost=0.0, touch_limit=20)
    episode = play(PointBased(model.outcome_table(), rounds=(50, 50)), model, problem, 0, 0)
    assert episode.num_touches <= 20


def test_at_the_touch_limit_it_answers():
    model = random_model(np.random.default_rng(0), sharpness=0.5)
    problem = problem_of(model, 2, touch_cost=0.0001, touch_limit=1)
    decider = PointBased(model.outcome_table(), rounds=(50, 50))
    for number in range(10):
        assert play(decider, model, problem, 0, number).outcome != "truncated"


def test_a_shape_that_was_ruled_out_is_rejected_untouched():
    model = random_model(np.random.default_rng(0))
    problem = problem_of(model, 4)
    info = InformationState(problem, 0, Belief.from_probs(model.shape_labels, [0.0, 0.5, 0.5, 0.0]))
    assert PointBased(model.outcome_table()).decide(info, np.random.default_rng(0)).action == Reject()


def test_shape_labels_in_a_list_will_do():
    model = ConfusionModel.fit([Touch(0, np.array([1.0, 0.0])), Touch(0, np.array([0.0, 1.0]))], [0, 1])
    problem = SearchProblem(list(model.shape_labels), ["p"], 2)
    info = InformationState(problem, 0, Belief.uniform(model.shape_labels))
    assert PointBased(model.outcome_table()).decide(info, np.random.default_rng(0)).action in (Probe(0), Confirm())


def test_discounts_that_look_alike_have_policies_of_their_own():
    problem, table = (
        SearchProblem(("a", "b"), ("p", "q"), 2, "independent"),
        OutcomeTable([[[0.7, 0.3], [0.3, 0.7]]] * 2),
    )
    policies = [PointBased(table, FlatRepeats(weight), rounds=(50,)).policy(problem, 0) for weight in (0.9, 0.0)]
    after_two = [policy.at(0, 2).value(policy.search.initial[None])[0] for policy in policies]
    assert after_two[0] > after_two[1] + 0.01


@pytest.mark.parametrize("rounds", ["2", "()", "(0,)", "(2.5,)", "'ab'", "(True,)"])
def test_rounds_that_are_none_are_refused_when_the_planner_is_made(rounds):
    table = OutcomeTable([[[0.7, 0.3], [0.3, 0.7]]])
    with pytest.raises(ValueError, match="rounds must be one or more integers, each at least 1"):
        make_decider(f"point_based(rounds={rounds})", table)
    with pytest.raises(ValueError, match="rounds must be one or more integers, each at least 1"):
        solve(SearchTouchProblem(table.probs, 2, "distinct", 0, 0.05), rounds=ast.literal_eval(rounds))
