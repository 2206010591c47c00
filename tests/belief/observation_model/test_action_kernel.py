"""Touches that are correlated between poses: the law of their weights, the evidence, and the fit."""

from dataclasses import replace

import numpy as np
import pytest

from belief import BeliefTracker, SceneBelief, SearchProblem, Touch
from belief.bayes import Belief
from belief.errors import InvalidArgument
from belief.observation_model import check_observation_model, read_observation_model
from belief.observation_model.action_kernel import (
    ActionKernelModel,
    fit_kernel,
    likeness,
    sequence_losses,
    sequences,
    touch_weights,
)
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.repeat_discount import effective_touches

LABELS = ("mug", "ball", "can")


def correlated(rng, num_objects=120, shared=1.0):
    """Touches of objects in three poses; poses 0 and 1 share an error, pose 2 has its own: log likelihood ratios."""
    truth = np.arange(num_objects) % 3
    common = shared * rng.normal(size=(num_objects, 3))
    noise = [common, common, rng.normal(size=(num_objects, 3))]
    own = 0.5 * rng.normal(size=(3, num_objects, 3))
    ratios = np.stack([2.0 * (1.5 * np.eye(3)[truth] + e + o) for e, o in zip(noise, own, strict=True)], axis=1)
    touches = [Touch(pose, row) for thing in ratios for pose, row in enumerate(thing)]
    return touches, truth.repeat(3), np.arange(num_objects).repeat(3)


@pytest.fixture(scope="module")
def model():
    return ActionKernelModel.fit(*correlated(np.random.default_rng(0)), shape_labels=LABELS)


def test_the_weights_of_one_pose_are_the_law_of_repeats():
    kernel = np.full((1, 1), 0.4)
    for number in (1, 2, 6):
        assert number * touch_weights([number], kernel)[0] == pytest.approx(effective_touches(number, 0.4))


def test_it_keeps_the_contract_and_survives_its_file(model, rng):
    check_observation_model(model, rng, num_objects=3)
    again = read_observation_model(model.to_json())
    touches = model.sample(1, [0, 1, 1, 2], rng)
    np.testing.assert_array_equal(again.log_likelihood(touches), model.log_likelihood(touches))


def test_touch_by_touch_is_as_all_at_once(model, rng):
    touches, evidence = model.sample(0, [0, 1, 0, 2, 2, 0], rng), model.start()
    for number, touch in enumerate(touches, start=1):
        evidence = evidence.update(touch)
        np.testing.assert_allclose(evidence.log_likelihood, model.log_likelihood(touches[:number]), atol=1e-12)
    assert evidence.num_touches == 6


def test_poses_with_a_shared_error_are_found_to_be_correlated(model):
    assert model.kernel[0, 1] > 1.5 * model.kernel[0, 2]
    assert model.kernel[0, 1] > 0.3


def test_no_kernel_is_worse_than_none_on_the_touches_of_its_fit(rng):
    touches, shapes, ids = correlated(rng)
    data = LabelledTouches.of(touches, shapes, ids, LABELS)
    found = sequences(data, None, np.random.default_rng(0))

    def loss(kernel):
        return np.nanmean(sequence_losses(data.logits, data.poses, data.shapes, found, kernel))

    assert loss(fit_kernel(data)) <= loss(np.zeros((3, 3))) + 1e-9


def test_a_kernel_predicts_unseen_objects_better_than_independence(rng):
    touches, shapes, ids = correlated(rng)
    new = LabelledTouches.of(*correlated(rng), LABELS)
    found = sequences(new, None, np.random.default_rng(1))
    old = LabelledTouches.of(touches, shapes, ids, LABELS)
    kernels = [fit_kernel(old), np.zeros((3, 3))]
    losses = [np.nanmean(sequence_losses(new.logits, new.poses, new.shapes, found, kernel)) for kernel in kernels]
    assert losses == sorted(losses)


def test_a_repeated_recording_counts_for_nothing(rng):
    model = ActionKernelModel(LABELS, np.full((2, 2), 0.2), np.zeros((2, 1, 3)), repeats=1)
    first, other = Touch(0, rng.normal(size=3)), Touch(1, rng.normal(size=3))
    once = model.log_likelihood([first, other])
    np.testing.assert_allclose(model.log_likelihood([first, other, first, first]), once)
    evidence = model.start()
    for touch in (first, other, first, first):
        evidence = evidence.update(touch)
    np.testing.assert_allclose(evidence.log_likelihood, once)
    assert evidence.outcome_mixture(4, 1).table.probs[:, :, -1].tolist() == [[1.0] * 3] * 2  # nothing new any more


def test_the_information_of_the_next_touch_shrinks_by_its_weight(model):
    single = model.outcome_table(12).information()
    evidence = model.start().update(Touch(0, np.zeros(3)))
    after = evidence.outcome_mixture(12, 1).table.information()
    np.testing.assert_allclose(after, single / (1.0 + model.kernel[0]), rtol=1e-6)


