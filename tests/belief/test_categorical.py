import numpy as np
import pytest

from belief import Belief, BeliefTracker, SceneBelief, SearchProblem, Touch
from belief.bayes import update
from belief.errors import InvalidArgument, UnknownName


def test_a_belief_keeps_its_prior_zeros_for_ever():
    belief = Belief.from_probs(["a", "b", "c"], [0.5, 0.5, 0.0]).update([0.0, 0.0, 1e300])
    assert belief.prob("c") == 0.0


def test_update_leaves_the_old_belief_as_it_was():
    prior = Belief.uniform(["a", "b"])
    prior.update([0.0, -3.0])
    assert prior.probs.tolist() == [0.5, 0.5]
    with pytest.raises(ValueError, match="read-only"):
        prior.log_probs[0] = 0.0


def test_a_belief_is_read_only_however_it_was_made(model):
    labels, given = model.shape_labels, np.log(np.full(4, 0.25))
    tracker = BeliefTracker(Belief.uniform(labels), model)
    tracker.update(Touch(0, np.zeros(4)))
    scene = SceneBelief(SearchProblem(labels, ("p0", "p1", "p2"), 2), model)
    made = [Belief(labels, given), Belief.from_probs(labels, [0.25] * 4), Belief.uniform(labels).update([0.0] * 4)]
    for belief in (*made, tracker.belief, scene.belief(0), scene.update(1, [Touch(0, np.zeros(4))])):
        with pytest.raises(ValueError, match="read-only"):
            belief.log_probs[0] = 0.0
    given[0] = 7.0  # the caller's own


def test_entropy_of_a_uniform_belief_is_log_k():
    assert Belief.uniform(tuple("abcde")).entropy == pytest.approx(np.log(5))


def test_one_shape_is_certain():
    assert Belief.uniform(["a"]).update([-5.0]).probs.tolist() == [1.0]


@pytest.mark.parametrize(
    ("labels", "probs", "message"),
    [
        (["a", "b"], [0.5, 0.6], "do not sum to one"),
        (["a", "b"], [1.5, -0.5], "below zero"),
        (["a", "b"], [np.nan, 1.0], "below zero"),
        (["a", "b"], [1.0], "2 labels need"),
        (["a", "a"], [0.5, 0.5], "differ"),
        ([], [], "at least one"),
        ("ab", [0.5, 0.5], "labels must be a sequence of names"),
        ([0, 1], [0.5, 0.5], "labels must be a sequence of names"),
    ],
)
def test_what_is_no_distribution_is_refused(labels, probs, message):
    with pytest.raises(ValueError, match=message):
        Belief.from_probs(labels, probs)


@pytest.mark.parametrize("labels", ["ab", [0, 1], [], ["a", "a"]])
def test_labels_that_are_none_are_refused(labels):
    for make in (lambda: Belief.uniform(labels), lambda: Belief(labels, np.log([0.5, 0.5]))):
        with pytest.raises(InvalidArgument, match="labels must"):
            make()


def test_an_unknown_label_suggests_the_nearest():
    with pytest.raises(UnknownName, match="Did you mean 'sphere'"):
        Belief.uniform(["sphere", "cube"]).prob("spere")


def test_a_shape_may_be_named_by_its_index():
    belief = Belief.from_probs(["sphere", "cube"], [0.75, 0.25])
    assert belief.prob(1) == belief.prob("cube") == pytest.approx(0.25)
    for index in (2, -1, True, 0.5, None):
        with pytest.raises(InvalidArgument, match="shape must be"):
            belief.prob(index)


@pytest.mark.parametrize("factor", [1.0, 1e-300, 1e300])
def test_a_likelihood_is_its_logarithm(factor):
    belief = Belief.from_probs(("a", "b", "c"), [0.5, 0.25, 0.25])
    likelihood = factor * np.array([0.2, 0.8, 0.0])
    with np.errstate(divide="ignore"):
        logs = np.log(likelihood)
    assert belief.update(likelihood=likelihood).log_probs.tolist() == belief.update(logs).log_probs.tolist()
    assert belief.update(likelihood=likelihood).probs == pytest.approx([1 / 3, 2 / 3, 0.0])
    found, evidence = update(belief.log_probs, likelihood=likelihood)
    assert np.exp(found) == pytest.approx([1 / 3, 2 / 3, 0.0])
    assert evidence == pytest.approx(np.log(0.3) + np.log(factor))


@pytest.mark.parametrize("logs", [[0.2, 0.8], (0.0, 1.0), np.float16([0.3, 0.7]), np.float32([0.1, 0.9])])
def test_what_looks_like_probabilities_is_not_taken_for_logarithms_in_silence(logs):
    with pytest.warns(UserWarning, match=r"pass probabilities as likelihood=") as caught:
        Belief.uniform(("a", "b")).update(logs)
    assert caught[0].filename == __file__


@pytest.mark.parametrize("logs", [[0.0, 0.0], [-0.5, 1.5], [0.2, 0.7], [0.2, 0.800_1], [-np.inf, 1.0], [8.0, 2.0]])
def test_what_cannot_be_probabilities_needs_no_warning(logs):
    Belief.uniform(("a", "b")).update(logs)
    Belief.uniform(("a",)).update([1.0])


@pytest.mark.parametrize("call", [Belief.update, lambda belief, *a, **k: update(belief.log_probs, *a, **k)])
@pytest.mark.parametrize(
    ("given", "named", "message"),
    [
        ((), {}, "either log_likelihood or likelihood=... must be given, got neither"),
        (([0.0, 1.0],), {"likelihood": [0.5, 0.5]}, "got both"),
        ((), {"likelihood": [-0.1, 0.5]}, "likelihood holds NaN, infinity or a negative number"),
        ((), {"likelihood": [np.nan, 0.5]}, "likelihood holds NaN"),
        ((), {"likelihood": [np.inf, 0.5]}, "likelihood holds NaN, infinity"),
        ((), {"likelihood": 0.5}, "axis|shape"),
        ((), {"likelihood": [0.5, 0.25, 0.25]}, "shape|fit"),
        ((), {"likelihood": [0.0, 0.0]}, "zero"),
        ((), {"likelihood": ["a", "b"]}, "real numbers"),
    ],
)
def test_a_likelihood_that_is_none_is_refused(call, given, named, message):
    with pytest.raises(ValueError, match=message):
        call(Belief.uniform(("x", "y")), *given, **named)
