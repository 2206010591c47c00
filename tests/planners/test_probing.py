import numpy as np
import pytest

from belief import Belief, Probe, SearchProblem, Touch
from belief.observation_model import OutcomeTable
from planners import InformationState
from planners.probing import FixedOrder, TargetInformationGain

PROBLEM = SearchProblem(("a", "b"), ("useless", "good", "better"), num_objects=2)
TABLE = OutcomeTable([[[0.5, 0.5]] * 2, [[0.7, 0.3], [0.3, 0.7]], [[0.9, 0.1], [0.1, 0.9]]])


def info(*poses):
    return InformationState(PROBLEM, 0, Belief.uniform("ab"), tuple(Touch(p, np.zeros(2)) for p in poses))


def test_fixed_order_goes_round(rng):
    poses = [FixedOrder().choose(info(*[0] * n), rng).action.pose for n in range(5)]
    assert poses == [0, 1, 2, 0, 1]


def test_the_most_informative_pose_comes_first_and_the_useless_one_last(rng):
    selector, poses = TargetInformationGain(TABLE), []
    for _ in range(4):
        poses.append(selector.choose(info(*poses), rng).action.pose)
    assert poses == [2, 1, 0, 2]


def test_ties_go_to_the_lowest_pose(rng):
    table = OutcomeTable(np.full((3, 2, 2), 0.5))
    assert TargetInformationGain(table).choose(info(), rng).action == Probe(0)


def test_the_scores_say_what_every_pose_was_worth(rng):
    scores = TargetInformationGain(TABLE).choose(info(), rng).scores
    # Symmetric channel with error e and a fair bit: log 2 - H(e).
    expected = np.log(2) + 0.1 * np.log(0.1) + 0.9 * np.log(0.9)
    assert scores["gain_better"] == pytest.approx(expected)
    assert scores["gain_useless"] == pytest.approx(0.0, abs=1e-12)


def test_a_distinction_between_other_shapes_is_worth_nothing(rng):
    # Pose 0 tells b from c perfectly, pose 1 tells a little about the target a.
    table = OutcomeTable([[[0.5, 0.5], [1, 0], [0, 1]], [[0.6, 0.4], [0.5, 0.5], [0.5, 0.5]]])
    problem = SearchProblem(("a", "b", "c"), ("p", "q"), num_objects=3)
    state = InformationState(problem, 0, Belief.uniform("abc"))
    assert TargetInformationGain(table).choose(state, rng).action == Probe(1)
