"""What the next touch of one rigid body will show, given those before."""

import numpy as np
import pytest
from scipy.special import log_softmax, softmax

from belief import SceneBelief, SearchProblem, Touch
from belief.bayes import expected_information_gain, target_information_gain
from belief.observation_model import FixedHypotheses, RigidBodyModel
from belief.observation_model.outcome_mixture import OutcomeMixture, information, target_shares
from belief.synthetic import random_model

P, K, N, M, D = 3, 2, 12, 9, 4


def model_of(rng, num_hypotheses=N, sharpness=2.0):
    hypotheses = rng.normal(size=(P, K, num_hypotheses, D)).astype(np.float32)
    references = sharpness * rng.normal(size=(P, M, D))
    return RigidBodyModel(
        tuple("ab"), num_hypotheses, 1.0, references, np.zeros((P, M, K)), hypotheses=FixedHypotheses(hypotheses)
    )


def after(model, touches):
    evidence = model.start()
    for touch in touches:
        evidence = evidence.update(touch)
    return evidence


def some_touches(model, rng, number):
    return [Touch(int(rng.integers(P)), np.zeros(K), 2.0 * rng.normal(size=D)) for _ in range(number)]


def by_hand(model, evidence):
    """p(reference | pose, shape, hypothesis), ``(P, K, N, M)``, and weights ``(K, N)``, with double precision."""
    scores = np.einsum("pkid,pmd->pkim", model.table.astype(float), model.references) / model.temperature
    ratios = scores - np.log(np.exp(scores).sum(axis=(1, 2), keepdims=True))
    return softmax(ratios, axis=3), softmax(evidence.log_weights, axis=1)


def two_touches(mixture):
    """p(outcomes of two touches | shape), ``(K, P, M, P, M)``."""
    return np.stack([mixture.two_touches(pose, np.eye(K)) for pose in range(P)], axis=1)


@pytest.mark.parametrize("number", [0, 1, 4])
def test_with_all_hypotheses_the_table_is_the_sum_over_them(rng, number):
    model = model_of(rng)
    evidence = after(model, some_touches(model, rng, number))
    probs, weights = by_hand(model, evidence)
    mixture = evidence.outcome_mixture(M, N)
    np.testing.assert_allclose(mixture.table.probs, np.einsum("ki,pkim->pkm", weights, probs), atol=1e-6)
    both = two_touches(mixture)
    np.testing.assert_allclose(both, np.einsum("ki,pkim,qkin->kpmqn", weights, probs, probs), atol=1e-6)
    np.testing.assert_allclose(both.sum(axis=4)[:, :, :, 0], mixture.table.probs.swapaxes(0, 1), atol=1e-6)


@pytest.mark.parametrize("new", [None, np.array([1.0, 0.6, 0.0])])
def test_two_touches_are_sums_over_hypotheses_and_linear_in_the_factors(new, rng):
    weights, probs = rng.dirichlet(np.ones(N), K), rng.dirichlet(np.ones(M), (P, K, N))
    mixture, some = OutcomeMixture(weights, probs, new), probs
    if new is not None:  # the last outcome is that a touch tells nothing new
        nothing = np.broadcast_to(1.0 - new[:, None, None, None], (P, K, N, 1))
        some = np.concatenate([probs * new[:, None, None, None], nothing], axis=-1)
    np.testing.assert_allclose(mixture.table.probs, np.einsum("ki,pkim->pkm", weights, some), atol=1e-6)
    belief = rng.dirichlet(np.ones(K))
    gains = information(mixture.one_touch(np.diag(belief))) * (1.0 if new is None else new)
    np.testing.assert_allclose(gains, expected_information_gain(belief, mixture.table.probs), atol=1e-12)
    gains = information(mixture.one_touch(target_shares(belief, 1))) * (1.0 if new is None else new)
    np.testing.assert_allclose(gains, target_information_gain(belief, mixture.table.probs, 1), atol=1e-12)
    both = two_touches(mixture)
    np.testing.assert_allclose(both, np.einsum("ki,pkim,qkin->kpmqn", weights, some, some), atol=1e-6)
    for factors in rng.normal(size=(4, 1, K)):
        expected = np.einsum("jk,kmqn->jmqn", factors, both[:, 1])
        np.testing.assert_allclose(mixture.two_touches(1, factors), expected, atol=1e-6)
        np.testing.assert_allclose(mixture.two_touches(1, -np.abs(factors)), -mixture.two_touches(1, np.abs(factors)))


def test_few_hypotheses_stand_for_many(rng):
    model = model_of(rng, num_hypotheses=2000, sharpness=1.0)
    evidence = after(model, some_touches(model, rng, 2))
    exact, few = (evidence.outcome_mixture(M, number).table.probs for number in (2000, 200))
    np.testing.assert_allclose(few, exact, atol=0.05)
    assert evidence.outcome_mixture(M, 200) is evidence.outcome_mixture(M, 200)


def test_a_hypothesis_is_drawn_as_often_as_its_weight_says(rng):
    model = model_of(rng)
    weights = np.log(np.tile([0.5, 0.25, *[0.25 / (N - 2)] * (N - 2)], (K, 1)))
    evidence = type(model.start())(model, weights, 1)
    mixture = evidence.outcome_mixture(M, 8)
    alone = model.outcomes.of(np.zeros((K, 1), int), M)
    same = (mixture.probs == alone).all(axis=(0, 3))  # (K, H)
    assert (same @ np.ones(8) == 4).all()


