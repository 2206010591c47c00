"""Many objects at once against one at a time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from belief import (
    BatchedBeliefTracker,
    Belief,
    BeliefTracker,
    FloorLikelihood,
    IgnoreImpossible,
    ImpossibleObservation,
    RaiseImpossible,
    Touch,
    ZeroPriorTarget,
)

LABELS = ("a", "b", "c")


class Told:
    """An observation model that is told log-likelihoods: a touch's logits; touches are independent."""

    shape_labels = LABELS

    def log_likelihood(self, touches):
        return np.sum([touch.logits for touch in touches], axis=0) if touches else np.zeros(3)


@st.composite
def histories(draw):
    """Priors ``(B, K)`` with some zeros, and rounds of touches of some of the rows."""
    weights = draw(arrays(np.float64, (4, 3), elements=st.one_of(st.floats(0.01, 1.0), st.just(0.0))))
    weights[:, draw(st.integers(0, 2))] += 0.5
    some_rows = st.lists(st.integers(0, 3), min_size=1, max_size=4, unique=True)
    scores = arrays(np.float64, (4, 3), elements=st.floats(-30, 30))
    rounds = draw(st.lists(st.tuples(some_rows, scores), max_size=5))
    return weights / weights.sum(axis=1, keepdims=True), [(rows, scores[: len(rows)]) for rows, scores in rounds]


