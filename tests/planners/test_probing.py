from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from belief import Belief, Probe, SearchProblem, Touch
from belief.bayes import target_information_gain
from belief.errors import InvalidArgument, UnknownName
from belief.observation_model import OutcomeTable
from belief.observation_model.outcome_mixture import OutcomeMixture
from planners import InformationState
from planners.pairs_of_touches import best_pairs
from planners.probing import FixedOrder, GivenOrder, RandomOrder, ShapeInformationGain, TargetInformationGain
from planners.repeats import CorrelatedRepeats

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


def test_a_good_pose_is_repeated_while_repeats_are_worth_more_than_a_poor_one(rng):
    # Repeats that are as good as fresh: always the best pose. Worthless ones: each pose once, as without a model.
    for correlation, expected in ((0.0, [2, 2, 2]), (0.999, [2, 1, 2])):
        selector, poses = TargetInformationGain(TABLE, CorrelatedRepeats(correlation)), []
        for _ in range(3):
            poses.append(selector.choose(info(*poses), rng).action.pose)
        assert poses == expected


def test_of_equally_good_poses_the_least_used_comes_first(rng):
    table = OutcomeTable(np.full((3, 2, 2), 0.5))
    selector = TargetInformationGain(table, CorrelatedRepeats(0.5))
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


@pytest.mark.parametrize("setting", [{"depth": 3}, {"hypotheses": 0}, {"outcomes": -1}, {"given": "size"}])
def test_settings_out_of_range_are_refused(setting):
    for selector in (TargetInformationGain, ShapeInformationGain):
        if setting.keys() <= {field.name for field in fields(selector)}:
            with pytest.raises(InvalidArgument, match=next(iter(setting))):
                selector(TABLE, **setting)


def test_where_one_touch_is_blind_the_best_pair_is_found():
    # Two bodies of each shape: pose 0 tells which, pose 1 shows the shape's bit turned around by the body.
    body, bit = np.eye(2)[[[0, 1], [0, 1]]], np.eye(2)[[[0, 1], [1, 0]]]
    mixture = OutcomeMixture(np.full((2, 2), 0.5), np.stack([body, bit, np.full((2, 2, 2), 0.5)]))
    alone = target_information_gain([0.5, 0.5], mixture.table.probs, 0)
    np.testing.assert_allclose(alone, 0.0, atol=1e-9)
    pairs = best_pairs(mixture, np.array([0.5, 0.5]), 0, alone)
    np.testing.assert_allclose(pairs, [np.log(2), np.log(2), 0.0], atol=1e-6)


def information_of_pairs(mixture, belief, target):
    """Mutual information of "this is the target" and the outcomes of two touches, by loops, ``(P, P)``."""
    found = np.zeros((len(mixture.probs),) * 2)
    for first, second in np.ndindex(found.shape):
        joint = np.einsum("k,kh,khm,khn->kmn", belief, mixture.weights, mixture.probs[first], mixture.probs[second])
        both = np.stack([joint[target], np.delete(joint, target, axis=0).sum(axis=0)])  # is it the target, outcomes
        independent = both.sum(axis=(1, 2), keepdims=True) * both.sum(axis=0)
        found[first, second] = (both * np.log(both / independent)).sum()
    return found


@pytest.mark.parametrize("target", [0, 2])
def test_the_information_of_the_best_pair_is_that_of_loops_over_its_outcomes(target, rng):
    weights, probs = rng.dirichlet(np.ones(5), size=3), rng.dirichlet(np.full(4, 0.5), size=(6, 3, 5))
    mixture, belief = OutcomeMixture(weights, probs), rng.dirichlet(np.ones(3))
    alone = target_information_gain(belief, mixture.table.probs, target)
    best = information_of_pairs(mixture, belief, target).max(axis=1)
    np.testing.assert_allclose(best_pairs(mixture, belief, target, alone), best, atol=1e-5)
    some = best_pairs(mixture, belief, target, alone, candidates=2)
    looked_into = np.argsort(alone)[-2:]
    np.testing.assert_allclose(some[looked_into], best[looked_into], atol=1e-5)
    others = np.delete(np.arange(6), looked_into)
    np.testing.assert_array_equal(some[others], alone[others])


def test_of_many_blind_poses_some_that_are_spread_evenly_are_looked_into():
    body, bit = np.eye(2)[[[0, 1], [0, 1]]], np.eye(2)[[[0, 1], [1, 0]]]
    mixture = OutcomeMixture(np.full((2, 2), 0.5), np.stack([body, *[bit] * 20]))  # each bit goes with the body
    found = best_pairs(mixture, np.array([0.5, 0.5]), 0, np.zeros(21), candidates=5)
    assert np.flatnonzero(found > 0.1).tolist() == [0, 5, 10, 15, 20]


def test_two_touches_are_looked_ahead_only_where_one_is_blind(rng):
    silent, body, bit = np.full((2, 2, 2), 0.5), np.eye(2)[[[0, 1], [0, 1]]], np.eye(2)[[[0, 1], [1, 0]]]
    plain = np.array([[[0.7, 0.3]] * 2, [[0.3, 0.7]] * 2])  # tells the shape of either body
    for third, pose, gain in ((bit, 1, np.log(2)), (plain, 2, np.log(2) + 0.7 * np.log(0.7) + 0.3 * np.log(0.3))):
        mixture = OutcomeMixture(np.full((2, 2), 0.5), np.stack([silent, body, third]))
        state = SimpleNamespace(
            problem=PROBLEM,
            belief=Belief.uniform(tuple("ab")),
            target=0,
            target_prob=0.5,
            uses=np.zeros(3, int),
            evidence=SimpleNamespace(outcome_mixture=lambda outcomes, hypotheses, mixture=mixture: mixture),
        )
        decision = TargetInformationGain(TABLE, depth=2).choose(state, rng)
        assert decision.action == Probe(pose)
        assert decision.scores[f"gain_{PROBLEM.pose_labels[pose]}"] == pytest.approx(gain)
