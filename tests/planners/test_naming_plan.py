"""The plan for naming an object against the best plan by exhaustive recursion, and against choices without a plan."""

import numpy as np
import pytest

from belief import Belief, SearchProblem, Touch
from belief.observation_model import OutcomeTable
from belief.observation_model.action_kernel import ActionKernelModel
from belief.synthetic import SyntheticWorld, random_model
from planners import InformationState, search
from planners.decider import SequentialDecider
from planners.identification import identify
from planners.naming_plan import NamingPlan
from planners.probing import RandomOrder
from planners.stopping import PosteriorThresholds


def best_value(plan, belief, counts):
    """Value of the best plan from here, by trying all poses and outcomes."""
    values = [2.0 / (1.0 - plan.threshold) * (belief.max() - 1.0)]
    if sum(counts) < plan.max_touches:
        for pose, count in enumerate(counts):
            if count < plan.repeats:
                values.append(value_of_touch(plan, belief, counts, pose))
    return max(values)


def value_of_touch(plan, belief, counts, pose):
    weight = 1.0 / (1.0 + np.array(counts) @ plan.kernel[pose])
    after = tuple(n + (p == pose) for p, n in enumerate(counts))
    total = (1.0 - weight) * best_value(plan, belief, after)
    for outcome in plan.table.probs[pose].T:
        joint = belief * outcome
        total += weight * joint.sum() * best_value(plan, joint / joint.sum(), after)
    return total - 1.0


def kernel_of(*between):
    """Correlations of touches in poses 0 and 1, 0 and 2, 1 and 2; half as much of two in one pose."""
    kernel = np.eye(3) * between[0] / 2
    kernel[np.triu_indices(3, 1)] = between
    return np.maximum(kernel, kernel.T)


@pytest.mark.parametrize(
    ("kernel", "repeats"),
    [
        (np.zeros((3, 3)), 1),
        (kernel_of(0.5, 0.5, 0.5), 1),
        (kernel_of(0.9, 0.0, 0.3), 1),
        (kernel_of(0.1, 0.9, 0.0), 2),
    ],
)
def test_the_values_are_those_of_the_best_plan(kernel, repeats, rng):
    probs = rng.dirichlet(np.full(2, 0.3), size=(3, 3))
    plan = NamingPlan(OutcomeTable(probs), kernel, repeats, 0.9, 3)
    belief = np.full(3, 1 / 3)
    exact = [value_of_touch(plan, belief, (0, 0, 0), pose) for pose in range(3)]
    found = plan.touch_values(belief, (0, 0, 0))
    assert (found <= np.array(exact) + 1e-6).all()  # the value of a plan is a lower bound
    assert found.max() == pytest.approx(max(exact), abs=1e-3 if repeats == 1 else 0.1)


def test_touches_that_count_for_nothing_change_no_value(rng):
    plan = NamingPlan(OutcomeTable(rng.dirichlet(np.ones(2), size=(3, 3))), kernel_of(0.4, 0.2, 0.1), 1, 0.9, 4)
    problem, belief = SearchProblem(tuple("abc"), tuple("pqr"), 1, "independent"), Belief.uniform(tuple("abc"))
    once, often = (
        plan.choose(InformationState(problem, 0, belief, tuple(Touch(0, np.zeros(3)) for _ in range(number))), rng)
        for number in (1, 5)
    )
    assert once == often


def test_certainty_may_be_wanted(rng):
    plan = NamingPlan(OutcomeTable(np.eye(2)[None]), np.zeros((1, 1)), threshold=1.0)
    assert plan.touch_values(np.array([0.5, 0.5]), (0,)) == pytest.approx([-1.0])


def test_a_touch_that_tells_nothing_new_has_no_value():
    plan = NamingPlan(OutcomeTable(np.full((2, 2, 2), 0.5)), np.zeros((2, 2)), 1, 0.9, 5)
    assert plan.touch_values(np.array([0.5, 0.5]), (1, 0))[0] == -np.inf
    assert (plan.touch_values(np.array([0.5, 0.5]), (1, 1)) == -np.inf).all()


def test_it_chooses_the_poses_of_a_search_until_none_is_left(rng):
    model = random_model(rng, num_shapes=2, num_poses=2, sharpness=0.5)
    problem = SearchProblem(model.shape_labels, ("p", "q"), 1, "independent")
    decider = SequentialDecider(
        PosteriorThresholds(0.999, 0.001, 4), NamingPlan(model.outcome_table(), np.zeros((2, 2)))
    )
    episode = search(SyntheticWorld(model, (0,)), decider, problem, 0, model, seed=0)
    scores = [set(step.decision.scores) for step in episode.steps if step.touch]
    assert scores[0] == {"target_prob", "value_p", "value_q"}
    assert [len(some) for some in scores] == [3, 2, 1, 1]  # a pose that tells nothing new has no value


def test_the_plan_needs_fewer_touches_than_a_random_order(rng):
    """Pose 0 tells two groups of labels apart, pose 1 those within the groups, pose 2 tells nothing."""
    ratios = np.zeros((3, 400, 4))
    for pose, sign in enumerate(([1, 1, -1, -1], [1, -1, 1, -1], [0, 0, 0, 0])):
        labels = np.arange(400) % 4
        ratios[pose] = 4.0 * np.outer(np.array(sign)[labels], sign) + rng.normal(size=(400, 4))
    model = ActionKernelModel(("a", "b", "c", "d"), np.zeros((3, 3)), ratios, None)
    plan = NamingPlan(model.outcome_table(16), model.kernel, 2, 0.9, 6)
    poses = ("group", "member", "silent")
    touches = {}
    for name, selector in (("plan", plan), ("random", RandomOrder())):
        found = [identify(SyntheticWorld(model, [n % 4]), selector, model, poses, n, 0.9, 6) for n in range(60)]
        touches[name] = np.mean([len(one.poses) for one in found])
        assert np.mean([one.is_right for one in found]) > 0.85
    assert touches["plan"] < 0.9 * touches["random"]
