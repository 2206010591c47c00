"""A sensor whose description is doubted: nothing changes without a reason, and in doubt other states are asked."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from belief import SceneBelief, SearchProblem, Touch
from belief.conflict import ConflictTest
from belief.errors import InvalidArgument
from belief.observation_model import (
    FixedHypotheses,
    FixedWorlds,
    RigidBodyModel,
    SensorHealthModel,
    check_observation_model,
    spread_prior,
)
from belief.observation_model.doubted_sensor import DoubtedSensorModel, Explanation

LABELS = ("mug", "cup")
TABLE = np.array([[[[2.0, 0.0]], [[0.0, 2.0]]]], np.float32)
ONE = np.ones((1, 1, 2))
IMAGE = np.zeros((2, 2), np.uint8)
PROBLEM = SearchProblem(LABELS, ("front",), 2, "independent")


def nominal():
    return RigidBodyModel(LABELS, 1, 1.0, ONE, ONE, hypotheses=FixedHypotheses(TABLE))


class Doubting:
    """Doubts where asked to; the embeddings of the one other state have the wrong sign."""

    labels = ("wrong sign",)

    def __init__(self, is_odd=True, log_unexplained=-2.0):
        self.is_odd, self.log_unexplained, self.prepared = is_odd, log_unexplained, 0

    def are_odd(self, objects, log_conflict):
        return self.is_odd

    def states(self):
        self.prepared += 1
        return SensorHealthModel(nominal(), FixedWorlds(-TABLE[:, None]), self.labels, spread_prior(1))

    def read_again(self, touch):
        return touch

    def explained(self, objects, log_likelihoods, health):
        return Explanation(log_likelihoods, str(health), self.log_unexplained)

    def log_stranger(self, one):
        return 1.5 * len(one.touches)

    def log_strangers(self, one):
        return np.array([1.0, -0.5, 0.0]) * len(one.touches) - one.inferred.nominal.constant


def touched(model, touches, log_bets=0.0):
    scene = SceneBelief(PROBLEM, model, log_bets=log_bets)
    for place, touch in enumerate(touches):
        scene.update(place % 2, [touch])
    return scene


def touches_of(rng, number=6, image=IMAGE):
    return [Touch(0, features=row, image=image) for row in rng.normal(size=(number, 2))]


def test_without_a_reason_nothing_changes_and_nothing_is_prepared(rng):
    doubts, touches = Doubting(is_odd=False), touches_of(rng)
    scene, plain = touched(DoubtedSensorModel(nominal(), doubts), touches), touched(nominal(), touches)
    np.testing.assert_array_equal(scene.log_marginals(), plain.log_marginals())
    assert scene.log_conflict == plain.log_conflict
    assert str(scene.sensor_health) == "as described"
    assert not doubts.prepared
    assert not scene.log_bets[1:].any()


def test_a_description_that_leaves_the_state_open_is_weighed_from_the_start(rng):
    doubts = Doubting(is_odd=False, log_unexplained=-50.0)
    states = doubts.states()
    model, touches, prepared = DoubtedSensorModel(states, doubts), touches_of(rng), doubts.prepared
    check_observation_model(model, rng)
    scene, weighed = touched(model, touches), touched(states, touches)
    np.testing.assert_allclose(scene.log_marginals(), weighed.log_marginals(), atol=1e-12)
    later, after = touched(model, touches[:2], scene.log_bets), touched(states, touches[:2], weighed.log_bets)
    np.testing.assert_allclose(later.log_marginals(), after.log_marginals(), atol=1e-12)
    without = [Touch(0, features=touch.features) for touch in touches]
    np.testing.assert_allclose(touched(model, without).log_marginals(), weighed.log_marginals(), atol=1e-12)
    assert doubts.prepared == prepared  # no other states are asked for
    alone, known = model.start().updated(touches), states.start().updated(touches)
    np.testing.assert_array_equal(alone.log_likelihood, known.log_likelihood)
    strange = touched(DoubtedSensorModel(states, Doubting(log_unexplained=30.0)), touches)
    np.testing.assert_allclose(strange.marginals(), 0.5, atol=1e-9)
    assert strange.log_conflict == 30.0


def test_touches_without_an_image_cannot_be_read_again(rng):
    touches = touches_of(rng, image=None)
    scene = touched(DoubtedSensorModel(nominal(), Doubting()), touches)
    np.testing.assert_array_equal(scene.log_marginals(), touched(nominal(), touches).log_marginals())


def test_another_state_explains_what_the_described_one_reads_wrongly():
    cup = Touch(0, features=np.array([0.0, -3.0]), image=IMAGE)
    model = DoubtedSensorModel(nominal(), Doubting())
    scene = touched(model, [cup] * 6)
    assert scene.marginals().argmax(axis=1).tolist() == [1, 1]
    assert touched(nominal(), [cup] * 6).marginals().argmax(axis=1).tolist() == [0, 0]
    assert scene.view().log_conflict == -2.0
    assert str(scene.sensor_health) == "nearest of the listed states: wrong sign 1.00"
    model.doubts.is_odd = False
    later = touched(model, [cup], scene.log_bets)  # the next search of the set-up begins in doubt
    assert later.sensor_health.in_doubt
    assert later.marginals()[0].argmax() == 1


def test_what_no_state_explains_tells_nothing_about_the_shapes():
    cup = Touch(0, features=np.array([0.0, -3.0]), image=IMAGE)
    scene = touched(DoubtedSensorModel(nominal(), Doubting(log_unexplained=20.0)), [cup] * 6)
    np.testing.assert_allclose(scene.marginals(), 0.5, atol=1e-4)
    assert scene.log_conflict == 20.0
    assert str(scene.sensor_health).startswith("none explains the touches; nearest")
    assert scene.sensor_health.probs[1] > 0.99
    assert scene.log_bets[2] <= 4.0  # the next search may find an explanation


def mixed(rows, prior):
    """p(shape or none) of one object, of log likelihoods ``(..., K + 1)`` whose last column is that of strangers."""
    shares = np.append(np.full(2, (1.0 - prior) / 2), prior)
    return np.exp(rows) * shares / (np.exp(rows) @ shares)[..., None]


def test_a_stranger_is_weighed_beside_the_shapes_in_every_state(rng):
    touches, prior = touches_of(rng, 4), 0.2
    problem = SearchProblem(LABELS, ("front",), 2, "independent", unlisted=prior)
    states = Doubting().states()
    model = DoubtedSensorModel(states, Doubting(log_unexplained=-80.0))
    scene = SceneBelief(problem, model)
    scene.update(0, touches[:3])
    scene.update(1, touches[3:])
    # By hand: both objects in one state of the sensor, which is drawn anew with a small probability.
    ratios = [states.start().updated(some).log_ratios for some in (touches[:3], touches[3:])]
    numbers = [np.array([1.0, -0.5, 0.0]) * n for n in (3, 1)]
    constants = [states.start().updated(some).nominal.constant for some in (touches[:3], touches[3:])]
    rows = [np.column_stack([r, n - c]) for r, n, c in zip(ratios, numbers, constants, strict=True)]
    shares = np.append(np.full(2, (1.0 - prior) / 2), prior)
    told = [np.exp(one) @ shares for one in rows]
    prob, kept = states.prior, 1.0 - states.forgetting
    moves = kept * np.eye(3) + states.forgetting * prob
    for place, weights in ((0, prob * (moves @ told[1])), (1, (prob * told[0]) @ moves)):
        expected = weights @ np.exp(rows[place]) * shares
        found = scene.belief(place)
        np.testing.assert_allclose(np.append(found.probs, found.unlisted), expected / expected.sum(), rtol=1e-9)
    assert scene.sensor_health.log_unexplained == -80.0


def test_without_doubt_bets_and_random_bodies_are_averaged(rng):
    touches = touches_of(rng, 3)
    usual = ConflictTest.fit(rng.normal(size=(100, 4, 2)), rng.normal(size=(100, 4)), np.arange(100) % 2)
    problem = SearchProblem(LABELS, ("front",), 1, "independent", unlisted=0.2)
    tested = replace(nominal(), conflict=usual)
    scene = SceneBelief(problem, DoubtedSensorModel(tested, Doubting(is_odd=False)))
    scene.update(0, touches)
    evidence = tested.start()
    for touch in touches:
        evidence = evidence.update(touch)
    mean = np.logaddexp.reduce(evidence.log_likelihood) - np.log(2)
    strange = np.log((np.exp(evidence.log_unlisted) + np.exp(mean + 4.5)) / 2)
    expected = mixed(np.append(evidence.log_likelihood, strange), 0.2)
    np.testing.assert_allclose(np.append(scene.belief(0).probs, scene.belief(0).unlisted), expected, rtol=1e-9)
    assert str(scene.sensor_health) == "as described"


def test_the_order_of_updates_and_another_process_change_nothing(rng):
    model, touches = DoubtedSensorModel(nominal(), Doubting()), touches_of(rng)
    one_by_one, at_once = SceneBelief(PROBLEM, model), SceneBelief(PROBLEM, model)
    for touch in touches:
        one_by_one.update(0, [touch])
    at_once.update(0, touches)
    np.testing.assert_allclose(one_by_one.log_marginals(), at_once.log_marginals())
    sent = pickle.loads(pickle.dumps(one_by_one.evidence(0)))
    np.testing.assert_array_equal(sent.log_likelihood, one_by_one.evidence(0).log_likelihood)
    np.testing.assert_array_equal(sent.inferred.log_likelihood, one_by_one.evidence(0).inferred.log_likelihood)


def test_it_is_an_observation_model(rng):
    model = DoubtedSensorModel(nominal(), Doubting())
    check_observation_model(model, rng, 4)
    assert type(model).from_fields(model.to_fields()).shape_labels == LABELS


def test_an_image_is_bytes():
    with pytest.raises(InvalidArgument, match="array of bytes"):
        Touch(0, features=np.ones(2), image=np.zeros((2, 2)))