@given(histories())
def test_a_batch_is_as_many_single_trackers(history):
    priors, rounds = history
    batch = BatchedBeliefTracker(priors)
    single = [BeliefTracker(Belief.from_probs(LABELS, prior), Told()) for prior in priors]
    for rows, scores in rounds:
        posterior = batch.update(scores, rows)
        for i, row in enumerate(rows):
            expected = single[row].update(Touch(0, scores[i])).log_probs
            np.testing.assert_allclose(posterior[i], expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(batch.log_probs, [tracker.belief.log_probs for tracker in single], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(batch.log_evidence, [t.log_evidence for t in single], rtol=1e-9, atol=1e-9)
    assert (batch.probs[priors == 0.0] == 0.0).all()


@given(histories(), st.randoms(use_true_random=False))
def test_order_of_rounds_does_not_matter(history, random):
    priors, rounds = history
    shuffled = rounds.copy()
    random.shuffle(shuffled)
    trackers = [BatchedBeliefTracker(priors) for _ in range(2)]
    for tracker, some in zip(trackers, (rounds, shuffled), strict=True):
        for rows, scores in some:
            tracker.update(scores, rows)
    np.testing.assert_allclose(trackers[0].log_probs, trackers[1].log_probs, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(trackers[0].log_evidence, trackers[1].log_evidence, rtol=1e-9, atol=1e-9)


def test_rows_may_be_a_mask_and_the_others_stay_as_they_are():
    tracker = BatchedBeliefTracker(np.full((3, 2), 0.5))
    tracker.update([[0.0, -1.0]], rows=[False, True, False])
    by_index = BatchedBeliefTracker(np.full((3, 2), 0.5))
    by_index.update([[0.0, -1.0]], rows=1)
    assert tracker.log_probs.tolist() == by_index.log_probs.tolist()
    assert tracker.probs[[0, 2]].tolist() == [[0.5, 0.5]] * 2
    assert tracker.log_evidence[[0, 2]].tolist() == [0.0, 0.0]


def test_what_a_tracker_gave_does_not_change_later():
    tracker = BatchedBeliefTracker([[0.5, 0.5]])
    log_probs, posterior = tracker.log_probs, tracker.update([[0.0, -1.0]])
    kept = posterior.copy()
    tracker.update([[0.0, -1.0]])
    assert np.exp(log_probs).tolist() == [[0.5, 0.5]]
    assert posterior.tolist() == kept.tolist()


PRIORS, IMPOSSIBLE = [[1.0, 0.0], [0.5, 0.5], [0.2, 0.8]], [[-np.inf, 0.0], [0.0, -1.0], [-np.inf, -np.inf]]


def test_an_impossible_row_raises_by_default_and_leaves_every_row_as_it_was():
    for tracker in (BatchedBeliefTracker(PRIORS), BatchedBeliefTracker(PRIORS, on_impossible=RaiseImpossible())):
        with pytest.raises(ImpossibleObservation, match="in row 0"):
            tracker.update(IMPOSSIBLE)
        assert tracker.probs.tolist() == PRIORS
        assert tracker.log_evidence.tolist() == [0.0, 0.0, 0.0]


def test_ignoring_the_impossible_takes_in_the_rest():
    tracker = BatchedBeliefTracker(PRIORS, on_impossible=IgnoreImpossible())
    tracker.update(IMPOSSIBLE)
    assert tracker.probs[[0, 2]].tolist() == [PRIORS[0], PRIORS[2]]
    assert tracker.probs[1] == pytest.approx([1 / (1 + np.exp(-1)), 1 / (1 + np.e)])
    assert tracker.log_evidence.tolist() == [0.0, tracker.log_evidence[1], 0.0]
    with pytest.raises(ValueError, match="in row 1 holds NaN"):
        tracker.update([[-np.inf, -np.inf], [np.nan, np.nan], [0.0, 0.0]])
    tracker.update([[-np.inf, -np.inf]], rows=[2])
    assert tracker.probs[2].tolist() == PRIORS[2]


def test_a_floor_never_lets_a_touch_rule_a_shape_out_but_a_prior_may():
    tracker = BatchedBeliefTracker(PRIORS, on_impossible=FloorLikelihood(-10.0))
    tracker.update(IMPOSSIBLE)
    assert tracker.probs[0].tolist() == [1.0, 0.0]
    assert tracker.log_evidence[0] == pytest.approx(-10.0)
    assert tracker.probs[2] == pytest.approx(PRIORS[2])
    tracker.update([[-np.inf, 0.0]], rows=[1])
    assert tracker.probs[1] == pytest.approx([np.exp(-9) / (1 + np.exp(-9)), 1 / (1 + np.exp(-9))])


@pytest.mark.parametrize("floor", [0.0, 1.0, -np.inf, np.nan])
def test_a_floor_that_is_none_is_refused(floor):
    with pytest.raises(ValueError, match="finite and negative"):
        FloorLikelihood(floor)


def test_single_trackers_follow_the_same_policies():
    prior, no = Belief.from_probs(LABELS, [1.0, 0.0, 0.0]), Touch(2, np.array([-np.inf, 0.0, 0.0]))
    with pytest.raises(ImpossibleObservation, match=r"touch in pose 2, Belief\(a 1.000"):
        BeliefTracker(prior, Told()).update(no)
    ignoring = BeliefTracker(prior, Told(), on_impossible=IgnoreImpossible())
    assert ignoring.update(no) is prior
    assert (ignoring.touches, ignoring.log_evidence) == ((), 0.0)
    floored = BeliefTracker(prior, Told(), on_impossible=FloorLikelihood(-10.0))
    assert floored.update(no).probs.tolist() == [1.0, 0.0, 0.0]
    assert floored.log_evidence == pytest.approx(-10.0)
    assert floored.touches == (no,)


def test_a_target_of_prior_zero_warns_once_and_names_the_row():
    with pytest.warns(
        ZeroPriorTarget, match="target 1 has probability zero in the prior of 1 of 3 rows, the first row 0"
    ):
        tracker = BatchedBeliefTracker(PRIORS, target=1)
    tracker.update(np.zeros((3, 2)))
    BatchedBeliefTracker(PRIORS, target=[0, 1, 1])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: BatchedBeliefTracker([0.5, 0.5]), "must be"),
        (lambda: BatchedBeliefTracker(np.zeros((0, 2))), "none of them empty"),
        (lambda: BatchedBeliefTracker([[0.5, 0.5], [0.7, 0.7]]), "row 1 holds probabilities that do not sum to one"),
        (lambda: BatchedBeliefTracker([[1.5, -0.5]]), "below zero"),
        (lambda: BatchedBeliefTracker(PRIORS, target=2), "target must be integers"),
        (lambda: BatchedBeliefTracker(PRIORS, target=0.5), "target must be integers"),
        (lambda: BatchedBeliefTracker(PRIORS).update(np.zeros((3, 3))), "log_likelihood must be"),
        (lambda: BatchedBeliefTracker(PRIORS).update(np.zeros(2)), "log_likelihood must be"),
        (lambda: BatchedBeliefTracker(PRIORS).update(np.zeros((2, 2)), rows=[0, 0]), "different"),
        (lambda: BatchedBeliefTracker(PRIORS).update(np.zeros((2, 2)), rows=[2, -1]), "different"),
        (lambda: BatchedBeliefTracker(PRIORS).update(np.zeros((1, 2)), rows=[3]), "indices below 3"),
        (lambda: BatchedBeliefTracker(PRIORS).update(np.zeros((1, 2)), rows=[0.5]), "indices below 3"),
        (
            lambda: BatchedBeliefTracker(PRIORS).update(np.zeros((0, 2)), rows=[False] * 3),
            "nothing to update|non-empty",
        ),
    ],
)
def test_what_does_not_fit_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
