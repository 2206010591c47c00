"""Solved touch problems against hand-derived values, brute force, and their own certified bounds."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import softmax

from planners.solve import SearchTouchProblem, TouchProblem, finite_horizon_value, solve, upper_bound
from planners.touch_problem import stage_belief, staged

NINE_OF_TEN = np.array([[[0.9, 0.1], [0.1, 0.9]]])
CONFIRM, REJECT = 1, 2  # with one pose


def random_table(seed, num_poses=3, num_shapes=3, num_outcomes=4, sharpness=1.5):
    scores = np.random.default_rng(seed).normal(size=(num_poses, num_shapes, num_outcomes))
    return softmax(sharpness * scores, axis=2)


def uniform(table, target=0, touch_cost=0.05, **options):
    num_shapes = table.shape[1]
    return TouchProblem(table, np.full(num_shapes, 1 / num_shapes), target, touch_cost, **options)


def value_by_recursion(problem, weights, touches_left):
    """The definition, outcome by outcome."""
    sign = np.where(np.arange(problem.num_shapes) == problem.target, 1.0, -1.0)
    best = abs(weights @ sign)
    if touches_left:
        for table in problem.outcome_probs:
            worth = sum(value_by_recursion(problem, weights * column, touches_left - 1) for column in table.T)
            best = max(best, problem.discount * worth - problem.touch_cost * weights.sum())
    return best


@pytest.mark.parametrize("max_touches", range(5))
@pytest.mark.parametrize("discount", [1.0, 0.9])
def test_the_finite_horizon_value_is_that_of_the_recursion(max_touches, discount):
    for seed, target in itertools.product(range(2), range(2)):
        problem = TouchProblem(random_table(seed, 2, 3, 3), [0.5, 0.3, 0.2], target, 0.03, discount)
        expected = value_by_recursion(problem, problem.prior, max_touches)
        assert finite_horizon_value(problem, max_touches) == pytest.approx(expected, abs=1e-9)


def value_with_repeats(problem, joint, weights):
    """The same where touch t gives an outcome with probability ``weights[t]``, and no touch follows the last."""
    sign = np.where(np.arange(len(joint)) == problem.target, 1.0, -1.0)
    best = abs(joint @ sign)
    if weights:
        nothing = (1.0 - weights[0]) * value_with_repeats(problem, joint, weights[1:])
        for table in problem.outcome_probs:
            worth = sum(value_with_repeats(problem, joint * column, weights[1:]) for column in table.T)
            best = max(best, problem.discount * (weights[0] * worth + nothing) - problem.touch_cost * joint.sum())
    return best


def value_at(policy, object_index, belief, touches=0):
    return policy.at(object_index, touches).value(np.array([belief]))[0]


@pytest.mark.parametrize("weights", [(), (1.0,), (1.0, 1.0, 0.5, 0.25), (1.0, 0.3, 0.0, 1.0)])
@pytest.mark.parametrize("discount", [1.0, 0.9])
def test_a_repeat_aware_policy_has_the_values_of_the_recursion(weights, discount):
    for target in range(2):
        table = random_table(target, 2, 3, 3)
        prior = np.array([0.5, 0.3, 0.2])
        problem = SearchTouchProblem(table, 1, "independent", target, 0.03, prior, discount)
        policy = solve(problem, rounds=(50, 100), repeat_weights=weights)
        assert policy.initial_value == pytest.approx(value_with_repeats(problem, problem.prior, weights), abs=5e-3)
        for touches in range(len(weights) + 2):
            for prior in ([0.5, 0.3, 0.2], [0.2, 0.5, 0.3], [0.3, 0.1, 0.6]):
                most = value_with_repeats(problem, np.array(prior), weights[touches:])
                found = value_at(policy, 0, [*prior, 0.0, 0.0, 0.0], touches)  # no object was rejected before
                assert most - 0.05 <= found <= most + 1e-9
                nothing = policy.probe_values(0, np.array([*prior, 0.0, 0.0, 0.0]), touches, np.full(2, 1e-12))
                later = value_at(policy, 0, [*prior, 0.0, 0.0, 0.0], touches + 1)  # after a touch that showed nothing
                assert nothing == pytest.approx(discount * later - 0.03)


def test_four_touches_of_the_largest_tables_are_not_refused():
    problem = uniform(random_table(0, 8, 4, 12), touch_cost=0.3)
    assert 0.0 <= finite_horizon_value(problem, 3) <= 1.0
    with pytest.raises(ValueError, match="histories"):
        finite_horizon_value(problem, 12)


def test_a_search_for_two_shapes_is_walds_test():
    # V(.9) = -λ + .82 · .976 + .18 (V(.9) - λ) and V(.5) = V(.9) - λ, if one stops two outcomes ahead
    beyond = 2 * 0.81 / 0.82 - 1
    at_nine = (-0.05 + 0.82 * beyond - 0.18 * 0.05) / 0.82
    policy = solve(uniform(NINE_OF_TEN))
    assert policy.lower_bound == pytest.approx(at_nine - 0.05, abs=1e-5)
    assert policy.upper_bound == pytest.approx(at_nine - 0.05, abs=1e-5)
    assert [int(policy.action([b, 1 - b])) for b in (0.5, 0.9, 0.988, 0.012)] == [0, 0, CONFIRM, REJECT]


def test_a_perfect_pose_is_touched_once():
    table = np.stack([np.full((2, 2), 0.5), np.eye(2)])
    policy = solve(uniform(table, touch_cost=0.1))
    assert policy.lower_bound == pytest.approx(0.9, abs=1e-12)
    assert policy.upper_bound == pytest.approx(0.9, abs=1e-6)
    assert policy.action([0.5, 0.5]) == 1
    assert policy.q_values([0.5, 0.5]) == pytest.approx([-0.1 + 0.9, 0.9, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("table", [np.full((3, 2, 4), 0.25), np.full((1, 2, 1), 1.0)])
def test_useless_poses_are_never_touched_and_ties_go_to_stopping(table):
    policy = solve(uniform(table, touch_cost=0.01))
    assert policy.action([0.5, 0.5]) == len(table)  # CONFIRM and REJECT are both worth 0
    assert policy.lower_bound == 0.0 <= policy.upper_bound


def test_equally_good_poses_go_to_the_lowest():
    assert solve(uniform(np.repeat(NINE_OF_TEN, 4, axis=0))).action([0.5, 0.5]) == 0


def test_a_touch_that_costs_too_much_is_not_made():
    policy = solve(uniform(NINE_OF_TEN, touch_cost=0.81))  # one touch is worth .8
    assert policy.action([0.5, 0.5]) == CONFIRM
    assert policy.upper_bound == pytest.approx(0.0, abs=1e-9)


def test_complementary_poses_are_both_touched_though_one_alone_tells_nothing():
    # Shapes 00, 01, 10, 11; pose i shows bit i; the target is 00 among 00 and 11 against 01 and 10 … told by both only.
    bits = np.array([[0, 0, 1, 1], [0, 1, 0, 1]])
    table = np.eye(2)[bits]  # (2, 4, 2)
    problem = TouchProblem(table, [0.25] * 4, target=0, touch_cost=0.05)
    prior = TouchProblem(table, [0.5, 0.25, 0.25, 0.0], target=0, touch_cost=0.05)
    for case in (problem, prior):
        policy = solve(case)
        assert policy.lower_bound == pytest.approx(finite_horizon_value(case, 2), abs=1e-9)
        assert policy.upper_bound == pytest.approx(policy.lower_bound, abs=1e-3)


def test_impossible_outcomes_and_shapes_are_no_trouble():
    table = np.array([[[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.2, 0.8, 0.0]]])
    problem = TouchProblem(table, [0.6, 0.4, 0.0], target=0, touch_cost=0.02)
    policy = solve(problem)
    # Outcome 1 rules the target out; outcome 0, n times, leaves odds .6 : .4 · 2^-n.
    assert policy.lower_bound <= policy.upper_bound <= policy.lower_bound + 1e-3
    assert policy.lower_bound >= finite_horizon_value(problem, 4) - 1e-9
    assert policy.action([0.0, 1.0, 0.0]) == REJECT


def test_a_certain_prior_stops_at_once():
    policy = solve(TouchProblem(NINE_OF_TEN, [1.0, 0.0], target=0, touch_cost=0.05))
    assert policy.lower_bound == policy.upper_bound == 1.0
    absent = solve(TouchProblem(NINE_OF_TEN, [0.0, 1.0], target=0, touch_cost=0.05))
    assert absent.action([0.0, 1.0]) == REJECT
    assert absent.lower_bound == 1.0


@pytest.mark.parametrize("num_shapes", [2, 3, 4, 5, 6])
@pytest.mark.parametrize("touch_cost", [0.02, 0.1])
def test_the_bounds_enclose_what_brute_force_finds(num_shapes, touch_cost):
    problem = uniform(random_table(num_shapes, 3, num_shapes, 3), target=1, touch_cost=touch_cost)
    policy = solve(problem)
    assert finite_horizon_value(problem, 4) <= policy.upper_bound + 1e-9
    assert policy.lower_bound <= policy.upper_bound
    assert policy.lower_bound >= 0.98 * finite_horizon_value(problem, 4)
    if num_shapes <= 4:
        assert policy.lower_bound >= 0.99 * policy.upper_bound


def test_the_same_problem_has_the_same_solution():
    one, other = (solve(uniform(random_table(1))) for _ in range(2))
    assert (one.vectors.alphas == other.vectors.alphas).all()


def test_batches_and_single_beliefs_are_treated_alike():
    policy = solve(uniform(random_table(2)))
    beliefs = np.random.default_rng(0).dirichlet(np.ones(3), size=(4, 5))
    assert policy.action(beliefs).shape == policy.value(beliefs).shape == (4, 5)
    assert policy.q_values(beliefs).shape == (4, 5, 5)
    assert policy.action(beliefs)[2, 3] == policy.action(beliefs[2, 3])
    assert policy.value(beliefs.astype(np.float16)) == pytest.approx(policy.value(beliefs), abs=2e-3)


def test_choosing_anew_after_a_touch_loses_next_to_nothing_against_the_plan():
    policy = solve(uniform(random_table(4, 4, 4, 6), touch_cost=0.02))
    beliefs = np.random.default_rng(0).dirichlet(np.ones(4), size=500)
    loss = policy.value(beliefs) - policy.q_values(beliefs).max(axis=1)
    assert loss.max() <= 1e-3
    assert loss.mean() < 0.0  # one exact step gains, on average


def test_a_touch_in_a_search_of_one_object_is_discounted_as_for_the_object_alone():
    table, belief = random_table(4), np.array([0.4, 0.35, 0.25])
    alone = solve(TouchProblem(table, belief, 0, 0.02, discount=0.6))
    search = solve(SearchTouchProblem(table, 1, "independent", 0, 0.02, belief, discount=0.6))
    hidden = search.search.initial  # the shape, and that no target was rejected
    probes = search.probe_values(0, hidden, 0, np.ones(len(table)))
    np.testing.assert_allclose(probes, alone.q_values(belief)[: len(table)], atol=1e-4)
    assert probes.max() <= search.upper_bound + 1e-9


def test_free_touches_need_a_limit():
    with pytest.raises(ValueError, match="touch limit"):
        solve(uniform(NINE_OF_TEN, touch_cost=0.0))
    assert finite_horizon_value(uniform(NINE_OF_TEN, touch_cost=0.0), 3) == pytest.approx(0.944, abs=1e-9)
    assert 0.8 < solve(uniform(NINE_OF_TEN, touch_cost=0.0, discount=0.99)).lower_bound < 1.0


# Searches


def search_value_by_recursion(problem, arrangements, weights, number, touches_left, told):
    """Value of a search with so many touches in all, over whole arrangements: the definition."""
    total = weights.sum()
    if total == 0.0:
        return 0.0
    if number == problem.num_objects:
        present = (arrangements == problem.target).any(axis=1)
        return float(weights @ np.where(present, -1.0, 1.0))
    shapes = arrangements[:, number]
    sign = np.where(shapes == problem.target, 1.0, -1.0)
    best = float(weights @ sign)
    last = number + 1 == problem.num_objects
    gamma = 1.0 if last else problem.discount
    groups = [shapes == shape for shape in np.unique(shapes)] if told else [np.ones(len(shapes), bool)]
    best = max(
        best,
        gamma
        * sum(
            search_value_by_recursion(problem, arrangements, weights * group, number + 1, touches_left, told)
            for group in groups
        ),
    )
    if touches_left:
        for table in problem.outcome_probs:
            worth = sum(
                search_value_by_recursion(
                    problem, arrangements, weights * column[shapes], number, touches_left - 1, told
                )
                for column in table.T
            )
            best = max(best, problem.discount * worth - problem.touch_cost * total)
    return best


def arrangements_of(problem):
    shapes = range(problem.num_shapes)
    if problem.composition == "distinct":
        rows = np.array(list(itertools.permutations(shapes, problem.num_objects)))
        return rows, np.full(len(rows), 1 / len(rows))
    rows = np.array(list(itertools.product(shapes, repeat=problem.num_objects)))
    return rows, problem.prior[rows].prod(axis=1)


@pytest.mark.parametrize("composition", ["distinct", "independent"])
@pytest.mark.parametrize(("num_objects", "num_shapes"), [(1, 2), (2, 2), (2, 3), (3, 3)])
@pytest.mark.parametrize("discount", [1.0, 0.9])
def test_search_bounds_enclose_what_brute_force_finds(composition, num_objects, num_shapes, discount):
    table = random_table(num_shapes, 2, num_shapes, 2, sharpness=2.5)
    problem = SearchTouchProblem(table, num_objects, composition, 0, 0.15, discount=discount)
    policy = solve(problem)
    rows, weights = arrangements_of(problem)
    least = search_value_by_recursion(problem, rows, weights, 0, 3, told=False)
    assert policy.lower_bound <= policy.upper_bound + 1e-12
    assert least <= policy.upper_bound + 1e-6
    # touches are dear, so that three in all are nearly as good as any number
    assert policy.lower_bound >= least - 0.01
    assert policy.initial_value == policy.lower_bound


@pytest.mark.parametrize("composition", ["distinct", "independent"])
@pytest.mark.parametrize(("discount", "touch_cost"), [(0.9, 0.01), (0.5, 0.05), (0.5, 0.2)])
def test_bounds_allow_that_a_discounted_failure_is_postponed(composition, discount, touch_cost):
    """A search that has failed touches on where this costs less than the failure: its value is -λ / (1 - γ)."""
    table = random_table(1, 1, 3, 2, sharpness=0.5)
    problem = SearchTouchProblem(table, 2, composition, 1, touch_cost, discount=discount)
    assert solve(problem, rounds=(60, 60)).initial_value <= upper_bound(problem) + 1e-6


def test_of_many_objects_there_is_a_bound_too():
    many = SearchTouchProblem(NINE_OF_TEN, 250, "independent", 0, 0.05)
    few = SearchTouchProblem(NINE_OF_TEN, 20, "independent", 0, 0.05)
    bounds = [upper_bound(problem) for problem in (few, many)]
    assert bounds[1] == pytest.approx(bounds[0], abs=1e-3)  # no search gets as far as the twentieth object


def test_of_many_shapes_the_bound_is_as_tight_where_most_are_easily_told_from_the_target():
    few = random_table(0, 3, 3, 4)
    table = np.zeros((3, 9, 5))
    table[:, :3, :4] = few
    table[:, 3:, 4] = 1.0  # one touch tells them from the target
    problem = SearchTouchProblem(table, 1, "independent", 0, 0.02, prior=np.full(9, 1 / 9))
    policy = solve(problem)
    assert policy.lower_bound <= policy.upper_bound <= policy.lower_bound + 0.02


def test_the_last_of_all_distinct_objects_is_confirmed_untouched():
    problem = SearchTouchProblem(np.full((2, 3, 2), 0.5), 3, "distinct", 1, 0.01)
    policy = solve(problem)
    assert policy.initial_value == pytest.approx(-1 / 3)  # nothing is told: confirm one of three
    first = policy.at(0)
    assert first.actions[first.best(staged(problem).initial[None])[0]] >= problem.num_poses  # and no touch before it
    belief = stage_belief(staged(problem), np.array([[0.0, -np.inf, 0.0], [0.0, -np.inf, 0.0], [0.0, 0.0, 0.0]]), 2)
    vectors = policy.at(2)
    assert vectors.actions[vectors.best(belief[None])].tolist() == [problem.num_poses]  # CONFIRM
    assert value_at(policy, 2, belief) == pytest.approx(1.0)


@given(st.integers(0, 1000))
def test_the_belief_about_a_stage_is_that_of_all_arrangements(seed):
    rng = np.random.default_rng(seed)
    for composition, prior in (("distinct", None), ("independent", [0.5, 0.3, 0.2])):
        problem = SearchTouchProblem(random_table(seed), 3, composition, 1, 0.05, prior=prior)
        logs = 3.0 * rng.normal(size=(3, 3))
        logs[2] = 0.0
        rows, weights = arrangements_of(problem)
        joint = weights * np.exp(logs[np.arange(3), rows].sum(axis=1))
        found = stage_belief(staged(problem), logs, 1)
        shapes = staged(problem).stages[1].shapes
        for shape in range(3):
            expected = joint[rows[:, 1] == shape].sum() / joint.sum()
            assert found[shapes == shape].sum() == pytest.approx(expected, abs=1e-9)


def test_likelihoods_of_any_size_leave_a_belief():
    problem = staged(SearchTouchProblem(random_table(0), 3, "distinct", 0, 0.05))
    logs = np.array([[0.0, -1e300, -1e300], [-2e300, 0.0, 0.0], [0.0, 0.0, -1e4]])
    for stage in range(3):
        belief = stage_belief(problem, logs, stage)
        assert np.isfinite(belief).all()
        assert belief.sum() == pytest.approx(1.0)


def test_too_many_hidden_states_are_refused_with_the_way_out():
    with pytest.raises(ValueError, match="hidden states"):
        solve(SearchTouchProblem(np.full((1, 12, 2), 0.5), 12, "distinct", 0, 0.05))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"num_objects": 0}, "num_objects"),
        ({"num_objects": 4}, "cannot all differ"),
        ({"composition": "bag"}, "composition|bag"),
        ({"prior": [1.0, 0.0, 0.0]}, "fixes the prior"),
    ],
)
def test_what_is_no_search_is_refused_by_name(change, message):
    arguments = {
        "outcome_probs": random_table(0),
        "num_objects": 3,
        "composition": "distinct",
        "target": 0,
        "touch_cost": 0.1,
    }
    with pytest.raises(ValueError, match=message):
        SearchTouchProblem(**arguments | change)
