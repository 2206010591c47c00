"""Splits, the reader and the world of recorded touches, on touches that are drawn here."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import softmax

from activetouch.errors import BadRecording
from activetouch.recorded import RecordedBank, RecordedTouches, RecordedWorld, check_recorded, without_incomplete
from activetouch.recorded.discriminants import LinearDiscriminants
from activetouch.recorded.reader import _cross_calibrated, read
from activetouch.recorded.splits import by_object, by_session
from belief.calibration import StructuredMatrixScaling, TemperatureScaling
from belief.errors import InvalidArgument
from belief.observation_model.action_kernel import touch_weights
from belief.observation_model.kernel_fit import fit_kernel


def drawn(rng, num_objects=6, sessions=5, actions=2, features=6):
    """Objects of two categories that differ in the mean of their features."""
    means = 2.0 * rng.normal(size=(num_objects, actions, features))
    things, numbers, used = (a.ravel() for a in np.mgrid[:num_objects, :sessions, :actions])
    rows = means[things, used] + rng.normal(size=(len(things), features))
    rows[:, 0] += 8.0 * (things % 2)
    names = tuple(f"thing_{i}" for i in range(num_objects))
    categories = tuple("even" if i % 2 == 0 else "odd" for i in range(num_objects))
    actions_named = tuple(f"action_{i}" for i in range(actions))
    return RecordedTouches(rows, used, things, numbers, actions_named, names, {"categories": categories})


def test_a_split_by_time_tests_on_the_last_sessions(rng):
    touches = drawn(rng).for_task("objects")
    split = by_session(touches)
    assert set(touches.sessions[split.train]) == {0, 1, 2}
    assert set(touches.sessions[split.calibration]) == {3}
    assert set(touches.sessions[split.test]) == {4}
    assert len(np.unique(np.concatenate([split.train, split.calibration, split.test]))) == len(touches.rows)


def test_a_split_by_object_shares_no_object_and_tests_each_once(rng):
    touches = drawn(rng).for_task("categories")
    tested = []
    for split in by_object(touches, 3):
        known, new = touches.objects[split.train], touches.objects[split.test]
        assert not set(known) & set(new)
        tested += sorted(set(new))
        for fold in np.unique(split.inner):  # an object is in one inner fold
            assert not set(known[split.inner == fold]) & set(known[split.inner != fold])
    assert sorted(tested) == list(range(6))


def with_few(rng, num_objects, few, many):
    """Objects that are hard to tell apart, of which the first half has fewer sessions."""
    whole = drawn(rng, num_objects, many, actions=3)
    kept = (whole.sessions < few) | (whole.objects >= num_objects // 2)
    rows = 0.3 * whole.features[kept] + rng.normal(size=(kept.sum(), 6))
    columns = (column[kept] for column in (whole.actions, whole.objects, whole.sessions))
    return RecordedTouches(rows, *columns, whole.action_names, whole.object_names)


@pytest.mark.parametrize("sessions", range(4, 12))
def test_every_object_is_learned_calibrated_on_and_tested_on(sessions, rng):
    touches = with_few(rng, 4, 4, sessions).for_task("objects")
    split = by_session(touches)
    for rows in (split.train, split.calibration, split.test):
        assert len(np.unique(np.stack([touches.objects[rows], touches.actions[rows]]), axis=1).T) == 4 * 3


@pytest.mark.parametrize("task", ["objects", "categories"])
def test_the_reader_reads_and_states_what_it_reads(task, rng):
    touches = drawn(rng, sessions=15).for_task(task)
    split = by_session(touches) if task == "objects" else by_object(touches, 3)[0]
    reading = read(touches, split)
    labels = touches.labels[split.test]
    right = (reading.test_ratios.argmax(axis=1) == labels).mean()
    assert right > 0.7
    probs = np.exp(reading.test_ratios + reading.reader.log_prior)
    np.testing.assert_allclose(probs.sum(axis=1), 1.0)
    assert abs(probs.max(axis=1).mean() - right) < (0.15 if task == "objects" else 0.3)  # there are two new objects


def of_differing_objects(rng, num_labels=6, num_objects=6, num_touches=10, num_features=10):
    """Touches of categories whose objects differ more than their touches."""
    labels, things, sessions = (a.ravel() for a in np.mgrid[:num_labels, :num_objects, :num_touches])
    means = rng.normal(size=(num_labels, num_features))
    offsets = 1.5 * rng.normal(size=(num_labels, num_objects, num_features))
    rows = means[labels] + offsets[labels, things] + 1.5 * rng.normal(size=(len(labels), num_features))
    names = tuple(f"thing_{i}" for i in range(num_labels * num_objects))
    categories = tuple(f"category_{i // num_objects}" for i in range(len(names)))
    owners = labels * num_objects + things
    return RecordedTouches(rows, 0 * labels, owners, sessions, ("press",), names, {"categories": categories})


def test_fused_touches_of_unseen_objects_state_what_is_right():
    """The mean gap of four sets has a standard deviation of 0.033 about -0.05: it fails once in a thousand times."""
    gaps = []
    for seed in range(4):
        touches = of_differing_objects(np.random.default_rng(seed)).for_task("categories")
        for split in by_object(touches, 3):
            reading, rows = read(touches, split), split.test
            seen = touches.labelled(reading.calibration_rows, reading.calibration_ratios)
            weight = touch_weights([10], fit_kernel(seen, "kernel"))[0]
            for thing in np.unique(touches.objects[rows]):
                own = touches.objects[rows] == thing
                probs = softmax(weight * reading.test_ratios[own].sum(axis=0))
                gaps.append(probs.max() - (probs.argmax() == touches.labels[rows][own][0]))
    assert np.mean(gaps) < 0.06  # 0.10 if correlations are fitted to the touches of the calibration


@pytest.mark.parametrize("kind", [TemperatureScaling(), StructuredMatrixScaling()], ids=lambda kind: kind.name)
@pytest.mark.parametrize("task", ["objects", "categories"])
def test_ratios_that_correlations_are_fitted_to_are_of_calibrations_that_did_not_see_them(kind, task, rng):
    touches = drawn(rng, sessions=12).for_task(task)
    split = by_session(touches) if task == "objects" else by_object(touches, 3)[0]
    rows, held = split.calibrated, split.folds == 0
    assert 0 < held.sum() < len(rows)
    logits = rng.normal(size=(len(rows), len(touches.label_names)))
    logits[np.arange(len(rows)), touches.labels[rows]] += 2.0
    changed = np.array(touches.labels)
    changed[rows[held]] = 0
    before, after = (
        _cross_calibrated(kind, replace(touches, labels=labels), rows, logits, split.folds)
        for labels in (touches.labels, changed)
    )
    np.testing.assert_array_equal(after[held], before[held])
    assert np.abs(after[~held] - before[~held]).max() > 0.0


def test_a_fold_of_calibration_touches_shares_no_session_or_no_object_with_the_others(rng):
    for sessions in (5, 25):
        touches = drawn(rng, sessions=sessions).for_task("objects")
        split = by_session(touches)
        rows = split.calibrated
        units = touches.sessions[rows] if sessions == 25 else touches.objects[rows]
        assert len(np.unique(split.folds)) > 1
        for fold in np.unique(split.folds):
            assert not set(units[split.folds == fold]) & set(units[split.folds != fold])


def test_shuffled_features_are_read_as_chance(rng):
    source = drawn(rng, sessions=15)
    shuffled = RecordedTouches(
        rng.permutation(source.features),
        source.actions,
        source.objects,
        source.sessions,
        source.action_names,
        source.object_names,
    ).for_task("objects")
    split = by_session(shuffled)
    reading = read(shuffled, split)
    assert (reading.test_ratios.argmax(axis=1) == shuffled.labels[split.test]).mean() < 0.4
    assert np.abs(reading.test_ratios).max() < 3.0  # and it says so


def test_discriminants_are_those_of_scikit_learn(rng):
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

    labels = np.arange(60) % 3
    rows = rng.normal(size=(60, 4)) + labels[:, None]
    mine = LinearDiscriminants(0.0).fit(rows, labels).decision_function(rows)
    theirs = LinearDiscriminantAnalysis(solver="lsqr").fit(rows, labels).decision_function(rows)
    np.testing.assert_allclose(mine - mine[:, :1], theirs - theirs[:, :1], atol=1e-5)


def bank(sessions=3):
    things, actions, numbers = (a.ravel() for a in np.mgrid[:2, :2, :sessions])
    ratios = np.stack([100.0 * things + 10.0 * actions + numbers, np.zeros(len(things))], axis=1)
    return RecordedBank(("mug", "can"), ("press", "rub"), ratios, things, things, actions, numbers)


def test_a_world_stays_with_a_session_and_repeats_only_after_the_last(rng):
    world = RecordedWorld(bank(), [1, 0], seed=[4])
    first = [world.touch(action, rng).logits[0] for action in (0, 1)]
    assert first[1] - first[0] == 10.0  # one session
    seen = [first[0], *(world.touch(0, rng).logits[0] for _ in range(3))]
    assert len(set(seen[:3])) == 3
    assert seen[3] == seen[0]
    world.advance()
    assert world.touch(0, rng).logits[0] < 100.0
    with pytest.raises(InvalidArgument, match="no object after the last"):
        world.advance()
    world.reset()
    assert world.touch(0, rng).logits[0] == first[0]


def test_a_set_that_cannot_be_split_is_refused(rng):
    with pytest.raises(BadRecording, match=r"thing_0 \(3 of action_0, 3 of action_1\); thing_1 .*; objects need at"):
        check_recorded(drawn(rng, sessions=3))
    with pytest.raises(BadRecording, match="at least 3 objects of each"):
        check_recorded(drawn(rng, num_objects=4), "categories")
    with pytest.raises(BadRecording, match="no labels for 'shapes'"):
        check_recorded(drawn(rng), "shapes")


@pytest.mark.parametrize("task", ["objects", "categories"])
def test_all_objects_that_lack_an_action_are_named_at_once_and_may_be_left_out(task, rng):
    whole = drawn(rng, num_objects=9)
    kept = ~((whole.objects == 2) & (whole.actions == 1)) & ~((whole.objects == 5) & (whole.actions == 0))
    columns = (column[kept] for column in (whole.features, whole.actions, whole.objects, whole.sessions))
    some = RecordedTouches(*columns, whole.action_names, whole.object_names, whole.labels)
    words = r"2 of 9 objects .*thing_2 \(0 of action_1\); thing_5 \(0 of action_0\); .*--leave-out-incomplete"
    with pytest.raises(BadRecording, match=words):
        check_recorded(some, task)
    rest, notes = without_incomplete(some, task)
    check_recorded(rest, task)
    assert set(rest.objects) == set(range(9)) - {2, 5}
    assert rest.num_touches == 7 * 10
    assert len(notes) == 1
    assert without_incomplete(whole, task) == (whole, ())


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"features": np.full((60, 6), np.nan)}, "features of touch 0 .*thing_0"),
        ({"features": np.full((60, 6), -1e101)}, "hold -1e.101; they must be finite and of a size up to"),
        ({"actions": np.full(60, 2)}, "actions must be in"),
        ({"sessions": np.full(60, 0.5)}, "sessions must be whole numbers, got 0.5"),
        ({"objects": np.full(60, np.nan)}, "objects must be whole numbers, got nan"),
        ({"objects": np.zeros(3, np.int64)}, "objects must be"),
        ({"labels": {"colours": ("red",) * 6}}, "labels must give"),
    ],
)
def test_touches_that_do_not_fit_are_refused(changed, words, rng):
    whole = drawn(rng)
    fields = {name: getattr(whole, name) for name in ("features", "actions", "objects", "sessions", "action_names")}
    with pytest.raises(BadRecording, match=words):
        RecordedTouches(**{**fields, "object_names": whole.object_names, **changed})
