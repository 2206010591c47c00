"""Deciders that read what the next touch of one rigid body can tell."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belief import Confirm, Probe, Reject, SceneBelief, SearchProblem, Touch
from belief.errors import InvalidArgument
from belief.observation_model import FixedHypotheses, RigidBodyModel
from belief.observation_model.outcome_mixture import information
from planners import InformationState, make_decider
from planners.probing import RepeatDiscount, next_touch
from planners.value_of_information import ValueOfInformation

P, K, N, M, D = 3, 3, 10, 6, 4
PROBLEM = SearchProblem(tuple("abc"), ("p", "q", "r"), 2, "independent", touch_cost=0.02)


def model_of(rng, sharpness=2.0, num_hypotheses=N):
    hypotheses = rng.normal(size=(P, K, num_hypotheses, D)).astype(np.float32)
    references = sharpness * rng.normal(size=(P, M, D))
    return RigidBodyModel(
        tuple("abc"),
        num_hypotheses,
        1.0,
        references,
        rng.normal(size=(P, M, K)),
        hypotheses=FixedHypotheses(hypotheses),
    )


def state(model, rng, number=2, problem=PROBLEM):
    scene = SceneBelief(problem, model)
    scene.update(0, [Touch(int(rng.integers(P)), np.zeros(K), rng.normal(size=D)) for _ in range(number)])
    return InformationState.of(problem, 0, scene, 0)


def value(mixture, belief, payoffs, cost, depth):
    """Value of the best plan that begins with each pose, by recursion over hypotheses and outcomes."""
    joint = belief[:, None] * mixture.weights  # (K, H)

    def best(joint, depth):
        stop = (payoffs @ joint.sum(axis=1)).max()
        return stop if depth == 0 else max(stop, *probes(joint, depth))

    def probes(joint, depth):
        chance = joint.sum()
        return [
            sum(best(joint * mixture.probs[pose, :, :, m], depth - 1) for m in range(mixture.probs.shape[3]))
            - cost * chance
            for pose in range(P)
        ]

    return np.array(probes(joint, depth))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([1, 2]))
def test_the_value_of_touches_agrees_with_recursion(seed, depth):
    rng = np.random.default_rng(seed)
    model = model_of(rng)
    info = state(model, rng, int(rng.integers(3)))
    decider = ValueOfInformation(model.outcome_table(), depth)
    payoffs = decider.payoffs(info)
    mixture = info.evidence.outcome_mixture(M, N)
    expected = value(mixture, info.belief.probs, payoffs, PROBLEM.touch_cost, depth)
    np.testing.assert_allclose(decider.probe_values(info, payoffs), expected, atol=1e-5)


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 4))
def test_two_touches_ahead_are_worth_at_least_one_and_gains_are_never_negative(seed, number):
    rng = np.random.default_rng(seed)
    model = model_of(rng, num_hypotheses=200)
    info = state(model, rng, number)
    one, two = (ValueOfInformation(model.outcome_table(), depth) for depth in (1, 2))
    payoffs = one.payoffs(info)
    assert (two.probe_values(info, payoffs) >= one.probe_values(info, payoffs) - 1e-9).all()
    for name in ("information_gain", "shape_information_gain"):
        decision = make_decider(name, model.outcome_table(), model).decide(info, rng)
        gains = [gain for score, gain in decision.scores.items() if score.startswith("gain")]
        assert min(gains, default=0.0) >= 0.0


def test_a_pose_is_not_repeated_where_the_body_would_feel_the_same(rng):
    marks = rng.integers(M, size=(P, K, 30))
    hypotheses = 60.0 * np.eye(M, dtype=np.float32)[marks]
    model = RigidBodyModel(
        tuple("abc"),
        30,
        1.0,
        np.tile(np.eye(M), (P, 1, 1)),
        np.zeros((P, M, K)),
        hypotheses=FixedHypotheses(hypotheses),
    )
    for pose in range(P):
        scene = SceneBelief(PROBLEM, model)
        scene.update(0, [Touch(pose, np.zeros(K), np.eye(M)[marks[pose, 0, 0]])])
        info = InformationState.of(PROBLEM, 0, scene, 0)
        joint, weights = next_touch(info, np.diag(info.belief.probs), model.outcome_table(), RepeatDiscount())
        assert (weights == 1.0).all()
        assert information(joint)[pose] == pytest.approx(0.0, abs=1e-6)
        names = (
            "information_gain",
            "shape_information_gain",
            "value_of_information",
            "point_based(given='body')",
        )
        for name in names:
            action = make_decider(name, model.outcome_table(), model).decide(info, rng).action
            assert action != Probe(pose)


def test_a_plan_of_first_touches_stops_where_the_second_touch_would_tell_all(rng):
    # The first pose tells only how the body lies; the second tells the shape to one who knows how it lies.
    lies, shapes = np.arange(2)[None, :], np.arange(2)[:, None]
    marks = np.stack(np.broadcast_arrays(lies, lies ^ shapes))  # (P, K, N)
    hypotheses = 60.0 * np.eye(2, dtype=np.float32)[marks]
    model = RigidBodyModel(
        ("a", "b"), 2, 1.0, np.tile(np.eye(2), (2, 1, 1)), np.zeros((2, 2, 2)), hypotheses=FixedHypotheses(hypotheses)
    )
    problem = SearchProblem(("a", "b"), ("first", "second"), 2, "independent", touch_cost=0.02)
    scene = SceneBelief(problem, model)
    scene.update(0, [Touch(0, np.zeros(2), np.eye(2)[1])])
    info, table = InformationState.of(problem, 0, scene, 0), model.outcome_table()
    assert make_decider("point_based(given='body')", table, model).decide(info, rng).action == Probe(1)
    assert make_decider("point_based", table, model).decide(info, rng).action in (Confirm(), Reject())
    with pytest.raises(InvalidArgument, match="given must be"):
        make_decider("point_based(given='all')", table, model)


@pytest.mark.parametrize("depth", [1, 2])
@pytest.mark.parametrize("touch_cost", [0.0, 0.02])
def test_touches_that_tell_nothing_are_not_made(rng, depth, touch_cost):
    model = model_of(rng, sharpness=0.0)
    problem = replace(PROBLEM, touch_cost=touch_cost)
    info = state(model, rng, 0, problem)
    assert ValueOfInformation(model.outcome_table(), depth).decide(info, rng).action == Reject()


def test_without_a_joint_belief_the_static_table_is_read(rng):
    model = model_of(rng)
    info = replace(state(model, rng), scene=None)
    joint, weights = next_touch(info, np.eye(K), model.outcome_table(), RepeatDiscount())
    np.testing.assert_array_equal(joint, model.outcome_table().probs)
    assert weights.tolist() == RepeatDiscount().weights(info.uses).tolist()


@pytest.mark.parametrize("drift", [0.0, 0.2])
def test_the_value_of_a_repeat_is_that_of_a_touch_that_may_tell_nothing(rng, drift):
    """With correlation one, no repeat has a value above its cost, whatever the mixture over bodies says of it."""
    model = replace(model_of(rng), correlation=1.0, drift=drift)
    scene = SceneBelief(PROBLEM, model)
    scene.update(0, [Touch(1, np.zeros(K), rng.normal(size=D))])
    info = InformationState.of(PROBLEM, 0, scene, 0)
    decider = ValueOfInformation(model.outcome_table(), 1)
    payoffs = decider.payoffs(info)
    values = decider.probe_values(info, payoffs)
    stop = (payoffs @ info.belief.probs).max()
    assert values[1] == pytest.approx(stop - PROBLEM.touch_cost, abs=1e-6)
    table = info.evidence.outcome_mixture(M, N).table.probs
    new = 1.0 - table[:, 0, -1]
    expected = 1.0 if drift == 0.0 else 2.0 / 1.2 - 1.0  # effective touches: 2 / (1 + κ), less the first
    np.testing.assert_allclose(new, [expected, 0.0, expected], atol=1e-6)