def test_outcomes_are_evenly_spaced_references_and_never_more_than_there_are(rng):
    evidence = model_of(rng).start()
    assert evidence.outcome_mixture(4, N).table.num_outcomes == 4
    assert evidence.outcome_mixture(1000, 1000).table.num_outcomes == M
    for wrong in ((0, 1), (1, 0), (1.5, 1)):
        with pytest.raises(ValueError, match=r"num_outcomes|num_hypotheses"):
            evidence.outcome_mixture(*wrong)


def noiseless(num_angles=24):
    """Bodies that show one of a few marks in each pose, and a touch that reads the mark without error."""
    rng = np.random.default_rng(3)
    marks = rng.integers(M, size=(P, K, num_angles))
    hypotheses = 60.0 * np.eye(M, dtype=np.float32)[marks]
    references = np.tile(np.eye(M), (P, 1, 1))
    model = RigidBodyModel(
        tuple("ab"), num_angles, 1.0, references, np.zeros((P, M, K)), hypotheses=FixedHypotheses(hypotheses)
    )
    return model, marks


def test_a_repeat_after_a_noiseless_touch_tells_nothing():
    model, marks = noiseless()
    evidence = after(model, [Touch(1, np.zeros(K), np.eye(M)[marks[1, 0, 0]])])
    belief = np.exp(log_softmax(evidence.log_likelihood))
    gains = expected_information_gain(belief, evidence.outcome_mixture(M, 24).table.probs)
    assert gains[1] == pytest.approx(0.0, abs=1e-6)
    assert gains[[0, 2]].min() > 0.05


def test_a_touch_agrees_with_what_was_foretold(rng):
    """p(first, then second) is p(first) p(second | first), where touches are the references themselves."""
    model = model_of(rng)
    start = model.start()
    first = start.outcome_mixture(M, N)
    both = two_touches(first)
    for reference in range(M):
        later = after(model, [Touch(0, np.zeros(K), model.references[0, reference])])
        # Where p(reference | hypothesis) is normalised over references, its weight is not that of the ratio.
        probs, _ = by_hand(model, start)
        weights = softmax(np.log(probs[0, :, :, reference]), axis=1)
        table = np.einsum("ki,pkim->pkm", weights, probs)
        expected = first.table.probs[0, :, reference, None, None] * table.swapaxes(0, 1)
        np.testing.assert_allclose(both[:, 0, reference], expected, atol=1e-6)
        assert np.isfinite(later.outcome_mixture(M, N).table.probs).all()


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e4, 1e30, 1e300])
@pytest.mark.parametrize("num_hypotheses", [1, N])
def test_extreme_touches_leave_distributions(rng, scale, num_hypotheses):
    model = model_of(rng, num_hypotheses)
    touches = some_touches(model, rng, 2)
    contrary = [Touch(t.pose, t.logits, sign * scale * t.features) for sign in (1.0, -1.0) for t in touches]
    for number in (1, 2, 4):
        evidence = after(model, contrary[:number])
        assert np.isfinite(evidence.log_likelihood).all()
        mixture = evidence.outcome_mixture(M, 5)
        np.testing.assert_allclose(mixture.table.probs.sum(axis=2), 1.0)
        assert np.isfinite(two_touches(mixture)).all()


def test_a_thousand_touches_cost_and_say_what_few_do(rng):
    model = model_of(rng)
    evidence = after(model, some_touches(model, rng, 50) * 20)
    assert evidence.num_touches == 1000
    best = evidence.diagnostics.most_likely
    probs, _ = by_hand(model, evidence)
    expected = probs[:, np.arange(K), best]
    for number in (3, N):
        np.testing.assert_allclose(evidence.outcome_mixture(M, number).table.probs, expected, atol=1e-5)


@pytest.mark.parametrize("temperature", [1e-12, 1e12])
def test_extreme_temperatures_are_answered(rng, temperature):
    model = model_of(rng).at(temperature)
    evidence = after(model, some_touches(model, rng, 3))
    np.testing.assert_allclose(evidence.outcome_mixture(M, 5).table.probs.sum(axis=2), 1.0)


def test_arrays_that_are_no_distributions_are_refused():
    good = np.full((P, K, N, M), 1 / M)
    weights = np.full((K, N), 1 / N)
    OutcomeMixture(weights, good)
    for wrong, words in (
        ((weights[:1], good), "weights"),
        ((weights, good[0]), "probs must be"),
        ((weights, np.full_like(good, np.nan)), "rows? of probs"),
        ((-weights, good), "rows? of weights"),
        ((2 * weights, good), "rows? of weights"),
    ):
        with pytest.raises(ValueError, match=words):
            OutcomeMixture(*wrong)


def test_a_view_keeps_the_evidence_of_its_time_and_independent_touches_have_no_mixture(rng):
    model = random_model(rng, num_shapes=2)
    scene = SceneBelief(SearchProblem(model.shape_labels, ("p", "q", "r"), 2), model)
    view = scene.view()
    scene.update(1, model.sample(0, [0, 1], rng))
    assert [view.evidence(1).num_touches, scene.evidence(1).num_touches, scene.evidence(0).num_touches] == [0, 2, 0]
    assert scene.evidence(1).outcome_mixture(M, N) is None
    with pytest.raises(ValueError, match="object_index"):
        view.evidence(2)
