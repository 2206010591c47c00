from dataclasses import fields

import numpy as np
import pytest
from scipy.special import logsumexp

from belief import Belief, Probe, SceneBelief, SearchProblem, Touch
from belief.errors import CorruptFile, InvalidArgument, UnknownName
from belief.observation_model import FixedHypotheses, OutcomeTable, RigidBodyModel
from planners import InformationState
from planners.probing import (
    ORDER_FILE,
    FixedOrder,
    GivenOrder,
    NoOrder,
    PoseInformationGain,
    RandomOrder,
    RepeatDiscount,
    ShapeInformationGain,
    TargetInformationGain,
    greedy_order,
    read_order,
    write_order,
)

PROBLEM = SearchProblem(("a", "b"), ("useless", "good", "better"), num_objects=2)
TABLE = OutcomeTable([[[0.5, 0.5]] * 2, [[0.7, 0.3], [0.3, 0.7]], [[0.9, 0.1], [0.1, 0.9]]])


def info(*poses):
    return InformationState(PROBLEM, 0, Belief.uniform(tuple("ab")), tuple(Touch(p, np.zeros(2)) for p in poses))


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
    state = InformationState(problem, 0, Belief.uniform(tuple("abc")))
    assert TargetInformationGain(table).choose(state, rng).action == Probe(1)


def test_random_order_uses_every_pose_before_it_repeats_one_and_follows_its_rng():
    def poses(seed):
        rng, chosen = np.random.default_rng(seed), []
        for _ in range(6):
            chosen.append(RandomOrder().choose(info(*chosen), rng).action.pose)
        return chosen

    assert sorted(poses(0)[:3]) == sorted(poses(0)[3:]) == [0, 1, 2]
    assert poses(0) == poses(0)
    assert len({tuple(poses(seed)) for seed in range(20)}) > 10


def test_shape_information_gain_cares_for_any_distinction(rng):
    table = OutcomeTable([[[0.5, 0.5], [1, 0], [0, 1]], [[0.6, 0.4], [0.5, 0.5], [0.5, 0.5]]])
    problem = SearchProblem(("a", "b", "c"), ("p", "q"), num_objects=3)
    state = InformationState(problem, 0, Belief.uniform(tuple("abc")))
    assert ShapeInformationGain(table).choose(state, rng).action == Probe(0)


def test_pose_information_gain_asks_how_a_body_lies_once_its_shape_is_known(rng):
    # Of shape a, the first pose shows which of two shapes it is, the second how the body lies, the third nothing.
    marks = np.array([[[0, 0], [1, 1]], [[0, 1], [0, 1]], [[0, 0], [0, 0]]])  # (P, K, N)
    hypotheses, flat = 60.0 * np.eye(2, dtype=np.float32)[marks], np.zeros((3, 2, 2))
    outcomes = np.tile(np.eye(2), (3, 1, 1))
    model = RigidBodyModel(("a", "b"), 2, 1.0, outcomes, flat, hypotheses=FixedHypotheses(hypotheses))
    problem = SearchProblem(("a", "b"), ("which", "lies", "nothing"), 2, "independent")
    scene, found = SceneBelief(problem, model), []
    selector = PoseInformationGain(model.outcome_table())
    for _ in range(2):
        state = InformationState.of(problem, 0, scene, 0)
        found.append(selector.choose(state, rng).action.pose)
        scene.update(0, [Touch(found[-1], np.zeros(2), np.eye(2)[0])])
    assert found == [0, 1]
    gains = InformationState.of(problem, 0, scene, 0).evidence.outcome_mixture(2, 2).of_hypotheses(np.array([1.0, 0.0]))
    assert gains.sum(axis=(1, 2)) == pytest.approx(1.0)
    table = OutcomeTable([[[0.5, 0.5], [1, 0], [0, 1]], [[0.6, 0.4], [0.5, 0.5], [0.5, 0.5]]])
    without = InformationState(
        SearchProblem(("a", "b", "c"), ("p", "q"), num_objects=3), 0, Belief.uniform(tuple("abc"))
    )
    assert PoseInformationGain(table).choose(without, rng).action == Probe(0)


