"""What beliefs do with extremes: each promise by name, and every public function on numbers nobody would choose."""

import math

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
    ZeroPriorTarget,
)
from belief.arrangement import arrangement_marginals, log_arrangement_marginals
from belief.bayes import entropy, expected_information_gain, target_information_gain, update, update_probs
from belief.calibration import TemperatureScaling
from belief.cross_validation import object_folds
from belief.metrics import accuracy, expected_calibration_error
from belief.observation_model import ConfusionModel, OutcomeTable
from belief.out_of_distribution import auroc
from belief.statistics import mcnemar_test, paired_bootstrap, wilson_interval
from belief.touch_batch import TouchBatch
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


# Likelihood zero for every shape still believed in.


def test_impossible_evidence_names_belief_pose_and_touch_and_leaves_the_belief():
    tracker = BeliefTracker(Belief.from_probs(LABELS, [0.5, 0.5, 0.0]), Told())
    tracker.update(felt(0.0, -np.inf, 0.0))
    before = tracker.belief
    with pytest.raises(ImpossibleObservation, match=r"pose 0, Belief\(a 1.000, .*log-likelihood \[-inf, -inf, 3.0\]"):
        tracker.update(felt(-np.inf, 2.0, 3.0))
    assert tracker.belief is before


# Numbers of any size.


@pytest.mark.parametrize("tiny", [1e-300, 5e-324, 2.2e-308])
def test_tiny_likelihoods_tell_as_much_as_their_ratio(tiny):
    expected = [0.5 / 0.75, 0.25 / 0.75] if tiny > 1e-323 else [0.5, 0.5]  # the least float has no half
    likelihood = np.array([tiny, tiny / 2 if tiny > 1e-323 else tiny])
    np.testing.assert_allclose(update_probs([0.5, 0.5], likelihood)[0], expected, rtol=1e-12)
    np.testing.assert_allclose(np.exp(update(np.log([0.5, 0.5]), np.log(likelihood))[0]), expected, rtol=1e-12)


@pytest.mark.parametrize("logit", [1e4, 1e308, np.finfo(float).max])
def test_huge_logits_are_certain_and_their_evidence_finite(logit):
    for scores in ([logit, -logit], [[logit, -logit], [0.0, 0.0]]):
        log_posterior, log_evidence = update(np.log([0.5, 0.5]), scores)
        assert np.exp(log_posterior).ravel()[:2].tolist() == [1.0, 0.0]
        assert np.isfinite(log_evidence).all()
    assert arrangement_marginals([[logit, -logit], [0.0, 0.0]]).tolist() == [[1.0, 0.0], [0.0, 1.0]]


def test_a_prior_and_a_likelihood_both_at_the_edge_of_floats_are_not_impossible():
    log_posterior, log_evidence = update([0.0, -1e308], [-np.inf, -1e308])
    assert log_posterior.tolist() == [-np.inf, 0.0]
    assert log_evidence == -np.finfo(float).max  # -2e308 is no float
    posterior, evidence = update_probs([1.0, 1e-300], [0.0, 1e-300])
    assert posterior.tolist() == [0.0, 1.0]
    assert evidence == 0.0  # 1e-600 is no float


def test_float16_beliefs_are_accepted_and_renormalised():
    third = np.full(3, 1 / 3, np.float16)
    for posterior in (update_probs(third, np.ones(3, np.float16))[0], Belief.from_probs(LABELS, third).probs):
        np.testing.assert_allclose(posterior, 1 / 3, rtol=1e-15)


# A million touches, and contrary evidence after certainty.


def test_a_million_touches_one_by_one_stay_within_a_milli_nat_of_exact_summation(rng):
    steps = rng.normal(size=(1_000_000, 2)) * 3.0 + np.array([0.7, 0.0])
    log_probs = np.log([0.5, 0.5])
    for step in steps:
        log_probs, _ = update(log_probs, step)
    exact = math.fsum(steps[:, 0]) - math.fsum(steps[:, 1])
    assert exact > 1e5  # hundred thousands of nats: float32 would be off by whole nats
    assert abs((log_probs[0] - log_probs[1]) - exact) < 1e-3


def test_a_thousand_touches_of_a_thousand_objects_keep_their_evidence(rng):
    log_probs, log_evidence = np.log(np.full((1000, 2), 0.5)), np.zeros(1000)
    steps = np.log(rng.dirichlet([3.0, 2.0], size=(1000, 1000)))
    for step in steps:
        log_probs, evidence = update(log_probs, step)
        log_evidence += evidence
    for row in (0, 999):
        exact = [math.fsum(steps[:, row, k]) for k in range(2)]
        assert abs(np.diff(log_probs[row])[0] - (exact[1] - exact[0])) < 1e-9
        assert abs(log_evidence[row] - (np.logaddexp(*exact) + math.log(0.5))) < 1e-9


