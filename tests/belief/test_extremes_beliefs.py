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
from belief.arrangement import arrangement_marginals, log_arrangement_marginals
from belief.bayes import entropy, expected_information_gain, target_information_gain, update
from belief.validation import normalise_log_probs, normalise_probs

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


@st.composite
def probs_or_worse(draw, *shape):
    """Distributions, some of them with zeros or tiny entries, some of them spoilt."""
    values = draw(arrays(np.float64, shape, elements=st.sampled_from([0.0, 1.0, 0.5, 1e-300, 5e-324])))
    totals = values.sum(axis=-1, keepdims=True)
    values = np.divide(values, totals, out=np.full(shape, 1.0 / shape[-1]), where=totals > 0.1)
    if draw(st.booleans()):
        values[draw(st.tuples(*[st.integers(0, size - 1) for size in shape]))] = draw(st.sampled_from(EXTREMES))
    return values


def logs(values):
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(values)


def answer(call):
    """What a call returns; None if it refuses."""
    try:
        return call()
    except ValueError:
        return None


def assert_log_posterior(log_posterior):
    assert not np.isnan(log_posterior).any()
    np.testing.assert_allclose(np.exp(log_posterior).sum(axis=-1), 1.0, rtol=1e-12)


@given(probs_or_worse(3, 3), extremes(3, 3))
def test_updates_of_logarithms_answer_or_refuse(prior, scores):
    for some_prior, some_scores in ((prior, scores), (prior[0], scores), (prior[0], scores[0]), (prior, scores[0])):
        result = answer(lambda p=some_prior, s=some_scores: update(logs(p), s))
        if result is not None:
            assert_log_posterior(result[0])
            assert np.isfinite(result[1]).all()
            assert np.isneginf(result[0][np.broadcast_to(some_prior == 0.0, result[0].shape)]).all()


@given(probs_or_worse(3, 3), probs_or_worse(2, 3, 4), st.integers(-1, 3))
def test_information_answers_or_refuses(belief, table, target):
    for result, most in (
        (answer(lambda: entropy(belief)), np.log(3)),
        (answer(lambda: expected_information_gain(belief, table)), np.log(3)),
        (answer(lambda: target_information_gain(belief, table, target)), np.log(2)),
    ):
        if result is not None:
            assert ((result >= 0.0) & (result <= most + 1e-12)).all()


@given(extremes(2, 3))
def test_information_about_extremes_answers_or_refuses(values):
    table = np.broadcast_to(values[:, :, None], (2, 3, 2))
    for call in (
        lambda: entropy(values),
        lambda: expected_information_gain(values, table),
        lambda: target_information_gain(values[0], table, 1),
    ):
        result = answer(call)
        assert result is None or np.isfinite(result).all()


@given(extremes(2, 3))
def test_checks_of_rows_answer_or_refuse(values):
    for axis in (0, 1):
        result = answer(lambda axis=axis: normalise_probs(values, axis=axis))
        if result is not None:
            np.testing.assert_allclose(result.sum(axis=axis), 1.0, rtol=1e-12)
    result = answer(lambda: normalise_log_probs(values))
    if result is not None:
        assert_log_posterior(result)


@given(extremes(3, 3), st.sampled_from([None, (1, 1, 1), (3, 0, 2), (1, 2, 0), (2**53, 1, 1), (0, 0, 0)]))
def test_arrangements_answer_or_refuse(weights, counts):
    result = answer(lambda: log_arrangement_marginals(weights, counts))
    if result is not None:
        assert_log_posterior(result)
        bag = np.array((1, 1, 1) if counts is None else counts)
        assert (np.exp(result).sum(axis=0) <= bag * (1.0 + 1e-9) + 1e-9).all()
        assert arrangement_marginals(weights, counts).tolist() == np.exp(result).tolist()


@pytest.mark.filterwarnings("ignore:log_likelihood has no negative number and sums to one")
@given(extremes(3), extremes(3))
def test_beliefs_answer_or_refuse(values, scores):
    for belief in (answer(lambda: Belief.from_probs(LABELS, values)), answer(lambda: Belief(LABELS, values))):
        if belief is not None:
            assert_log_posterior(belief.log_probs)
            assert 0.0 <= belief.entropy <= np.log(3) + 1e-12
            assert str(belief)
            after = answer(lambda belief=belief: belief.update(scores))
            if after is not None:
                assert_log_posterior(after.log_probs)


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
