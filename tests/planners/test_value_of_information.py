"""The value of information against loops over everything that can be observed, and hand-derived decisions."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belief import Belief, Composition, Confirm, Counts, Probe, Reject, SceneBelief, SearchProblem, Touch
from belief.observation_model import OutcomeTable
from belief.synthetic import SyntheticWorld
from benchmarks.tabular_model import TabularModel
from planners import InformationState, search_lockstep
from planners.continuation_value import ContinuationValue, prob_missed, shapes_ahead
from planners.probing import RepeatDiscount
from planners.value_of_information import ValueOfInformation

seeds = st.integers(0, 10_000)


def random_table(rng, num_poses=3, num_shapes=3, num_outcomes=4, sharpness=1.0):
    return OutcomeTable(rng.dirichlet(np.full(num_outcomes, 1.0 / sharpness), size=(num_poses, num_shapes)))


def one_object(num_shapes, num_poses, touch_cost=0.02, touch_limit=48):
    shapes, poses = tuple("abcdefghijkl"[:num_shapes]), tuple(f"p{i}" for i in range(num_poses))
    return SearchProblem(shapes, poses, 1, Composition.INDEPENDENT, touch_cost, touch_limit)


def state(problem, probs, poses=(), target=0):
    touches = tuple(Touch(pose, np.zeros(problem.num_shapes)) for pose in poses)
    return InformationState(problem, target, Belief.from_probs(problem.shape_labels, probs), touches)


def value(table, belief, uses, depth, cost, discount, best_of=max):
    """Value of the best plan by recursion; or of each first probe."""
    stop = abs(2.0 * belief[0] - 1.0)
    if depth == 0:
        return stop
    worth = []
    for pose in range(table.num_poses):
        weight = discount.weights(uses)[pose]
        later = uses + np.eye(table.num_poses, dtype=int)[pose]
        informed = 0.0
        for likelihood in table.probs[pose].T:
            chance = float(belief @ likelihood)
            if chance > 0.0:
                informed += chance * value(table, belief * likelihood / chance, later, depth - 1, cost, discount)
        uninformed = value(table, belief, later, depth - 1, cost, discount)
        if weight > 0.0:
            worth.append(weight * informed + (1.0 - weight) * uninformed - cost)
        else:
            worth.append(-np.inf)
    return max(stop, *worth) if best_of is max else np.array(worth)


@settings(max_examples=20)
@given(seeds, st.sampled_from([1, 2]), st.sampled_from([RepeatDiscount(), RepeatDiscount(0.4)]))
def test_the_arrays_agree_with_recursion_over_outcomes(seed, depth, discount):
    rng = np.random.default_rng(seed)
    table, belief = random_table(rng), rng.dirichlet(np.ones(3))
    poses = rng.integers(3, size=rng.integers(4)).tolist()
    info = state(one_object(3, 3, 0.03), belief, poses)
    decider = ValueOfInformation(table, depth, discount)
    payoffs = decider.payoffs(info)
    assert payoffs.tolist() == [[1, -1, -1], [-1, 1, 1]]  # a single test
    expected = value(table, belief, np.bincount(poses, minlength=3), depth, 0.03, discount, best_of=None)
    np.testing.assert_allclose(decider.probe_values(info, payoffs), expected, atol=1e-12)
    action = decider.decide(info, rng).action
    if expected.max() > abs(2 * belief[0] - 1) + 1e-9:
        assert expected[action.pose] == pytest.approx(expected.max(), abs=1e-9)
    else:
        assert action == (Confirm() if belief[0] > 0.5 else Reject())


def test_complementary_poses_are_found_two_touches_ahead_and_never_one_ahead(rng):
    bits = OutcomeTable([np.eye(2)[[0, 0, 1, 1]], np.eye(2)[[0, 1, 0, 1]]])
    problem = one_object(4, 2)
    model = TabularModel(tuple("abcd"), bits)
    worlds = [SyntheticWorld(model, (shape,)) for shape in range(4)]
    for depth, touches, right in ((1, [0] * 4, 3), (2, [2, 2, 1, 1], 4)):
        episodes = search_lockstep(
            worlds, ValueOfInformation(bits, depth), problem, [0] * 4, model, [(s,) for s in range(4)]
        )
        assert [e.num_touches for e in episodes] == touches
        assert sum(e.success for e in episodes) == right


@pytest.mark.parametrize("depth", [1, 2])
def test_useless_poses_and_dear_touches_are_never_bought(depth, rng):
    useless = OutcomeTable(np.full((2, 3, 2), 0.5))
    good = OutcomeTable(np.tile(np.eye(3), (2, 1, 1)))
    for table, cost in ((useless, 0.0), (useless, 0.02), (good, 2.0)):
        decider = ValueOfInformation(table, depth)
        assert decider.decide(state(one_object(3, 2, cost), [0.6, 0.2, 0.2]), rng).action == Confirm()
        assert decider.decide(state(one_object(3, 2, cost), [0.4, 0.3, 0.3]), rng).action == Reject()


def test_equal_poses_give_the_lowest(rng):
    table = OutcomeTable(np.tile([[0.9, 0.1], [0.1, 0.9]], (3, 1, 1)))
    assert ValueOfInformation(table).decide(state(one_object(2, 3), [0.5, 0.5]), rng).action == Probe(0)


def test_a_target_ruled_out_is_rejected_even_where_nothing_is_left_to_gain(rng):
    model = TabularModel(("a", "b"), OutcomeTable(np.eye(2)[None]))
    problem = SearchProblem(("a", "b"), ("p",), 2)
    scene = SceneBelief(problem, model)
    scene.update(0, model.sample(0, [0], rng))  # the target, which was rejected all the same
    info = InformationState.of(problem, 0, scene, 1)
    assert prob_missed(info) == 1.0
    assert ValueOfInformation(model.table).decide(info, rng).action == Reject()


def test_free_touches_never_exceed_an_equal_share_of_the_limit():
    table = OutcomeTable(np.tile([[0.55, 0.45], [0.45, 0.55]], (3, 1, 1)))
    model = TabularModel(("a", "b"), table)
    problem = SearchProblem(("a", "b"), ("p0", "p1", "p2"), 2, Composition.INDEPENDENT, 0.0, touch_limit=7)
    worlds = [SyntheticWorld(model, (s % 2, s // 2 % 2)) for s in range(40)]
    decider, seeds = ValueOfInformation(table), [(s,) for s in range(40)]
    episodes = search_lockstep(worlds, decider, problem, [0] * 40, model, seeds)
    longest = [max(np.bincount([s.object_index for s in e.steps if s.touch], minlength=2)) for e in episodes]
    assert max(longest) == 3
    assert not any(e.outcome == "truncated" for e in episodes)


@pytest.mark.parametrize("max_touches", [None, 5])
def test_no_search_is_truncated_where_there_are_fewer_touches_than_objects(max_touches):
    model = TabularModel(("a", "b"), OutcomeTable([[[0.9, 0.1], [0.1, 0.9]]]))
    problem = SearchProblem(("a", "b"), ("p",), 4, Composition.INDEPENDENT, 0.0, touch_limit=2)
    worlds, seeds = [SyntheticWorld(model, (1, 1, 1, 0)) for _ in range(20)], [(s,) for s in range(20)]
    decider = ValueOfInformation(model.table, max_touches=max_touches)
    episodes = search_lockstep(worlds, decider, problem, [0] * 20, model, seeds)
    assert not any(episode.outcome == "truncated" for episode in episodes)
    assert max(episode.num_touches for episode in episodes) == 2


def test_a_decider_that_saw_a_shorter_search_values_a_longer_one_as_a_new_decider_does():
    table = random_table(np.random.default_rng(0))
    short, long = (
        InformationState(problem, 0, Belief.uniform(problem.shape_labels))
        for problem in (SearchProblem(tuple("abc"), ("p0", "p1", "p2"), 3, touch_limit=limit) for limit in (3, 48))
    )
    used, new = ValueOfInformation(table), ValueOfInformation(table)
    assert used.payoffs(short)[1, 1] < new.payoffs(long)[1, 1]
    np.testing.assert_array_equal(used.payoffs(long), new.payoffs(long))


def test_another_depth_is_refused():
    with pytest.raises(ValueError, match="depth must be an integer, at least 1 and at most 2, got 3"):
        ValueOfInformation(random_table(np.random.default_rng(0)), 3)


def test_chances_of_the_rest_are_those_of_counting_arrangements():
    # All draws of three from a bag of two targets and two others, in order.
    problem = SearchProblem(("a", "b"), ("p",), 3, Counts({"a": 2, "b": 2}))
    draws = list(itertools.permutations([0, 0, 1, 1], 3))
    for index in range(3):
        for missed in (0, 1):
            given = [d for d in draws if sum(s == 0 for s in d[:index]) == missed]
            if given and (index or not missed):
                share = np.mean([d[index] == 0 for d in given])
                assert shapes_ahead(problem, 0)[index, missed, 0] == pytest.approx(share)


@pytest.mark.parametrize("others", [1, 3, 9])
def test_one_test_is_worth_what_recursion_over_outcomes_says(others):
    # With one pose and two outcomes thresholds on the posterior are optimal; 2 000 sequences err by about .01.
    table = OutcomeTable([[[0.8, 0.2], [0.2, 0.8]]])
    problem = SearchProblem(("a", "b"), ("p",), 1, Counts({"a": 1, "b": others}), 0.02, touch_limit=9)
    prior = np.array([1.0, others]) / (1 + others)
    expected = value(table, prior, np.zeros(1, int), 9, 0.02, RepeatDiscount(0.0))
    assert ContinuationValue.of(problem, 0, table).values[0, 0] == pytest.approx(expected, abs=0.03)
    if others == 1:
        dearer = ContinuationValue.of(problem, 0, table, RepeatDiscount(0.5)).values[0, 0]
        assert dearer < expected - 0.05  # repeats tell less


@pytest.mark.parametrize("touch_cost", [0.02, 0.3, 0.9])
@pytest.mark.parametrize(
    "composition",
    ["distinct", "independent", Counts({"a": 2, "b": 2}), Counts({"a": 3}), Counts({"a": 1, "b": 5})],
)
def test_a_perfect_pose_is_touched_once_or_not_at_all_whichever_is_worth_more(composition, touch_cost):
    problem = SearchProblem(tuple("abc"), ("p",), 3, composition, touch_cost)
    found = ContinuationValue.of(problem, 0, OutcomeTable(np.eye(3)[None])).values
    expected = np.array([[1.0, -1.0]] * 4)
    for index in (2, 1, 0):
        for missed in (0, 1):
            chance, after = shapes_ahead(problem, 0)[index, missed, 0], expected[index + 1]
            untouched = max(2.0 * chance - 1.0, chance * after[1] + (1.0 - chance) * after[missed])
            touched = chance + (1.0 - chance) * after[missed] - touch_cost
            expected[index, missed] = max(untouched, touched)
    np.testing.assert_allclose(found[1:], expected[1:], atol=1e-12)
    assert found[0, 0] == pytest.approx(expected[0, 0], abs=1e-12)  # before the first object none was missed