def test_certainty_is_undone_by_as_many_contrary_touches():
    log_probs = np.log([[0.5, 0.5]])
    for _ in range(2000):
        log_probs, _ = update(log_probs, np.log([[0.9, 0.1]]))
    assert np.exp(log_probs).tolist() == [[1.0, 0.0]]  # far below the least float, yet not forgotten
    for _ in range(2001):
        log_probs, _ = update(log_probs, np.log([[0.1, 0.9]]))
    np.testing.assert_allclose(np.exp(log_probs), [[0.1, 0.9]], rtol=1e-9)


def test_certainty_about_a_scene_is_undone_too():
    scene = SceneBelief(SearchProblem(LABELS, ("p",), 3), Told())
    scene.update(0, [felt(5000.0, 0.0, 0.0)])
    assert scene.belief(1).prob("a") == 0.0
    assert np.isfinite(scene.log_marginals()).all()
    scene.update(0, [felt(-5000.0, 0.0, 0.0)])
    np.testing.assert_allclose(scene.marginals(), 1 / 3, rtol=1e-12)


# Zeros of the prior.


def test_a_prior_of_zero_stays_zero_for_ever():
    single = BeliefTracker(Belief.from_probs(LABELS, [0.5, 0.5, 0.0]), Told())
    plain = np.array([0.5, 0.5, 0.0])
    for scores in ([0.0, 0.0, 1e308], [-700.0, -700.0, 700.0], [-1e300, -1e300, 0.0]):
        single.update(felt(*scores))
        plain, _ = update_probs(plain, [1e-300, 1e-300, 1.0])
    assert single.belief.probs.tolist() == plain.tolist() == [0.5, 0.5, 0.0]


def test_a_target_the_prior_rules_out_warns():
    with pytest.warns(ZeroPriorTarget):
        SceneBelief(SearchProblem(LABELS, ("p",), 2, Counts({"a": 1, "b": 1})), Told(), target=2)


# Numbers of objects.


def test_one_object_alone_has_its_own_posterior():
    scene = SceneBelief(SearchProblem(LABELS, ("p",), 1), Told())
    scene.update(0, [felt(*np.log([0.7, 0.2, 0.1]))])
    np.testing.assert_allclose(scene.marginals(), [[0.7, 0.2, 0.1]], rtol=1e-14)


def test_more_than_twenty_distinct_objects_are_refused_before_the_search_with_limit_and_reason():
    labels = tuple(f"shape_{k}" for k in range(21))

    class Model(Told):
        shape_labels = labels

    with pytest.raises(ValueError, match=r"21 objects .* more than 1048576 multisets"):
        SceneBelief(SearchProblem(labels, ("p",), 21), Model())
    few = SceneBelief(SearchProblem(labels, ("p",), 3), Model())
    np.testing.assert_allclose(few.marginals(), 1 / 21)
    assert SceneBelief(SearchProblem(labels, ("p",), 21, "independent"), Model()).marginals().shape == (21, 21)


def test_an_absent_target_is_an_answer():
    scene = SceneBelief(SearchProblem(LABELS, ("p",), 2), Told())
    scene.update(0, [felt(0.0, 0.0, -np.inf)])
    scene.update(1, [felt(0.0, 0.0, -np.inf)])
    assert scene.prob_present(2) == 0.0
    assert scene.prob_present(0) == 1.0


def test_twelve_distinct_objects_are_exact(rng):
    # The sum over 12! arrangements is a permanent, here by Ryser's formula.
    weights = rng.dirichlet(np.ones(12), size=12)
    subsets = (np.arange(1 << 12)[:, None] >> np.arange(12)) & 1
    signs = 1.0 - 2.0 * (subsets.sum(axis=1) % 2)

    def permanent(matrix):
        size = matrix.shape[1]
        chosen = subsets[: 1 << size, :size]
        return (-1.0) ** size * (signs[: 1 << size] * (chosen @ matrix.T).prod(axis=1)).sum()

    marginals = arrangement_marginals(np.log(weights))
    for i, k in ((0, 0), (5, 11), (11, 3)):
        rest = np.delete(np.delete(weights, i, axis=0), k, axis=1)
        assert marginals[i, k] == pytest.approx(weights[i, k] * permanent(rest) / permanent(weights), rel=1e-9)


# Nothing at all.


