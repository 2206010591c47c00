"""Strangers in the belief: their likelihood, their next touch, and searches among them."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import softmax

from belief import Belief, Counts, SceneBelief, SearchProblem, Touch
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
