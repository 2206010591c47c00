"""Strangers in the belief: their likelihood, their next touch, and searches among them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import softmax

from belief import Belief, Counts, SceneBelief, SearchProblem, Touch
from belief.conflict import ConflictTest
from belief.errors import InvalidArgument
from belief.observation_model.outcome_mixture import OutcomeMixture
from benchmarks.stranger_model import StrangerEvidence, StrangerModel


def known_evidence(log_likelihood, log_bets=0.0, num_touches=1, mixture=None):
    return SimpleNamespace(
        num_touches=num_touches,
        log_likelihood=np.asarray(log_likelihood, float),
        log_bets=np.full(12, log_bets),
        outcome_mixture=lambda outcomes, hypotheses: mixture,
    )


class Known:
    """Two shapes; the logits of a touch are log likelihoods, and its first feature is the log bet."""

    shape_labels = ("ball", "cube")

    def start(self):
        return self.of(np.zeros(2), 0.0, 0)

    def of(self, logs, bets, number):
        evidence = known_evidence(logs, bets, number)
        evidence.update = lambda touch: self.of(logs + touch.logits, bets + float(touch.features[0]), number + 1)
        return evidence


def touch(logits, bet):
    return Touch(0, np.array(logits, float), np.array([bet], np.float32))


def test_known_shapes_compare_as_before_and_the_stranger_with_their_mean():
    logs = np.log([0.7, 0.3])
    found = StrangerEvidence(known_evidence(logs, 2.0)).log_likelihood
    assert (found[:2] == logs).all()
    assert found[2] == pytest.approx(np.log(0.5) + 2.0)
    assert not found.flags.writeable
    assert StrangerEvidence(known_evidence([0.0, 0.0], num_touches=0)).log_likelihood.tolist() == [0.0] * 3


@pytest.mark.parametrize("bets", [-1e300, -700.0, 0.0, 700.0, 1e300])
@pytest.mark.parametrize("logs", [[0.0, -np.inf], [-1e300, -1e300], [-np.inf, -np.inf], [-745.0, 0.0]])
def test_extremes_give_a_distribution(logs, bets):
    belief = softmax(StrangerEvidence(known_evidence(logs, bets)).log_likelihood)
    assert np.isfinite(belief).all()
    assert belief.sum() == pytest.approx(1.0)
    if max(logs) == -np.inf:
        assert belief.tolist() == [0.0, 0.0, 1.0]


def test_a_scene_takes_a_strange_object_for_a_stranger_and_nothing_for_a_conflict():
    model = StrangerModel(Known())
    bag = Counts({"ball": 1, "cube": 1, "stranger": 2})
    scene = SceneBelief(SearchProblem(model.shape_labels, ("p",), 3, bag), model)
    assert scene.belief(0).probs == pytest.approx([0.25, 0.25, 0.5])
    assert scene.update(0, [touch([0.0, -3.0], -1.0)]).probs.argmax() == 0
    assert scene.update(1, [touch([0.0, -3.0], 9.0)]).probs[2] > 0.99
    assert scene.log_conflict == 0.0
    rows = model.log_likelihood([touch([0.0, -3.0], 9.0)])
    assert rows == pytest.approx([0.0, -3.0, np.log(0.5 * (1.0 + np.exp(-3.0))) + 9.0])
    assert isinstance(scene.belief(1), Belief)


def test_the_next_touch_of_a_stranger_is_that_of_the_known_shapes_that_are_possible():
    rng = np.random.default_rng(0)
    weights, probs = rng.dirichlet(np.ones(5), size=2), rng.dirichlet(np.ones(4), size=(3, 2, 5))
    logs = np.log([0.8, 0.2])
    outcomes = StrangerEvidence(known_evidence(logs, mixture=OutcomeMixture(weights, probs))).outcome_mixture(4, 5)
    # The same as a mixture of three shapes, the third of which has the hypotheses of both others.
    both = np.concatenate([0.8 * weights[0], 0.2 * weights[1]])
    padded = np.concatenate([weights, np.zeros((2, 5))], axis=1)
    spread = np.concatenate([probs, np.full((3, 2, 5, 4), 0.25)], axis=2)
    whole = OutcomeMixture(
        np.vstack([padded, both]),
        np.concatenate([spread, np.concatenate([probs[:, 0], probs[:, 1]], axis=1)[:, None]], axis=1),
    )
    assert outcomes.table.probs == pytest.approx(whole.table.probs)
    factors = rng.random((2, 3))
    assert outcomes.two_touches(1, factors) == pytest.approx(whole.two_touches(1, factors), rel=1e-4, abs=1e-6)
    assert StrangerEvidence(known_evidence(logs)).outcome_mixture(4, 5) is None
    ruled_out = known_evidence([-np.inf, -np.inf], mixture=OutcomeMixture(weights, probs))
    assert np.isfinite(StrangerEvidence(ruled_out).outcome_mixture(4, 5).table.probs).all()


def test_a_stranger_needs_a_name_of_its_own():
    with pytest.raises(ValueError, match="cube"):
        StrangerModel(Known(), "cube")


def test_touches_and_tables_of_known_shapes_are_those_of_the_known_model(body, rng):
    embeddings, truth = rng.normal(size=(40, 3, 4)), np.arange(40) % 4
    known = replace(body, conflict=ConflictTest.fit(embeddings, np.zeros((40, 3)), truth))
    model = StrangerModel(known)
    for ours, theirs in zip(
        model.sample(3, [0, 2], np.random.default_rng(1)),
        known.sample(3, [0, 2], np.random.default_rng(1)),
        strict=True,
    ):
        np.testing.assert_array_equal(ours.features, theirs.features)
    with pytest.raises(InvalidArgument, match="stranger"):
        model.sample(4, [0], rng)
    with pytest.raises(ValueError, match="5"):
        model.sample(5, [0], rng)
    probs, expected = model.outcome_table().probs, known.outcome_table().probs
    np.testing.assert_array_equal(probs[:, :4], expected)
    np.testing.assert_allclose(probs[:, 4], expected.mean(axis=1))