@pytest.mark.parametrize(
    "call",
    [
        lambda: update([], []),
        lambda: update(np.zeros((0, 3)), np.zeros((1, 0))),
        lambda: update_probs([], []),
        lambda: entropy([]),
        lambda: expected_information_gain([], np.zeros((1, 0, 2))),
        lambda: target_information_gain([], np.zeros((1, 0, 2)), 0),
        lambda: normalise_probs([]),
        lambda: Belief.from_probs((), []),
        lambda: arrangement_marginals(np.zeros((0, 3))),
        lambda: log_arrangement_marginals([[]]),
        lambda: SearchProblem((), (), 1),
        lambda: OutcomeTable([]),
        lambda: TouchBatch.of([]),
        lambda: ConfusionModel.fit([], []),
        lambda: object_folds([], [], 2),
        lambda: TemperatureScaling().fit(np.zeros((0, 3)), []),
        lambda: accuracy(np.zeros((0, 3)), []),
        lambda: expected_calibration_error(np.zeros((0, 3)), []),
        lambda: auroc([], [1.0]),
        lambda: wilson_interval(0, 0),
        lambda: paired_bootstrap([], [], np.random.default_rng(0)),
        lambda: mcnemar_test([], []),
    ],
)
def test_nothing_at_all_is_refused(call):
    with pytest.raises(ValueError, match=r"\w"):
        call()


# Every public function on numbers nobody would choose: an error, or an answer that can be right.

EXTREMES = (0.0, -0.0, 1.0, 0.5, 0.25, 1e-3, np.inf, -np.inf, np.nan, 5e-324, 1e-310, 1e-300, 1e308, -1e308, -1.0, 6e4)
LARGEST = np.finfo(float).max


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


@given(extremes(2, 3), extremes(2, 3))
def test_updates_of_whatever_is_called_a_prior_answer_or_refuse(prior, scores):
    result = answer(lambda: update(prior, scores))
    if result is not None:
        assert_log_posterior(result[0])
    result = answer(lambda: update_probs(prior, scores))
    if result is not None:
        np.testing.assert_allclose(result[0].sum(axis=-1), 1.0, rtol=1e-12)


@given(probs_or_worse(3, 3), extremes(3, 3))
def test_updates_of_probabilities_answer_or_refuse(prior, likelihood):
    for some_prior, some in ((prior, likelihood), (prior[0], likelihood), (prior[0], likelihood[0])):
        result = answer(lambda p=some_prior, s=some: update_probs(p, s))
        if result is not None:
            np.testing.assert_allclose(result[0].sum(axis=-1), 1.0, rtol=1e-12)
            assert (result[0] >= 0.0).all()
            assert ((result[1] >= 0.0) & (result[1] <= LARGEST)).all()


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


@given(st.lists(extremes(3, dtypes=(np.float64,)), min_size=1, max_size=3))
def test_trackers_answer_or_refuse_and_then_are_unchanged(rounds):
    tracker = BeliefTracker(Belief.from_probs(LABELS, [0.5, 0.5, 0.0]), Told())
    for scores in rounds:
        before = tracker.belief
        if answer(lambda scores=scores: tracker.update(Touch(0, scores))) is None:
            assert tracker.belief is before
        assert_log_posterior(tracker.belief.log_probs)
        assert np.isfinite(tracker.log_evidence)


@given(
    st.sampled_from(["distinct", "independent", Counts({"a": 2, "b": 1}), Counts({"a": 2**53, "c": 1})]),
    st.lists(st.tuples(st.integers(0, 2), extremes(3, dtypes=(np.float64,))), min_size=1, max_size=4),
    st.tuples(st.integers(0, 2), st.integers(0, 2)),
)
def test_scenes_answer_or_refuse_and_then_are_unchanged(composition, rounds, told):
    scene = SceneBelief(SearchProblem(LABELS, ("p",), 3, composition), Told())
    calls = [lambda i=i, scores=scores: scene.update(i, [Touch(0, scores)]) for i, scores in rounds]
    calls.insert(1, lambda: scene.known(*told) or True)
    for call in calls:
        before = scene.log_marginals()
        if answer(call) is None:
            assert scene.log_marginals().tolist() == before.tolist()
        assert_log_posterior(scene.log_marginals())
        assert all(0.0 <= scene.prob_present(target) <= 1.0 for target in range(3))
        assert scene.state.num_states >= 1


@pytest.mark.parametrize("value", ["text", None, 1j, [[0.5], [0.5, 0.5]], object()])
def test_what_are_no_numbers_is_refused(value):
    for call in (
        lambda: update(value, [0.0, 0.0]),
        lambda: update(np.log([0.5, 0.5]), value),
        lambda: update_probs(value, [0.0, 0.0]),
        lambda: entropy(value),
        lambda: Belief.from_probs(LABELS, value),
        lambda: Belief(LABELS, value),
        lambda: arrangement_marginals(value),
    ):
        with pytest.raises(ValueError, match=r"must|inhomogeneous"):  # and without a warning
            call()