def test_objects_of_known_labels_have_their_logits_only(model, rng):
    few = model.among(["can", "mug"])
    touch = model.sample(0, [0], rng)[0]
    expected = model.log_likelihood([touch])[[2, 0]]
    np.testing.assert_allclose(few.log_likelihood([Touch(0, touch.logits[[2, 0]])]), expected)
    with pytest.raises(ValueError, match="does not know"):
        model.among(["spoon"])


def test_trackers_and_scenes_use_it_unchanged(model, rng):
    touches = model.sample(2, [0, 1, 2, 0], rng)
    tracker = BeliefTracker(Belief.uniform(LABELS), model)
    scene = SceneBelief(SearchProblem(LABELS, ("a", "b", "c"), 1, "independent"), model)
    for touch in touches:
        tracker.update(touch)
    assert scene.update(0, touches).probs == pytest.approx(tracker.belief.probs)


def test_ratios_of_any_size_stay_finite():
    model = ActionKernelModel(("a", "b"), np.zeros((1, 1)), np.zeros((1, 1, 2)))
    touches = [Touch(0, np.array([1.7e308, -1.7e308]))] * 40
    evidence = model.start()
    for touch in touches:
        evidence = evidence.update(touch)
    assert np.isfinite(model.log_likelihood(touches)).all()
    assert np.isfinite(evidence.log_likelihood).all()


def test_a_constant_added_to_the_ratios_of_a_reference_changes_no_table(model, rng):
    moved = replace(model, references=model.references + rng.uniform(-300.0, 300.0, (*model.references.shape[:2], 1)))
    np.testing.assert_allclose(moved.outcome_table().probs, model.outcome_table().probs, atol=1e-9)


def test_objects_touched_in_one_pose_say_nothing_about_the_likeness_of_poses(rng):
    data = [*correlated(rng)]
    single = [Touch(pose, 3.0 * rng.normal(size=3)) for pose in rng.integers(3, size=60)]
    more = [[*data[0], *single], [*data[1], *rng.integers(3, size=60)], [*data[2], *range(1000, 1060)]]
    expected, found = (likeness(LabelledTouches.of(*some, LABELS)) for some in (data, more))
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("repeats", [1, 3])
def test_a_repeat_is_never_less_correlated_than_touches_in_two_poses(repeats, rng):
    """Touches of one session share an error, so that repeats, which are of other sessions, err independently."""
    things, sessions, poses = (a.ravel() for a in np.mgrid[:60, :repeats, :3])
    error = 2.0 * rng.normal(size=(60, 3, 3))
    ratios = 3.0 * np.eye(3)[things % 3] + error[things, sessions] + 0.3 * rng.normal(size=(len(things), 3))
    touches = [Touch(int(pose), row) for pose, row in zip(poses, ratios, strict=True)]
    kernel = ActionKernelModel.fit(touches, things % 3, things, sessions=sessions).kernel
    assert (kernel <= kernel.diagonal()[:, None] + 1e-12).all()
    assert kernel[0, 1] > 0.1


@pytest.mark.parametrize(
    ("kernel", "references", "words"),
    [
        (np.full((2, 2), 1.5), np.zeros((2, 1, 2)), "entries in"),
        (np.array([[0.1, 0.3], [0.2, 0.1]]), np.zeros((2, 1, 2)), "symmetric"),
        (np.array([[0.0, 0.3], [0.3, 0.5]]), np.zeros((2, 1, 2)), r"κ\(0, 0\) = 0 below κ\(0, 1\) = 0.3"),
        (np.zeros((2, 2)), np.zeros((1, 1, 2)), "references must be"),
        (np.zeros((1, 1)), np.full((1, 1, 2), np.nan), "finite"),
    ],
)
def test_what_is_no_model_is_refused(kernel, references, words):
    with pytest.raises(ValueError, match=words):
        ActionKernelModel(("a", "b"), kernel, references)


@pytest.mark.parametrize("setting", [{"repeats": 0}, {"repeats": 1.5}])
def test_a_setting_out_of_range_is_refused(setting):
    with pytest.raises(InvalidArgument, match=next(iter(setting))):
        ActionKernelModel(("a", "b"), np.zeros((1, 1)), np.zeros((1, 1, 2)), **setting)


def test_sessions_may_have_any_labels_but_as_many_as_touches(rng):
    touches, shapes, ids = correlated(rng, num_objects=30)
    days = np.tile([0, 0, 1], 30)
    numbered = ActionKernelModel.fit(touches, shapes, ids, sessions=days).kernel
    for labels in (np.array(["monday", "tuesday"])[days], 0.25 * days):
        np.testing.assert_array_equal(ActionKernelModel.fit(touches, shapes, ids, sessions=labels).kernel, numbered)
    for wrong in (days[1:], np.append(days, 0)):
        with pytest.raises(ValueError, match="need a session for each of 90 touches, got"):
            ActionKernelModel.fit(touches, shapes, ids, sessions=wrong)
