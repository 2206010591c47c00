"""Beliefs and Bayes' rule on random extreme numbers: an answer that can be right, or an error that changes nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from belief import (
    Belief,
    BeliefTracker,
    Counts,
    ImpossibleObservation,
    SceneBelief,
    SearchProblem,
    Touch,
)
from belief.arrangement import arrangement_marginals
from belief.bayes import entropy, update

LABELS = ("a", "b", "c")


class Told:
    """An observation model that is told log-likelihoods: a touch's logits; touches are independent."""

    shape_labels = LABELS

    def log_likelihood(self, touches):
        with np.errstate(over="ignore", invalid="ignore"):
            return np.sum([touch.logits for touch in touches], axis=0) if touches else np.zeros(3)


def felt(*scores):
    return Touch(0, np.array(scores, np.float64))


def test_impossible_evidence_names_belief_pose_and_touch_and_leaves_the_belief():
    tracker = BeliefTracker(Belief.from_probs(LABELS, [0.5, 0.5, 0.0]), Told())
    tracker.update(felt(0.0, -np.inf, 0.0))
    before = tracker.belief
    with pytest.raises(ImpossibleObservation, match=r"pose 0, Belief\(a 1.000, .*log-likelihood \[-inf, -inf, 3.0\]"):
        tracker.update(felt(-np.inf, 2.0, 3.0))
    assert tracker.belief is before


def test_certainty_about_a_scene_is_undone_too():
    scene = SceneBelief(SearchProblem(LABELS, ("p",), 3), Told())
    scene.update(0, [felt(5000.0, 0.0, 0.0)])
    assert scene.belief(1).prob("a") == 0.0
    assert np.isfinite(scene.log_marginals()).all()
    scene.update(0, [felt(-5000.0, 0.0, 0.0)])
    np.testing.assert_allclose(scene.marginals(), 1 / 3, rtol=1e-12)


# Every public function on numbers nobody would choose: an error, or an answer that can be right.

EXTREMES = (0.0, -0.0, 1.0, 0.5, 0.25, 1e-3, np.inf, -np.inf, np.nan, 5e-324, 1e-310, 1e-300, 1e308, -1e308, -1.0, 6e4)


@st.composite
def extremes(draw, *shape, dtypes=(np.float64, np.float32, np.float16)):
    values = draw(arrays(np.float64, shape, elements=st.sampled_from(EXTREMES)))
    with np.errstate(over="ignore"):
        return values.astype(draw(st.sampled_from(dtypes)))


def answer(call):
    """What a call returns; None if it refuses."""
    try:
        return call()
    except ValueError:
        return None


def assert_log_posterior(log_posterior):
    assert not np.isnan(log_posterior).any()
    np.testing.assert_allclose(np.exp(log_posterior).sum(axis=-1), 1.0, rtol=1e-12)


@pytest.mark.filterwarnings("ignore:logits has no negative number")
@given(st.lists(extremes(3, dtypes=(np.float64,)), min_size=1, max_size=3))
def test_trackers_answer_or_refuse_and_then_are_unchanged(rounds):
    tracker = BeliefTracker(Belief.from_probs(LABELS, [0.5, 0.5, 0.0]), Told())
    for scores in rounds:
        before = tracker.belief
        if answer(lambda scores=scores: tracker.update(Touch(0, scores))) is None:
            assert tracker.belief is before
        assert_log_posterior(tracker.belief.log_probs)
        assert np.isfinite(tracker.log_evidence)


@pytest.mark.filterwarnings("ignore:logits has no negative number")
@given(
    st.sampled_from(["distinct", "independent", Counts({"a": 2, "b": 1}), Counts({"a": 2**53, "c": 1})]),
    st.lists(st.tuples(st.integers(0, 2), extremes(3, dtypes=(np.float64,))), min_size=1, max_size=4),
)
def test_scenes_answer_or_refuse_and_then_are_unchanged(composition, rounds):
    scene = SceneBelief(SearchProblem(LABELS, ("p",), 3, composition), Told())
    calls = [lambda i=i, scores=scores: scene.update(i, [Touch(0, scores)]) for i, scores in rounds]
    for call in calls:
        before = scene.log_marginals()
        if answer(call) is None:
            assert scene.log_marginals().tolist() == before.tolist()
        assert_log_posterior(scene.log_marginals())
        assert all(0.0 <= scene.prob_present(target) <= 1.0 for target in range(3))


@pytest.mark.parametrize("value", ["text", None, 1j, [[0.5], [0.5, 0.5]], object()])
def test_what_are_no_numbers_is_refused(value):
    for call in (
        lambda: update(value, [0.0, 0.0]),
        lambda: update(np.log([0.5, 0.5]), value),
        lambda: entropy(value),
        lambda: Belief.from_probs(LABELS, value),
        lambda: Belief(LABELS, value),
        lambda: arrangement_marginals(value),
    ):
        with pytest.raises(ValueError, match=r"must|inhomogeneous"):  # and without a warning
            call()
