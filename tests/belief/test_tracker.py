"""Trackers against enumeration of the joint distribution of a small scene."""

import numpy as np
import pytest

from belief import Belief, BeliefTracker, Composition, ImpossibleObservation, SceneBelief, SearchProblem, Touch
from belief.calibration import TemperatureScaling
from belief.observation_model import ConfusionModel


def problem(num_objects, composition=Composition.DISTINCT, num_shapes=4):
    labels = tuple(f"shape_{k}" for k in range(num_shapes))
    return SearchProblem(labels, ("p0", "p1", "p2"), num_objects, composition)


def test_touching_one_object_informs_about_the_others_only_when_shapes_are_distinct(model, rng):
    touches = model.sample(0, [0] * 5, rng)
    for composition, informed in ((Composition.DISTINCT, True), (Composition.INDEPENDENT, False)):
        scene = SceneBelief(problem(2, composition), model)
        scene.update(0, touches)
        assert bool(abs(scene.marginals()[1] - 0.25).max() > 0.01) is informed


def test_tracker_equals_bayes_rule_on_all_touches_at_once(model, rng):
    tracker = BeliefTracker(Belief.uniform(model.shape_labels), model)
    touches = model.sample(1, [0, 1, 2, 0], rng)
    for touch in touches:
        belief = tracker.update(touch)
    expected = Belief.uniform(model.shape_labels).update(model.log_likelihood(touches))
    np.testing.assert_allclose(belief.probs, expected.probs, atol=1e-12)
    assert tracker.touches == tuple(touches)


def certain_model():
    """Two shapes a perfect sensor tells apart: contradicting touches are impossible."""
    return ConfusionModel(("a", "b"), np.eye(2)[None], TemperatureScaling(1.0, "ok"))


def test_impossible_touch_raises_and_leaves_the_tracker_as_it_was():
    tracker = BeliefTracker(Belief.uniform(("a", "b")), certain_model())
    tracker.update(Touch(0, np.array([1.0, 0.0])))
    with pytest.raises(ImpossibleObservation, match=r"pose 0, Belief\(a 1.000, b 0.000\).*log-likelihood \[-inf, "):
        tracker.update(Touch(0, np.array([0.0, 1.0])))
    assert tracker.belief.probs.tolist() == [1.0, 0.0]
    assert len(tracker.touches) == 1


def test_impossible_touch_raises_and_leaves_the_scene_as_it_was():
    scene = SceneBelief(SearchProblem(("a", "b"), ("p",), 2), certain_model())
    scene.update(0, [Touch(0, np.array([1.0, 0.0]))])
    with pytest.raises(ImpossibleObservation, match="touching object 1 in poses"):
        scene.update(1, [Touch(0, np.array([1.0, 0.0]))])
    assert scene.marginals().tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert scene.touches(1) == ()


def test_a_model_of_other_shapes_is_refused(model):
    with pytest.raises(ValueError, match="the model about"):
        SceneBelief(SearchProblem(("a", "b"), ("p",), 2), model)
    with pytest.raises(ValueError, match="the model about"):
        BeliefTracker(Belief.uniform(tuple("ab")), model)