def test_a_good_pose_is_repeated_while_repeats_are_worth_more_than_a_poor_one(rng):
    # Repeats that are as good as fresh: always the best pose. Worthless ones: each pose once, as without a model.
    for correlation, expected in ((0.0, [2, 2, 2]), (0.999, [2, 1, 2])):
        selector, poses = TargetInformationGain(TABLE, RepeatDiscount(correlation)), []
        for _ in range(3):
            poses.append(selector.choose(info(*poses), rng).action.pose)
        assert poses == expected


def test_of_equally_good_poses_the_least_used_comes_first(rng):
    table = OutcomeTable(np.full((3, 2, 2), 0.5))
    selector = TargetInformationGain(table, RepeatDiscount(0.5))
    assert selector.choose(info(0, 0, 1), rng).action == Probe(2)


def test_a_given_order_is_followed_then_the_other_poses_then_again(rng):
    selector = GivenOrder(("better", "useless"))
    assert [selector.choose(info(*[0] * n), rng).action.pose for n in range(5)] == [2, 0, 1, 2, 0]
    with pytest.raises(UnknownName, match="bitter"):
        GivenOrder(("bitter",)).choose(info(), rng)
    for order in ((), ("good", "good")):
        with pytest.raises(InvalidArgument, match="order"):
            GivenOrder(order)


def test_given_the_shape_only_poses_that_are_alike_come_at_random_and_others_do_not(rng):
    alike = TargetInformationGain(OutcomeTable(np.full((3, 2, 2), 0.5)), given="shape")
    assert {alike.choose(info(), rng).action.pose for _ in range(40)} == {0, 1, 2}
    assert {alike.choose(info(1, 2), rng).action.pose for _ in range(10)} == {0}
    assert {TargetInformationGain(TABLE, given="shape").choose(info(), rng).action.pose for _ in range(10)} == {2}
    rounded = OutcomeTable([[[0.9, 0.1], [0.1, 0.9]], [[0.9 + 1e-13, 0.1 - 1e-13], [0.1, 0.9]], [[0.5, 0.5]] * 2])
    nearly = TargetInformationGain(rounded, given="shape")
    assert {nearly.choose(info(), rng).action.pose for _ in range(40)} == {0, 1}


@pytest.mark.parametrize("setting", [{"hypotheses": 0}, {"outcomes": -1}, {"given": "size"}])
def test_settings_out_of_range_are_refused(setting):
    for selector in (TargetInformationGain, ShapeInformationGain, PoseInformationGain):
        if setting.keys() <= {field.name for field in fields(selector) if field.init}:
            with pytest.raises(InvalidArgument, match=next(iter(setting))):
                selector(TABLE, **setting)


def test_the_order_takes_what_tells_most_given_the_poses_before(rng):
    # Four shapes: poses 0 and 1 show the first bit, pose 2 the second, pose 3 nothing.
    bits = np.array([[0, 0, 1, 1], [0, 0, 1, 1], [0, 1, 0, 1], [0, 0, 0, 0]])
    shapes = np.arange(40) % 4
    right = bits[:, shapes][:, :, None] == bits[:, None, :]  # (P, S, K)
    logits = np.array([2.0, 1.9, 1.5, 1.0])[:, None, None] * right

    def loss(poses):
        totals = logits[list(poses)].sum(axis=0)
        return float((logsumexp(totals, axis=1) - totals[np.arange(40), shapes]).mean())

    order, losses = greedy_order(4, 4, loss)
    assert order == (0, 2, 1, 3)
    assert (np.diff(losses) <= 1e-6).all()


def test_an_order_is_read_as_written_and_refused_if_changed_or_missing(tmp_path):
    write_order(tmp_path, ["+x", "-y+z"], np.array([0.5, 0.25]))
    assert read_order(tmp_path) == ("+x", "-y+z")
    (tmp_path / ORDER_FILE).write_text((tmp_path / ORDER_FILE).read_text().replace("+x", "-x"))
    with pytest.raises(CorruptFile, match="changed"):
        read_order(tmp_path)
    for folder in (None, tmp_path / "nowhere"):
        with pytest.raises(NoOrder, match="activetouch calibrate"):
            read_order(folder)
