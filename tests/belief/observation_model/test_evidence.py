"""Evidence touch by touch: what all touches at once would tell, at a cost that does not grow with them."""

import numpy as np
import pytest

from belief import Belief, BeliefTracker, SceneBelief, SearchProblem, Touch
from belief.observation_model.evidence import RecomputedEvidence, SummarisedEvidence, Summarises, start
from belief.observation_model.registry import fits
from tests.belief.conftest import MODELS, model_named

LABELS = ("ball", "cube", "cone")


class Told:
    """A user's model with no more than a likelihood; counts the touches that it is handed."""

    shape_labels = LABELS

    def __init__(self):
        self.handed = 0

    def log_likelihood(self, touches):
        self.handed += len(touches)
        return np.sum([touch.logits for touch in touches], axis=0)


def fold(model, touches):
    evidence = start(model)
    for touch in touches:
        evidence = evidence.update(touch)
    return evidence


def test_every_kind_of_model_in_the_registry_is_tried():
    assert {model_named(name).name for name in MODELS} == set(fits())


def test_touch_by_touch_is_as_all_at_once(any_model, rng):
    touches = any_model.sample(0, [0, 1, 0, 0, 1, 0, 1, 1, 0, 0, 0], rng)
    evidence = start(any_model)
    for number, touch in enumerate(touches):
        assert evidence.num_touches == number
        np.testing.assert_allclose(
            evidence.log_likelihood, any_model.log_likelihood(touches[:number]), rtol=1e-9, atol=1e-9
        )
        evidence = evidence.update(touch)
    assert not evidence.log_likelihood.flags.writeable


def test_very_many_touches_add_up_to_the_same(any_model, rng):
    touches = any_model.sample(1, rng.integers(2, size=150), rng)
    found = any_model.log_likelihood(touches)
    np.testing.assert_allclose(fold(any_model, touches).log_likelihood, found, rtol=1e-9, atol=1e-9)


def test_an_update_leaves_the_evidence_before_it_as_it_was(any_model, rng):
    before = fold(any_model, any_model.sample(0, [0, 1, 0], rng))
    told = before.log_likelihood.copy()
    for touch in any_model.sample(2, [1, 0, 0], rng):
        before.update(touch)
    again = fold(any_model, [])
    assert before.log_likelihood.tolist() == told.tolist()
    assert again.log_likelihood.tolist() == [0.0] * 3


def numbers_held(part):
    if isinstance(part, np.ndarray):
        return part.size
    return sum(map(numbers_held, part)) if isinstance(part, tuple) else 1


def test_evidence_of_a_hundred_touches_is_as_large_as_that_of_ten(summarising_model, rng):
    assert isinstance(summarising_model, Summarises)
    few, many = (fold(summarising_model, summarising_model.sample(0, [0, 1] * n, rng)) for n in (5, 50))
    assert isinstance(many, SummarisedEvidence)
    assert numbers_held(few.statistics) == numbers_held(many.statistics)


def test_a_touch_hands_the_model_that_touch_only(summarising_model, rng, monkeypatch):
    assert isinstance(summarising_model, Summarises)
    handed = []
    judge = type(summarising_model).require_fit
    monkeypatch.setattr(
        type(summarising_model), "require_fit", lambda self, b: (handed.append(b.poses.size), judge(self, b))[1]
    )
    touches = summarising_model.sample(0, [0, 1] * 20, rng)
    scene = SceneBelief(SearchProblem(LABELS, ("p", "q"), 3), model_with_labels(summarising_model))
    tracker = BeliefTracker(Belief.uniform(summarising_model.shape_labels), summarising_model)
    for touch in touches:
        tracker.update(touch)
        scene.update(1, [touch])
    assert handed == [1] * 80
    assert tracker.touches == scene.touches(1) == tuple(touches)


def model_with_labels(model):
    if tuple(model.shape_labels) != LABELS:
        pytest.skip("of other shapes")
    return model


def test_a_model_with_a_likelihood_alone_is_asked_about_all_touches():
    model = Told()
    touches = [Touch(0, np.array(row)) for row in np.eye(3)]
    evidence = fold(model, touches)
    assert isinstance(evidence, RecomputedEvidence)
    assert evidence.log_likelihood.tolist() == [1.0] * 3
    assert (evidence.num_touches, model.handed) == (3, 3)


def test_a_touch_that_does_not_fit_is_refused(any_model):
    for touch in (Touch(7, np.zeros(3), np.zeros(5)), Touch(0, np.zeros(2), np.zeros(5))):
        with pytest.raises(ValueError, match=r"pose 7|2 logits"):
            assert start(any_model).update(touch).log_likelihood.size
