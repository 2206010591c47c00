"""Splits, the reader and the world of recorded touches, on touches that are drawn here."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import softmax

from activetouch.errors import BadRecording
from activetouch.recorded import RecordedBank, RecordedTouches, RecordedWorld, check_recorded, without_incomplete
from activetouch.recorded.discriminants import LinearDiscriminants
from activetouch.recorded.reader import _cross_calibrated, kinds, read
from activetouch.recorded.splits import Split, by_object, by_session
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
    other = by_session(touches, np.random.default_rng(1))
    assert len(set(touches.sessions[other.test])) > 1
    assert len(np.unique(np.concatenate([other.train, other.calibration, other.test]))) == len(touches.rows)


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


def test_objects_with_fewer_sessions_are_not_named_more_often(rng):
    touches = with_few(rng, 40, 4, 20).for_task("objects")
    split = by_session(touches)
    labels, named = touches.labels[split.test], read(touches, split).test_ratios.argmax(axis=1)
    share = np.mean([(named[labels == label] < 20).mean() for label in range(40)])
    assert share < 0.6  # they are half of all


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


def test_many_touches_are_learned_without_support_vectors():
    assert any("support" in name for name in kinds(5, 300))
    assert not any("support" in name for name in kinds(5, 10**6))
    assert not any("support" in name for name in kinds(100, 300))


def test_the_reader_learns_from_calibration_touches_too(rng):
    touches = drawn(rng).for_task("objects")
    split = by_session(touches)
    both = read(touches, split)
    swapped = Split(split.train, np.empty(0, np.int64), split.test, split.inner, split.inner)
    assert np.abs(both.test_ratios - read(touches, swapped).test_ratios).max() > 0.1
    centre = both.reader.classifiers[0].centre
    learned = np.concatenate([split.train, split.calibration])
    own = learned[touches.actions[learned] == 0]
    np.testing.assert_allclose(centre, touches.features()[own].mean(axis=0))


def test_one_object_is_nothing_to_tell_apart(rng):
    with pytest.raises(BadRecording, match=r"at least two different labels, there is \['thing_0'\]"):
        check_recorded(drawn(rng, num_objects=1))


def test_discriminants_are_those_of_scikit_learn(rng):
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

    labels = np.arange(60) % 3
    rows = rng.normal(size=(60, 4)) + labels[:, None]
    mine = LinearDiscriminants(0.0).fit(rows, labels).decision_function(rows)
    theirs = LinearDiscriminantAnalysis(solver="lsqr").fit(rows, labels).decision_function(rows)
    np.testing.assert_allclose(mine - mine[:, :1], theirs - theirs[:, :1], atol=1e-5)


def test_heavy_tails_tell_little_far_away(rng):
    labels = np.repeat([0, 1, 2], [10, 20, 70])
    rows = rng.normal(size=(100, 4)) + labels[:, None]
    normal, heavy = (LinearDiscriminants(0.1, is_heavy).fit(rows, labels) for is_heavy in (False, True))
    centres = np.array([rows[labels == label].mean(axis=0) for label in range(3)])
    np.testing.assert_allclose(heavy.decision_function(centres).diagonal(), 0.0, atol=1e-6)  # however often it is
    squares = -2.0 * normal.decision_function(rows)  # squared distances, from the normal densities
    # Student's kernel has the curvature of the normal one at its centre, and grows with the logarithm far away.
    np.testing.assert_allclose(np.exp(-heavy.decision_function(rows) / 2.0), 1.0 + squares / 4.0, rtol=1e-6)
    far = centres + 1e6
    np.testing.assert_allclose(np.diff(heavy.decision_function(far)), 0.0, atol=1e-3)
    assert np.abs(np.diff(normal.decision_function(far))).min() > 1e3


@pytest.mark.parametrize("is_heavy", [False, True])
def test_discriminants_of_more_features_than_touches_are_those_of_the_whole_space(is_heavy, rng):
    labels, size, shrinkage = np.arange(12) % 3, 40, 0.3
    rows, new = rng.normal(size=(12, size)) + labels[:, None], rng.normal(size=(7, size))
    means = np.array([rows[labels == label].mean(axis=0) for label in range(3)])
    rest = rows - means[labels]
    pooled = rest.T @ rest / len(rest)
    covariance = (1.0 - shrinkage) * pooled + (shrinkage * np.trace(pooled) / size + 1e-9) * np.eye(size)
    gaps = new[:, None] - means
    squares = np.einsum("nkf,fg,nkg->nk", gaps, np.linalg.inv(covariance), gaps)
    expected = -0.5 * size * np.log1p(squares / size) if is_heavy else -0.5 * squares
    found = LinearDiscriminants(shrinkage, is_heavy).fit(rows, labels).decision_function(new)
    np.testing.assert_allclose(np.diff(found), np.diff(expected), rtol=1e-6)


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


def test_the_same_seed_replays_the_same_recordings(rng):
    made = [[RecordedWorld(bank(), [0], seed).touch(0, rng).logits[0] for _ in range(1)] for seed in ([1], [1])]
    assert made[0] == made[1]
    assert RecordedWorld(bank(), [0], 1).touch(0, rng).logits[0] == made[0][0]  # a single number is a key of one
    assert len({RecordedWorld(bank(), [0], [seed]).touch(0, rng).logits[0] for seed in range(20)}) == 3


def test_a_bank_of_some_labels_has_their_logits():
    some = bank().among(["can"])
    assert some.ratios.shape == (6, 1)
    assert set(some.labels) == {0}
    with pytest.raises(BadRecording, match="no held-out touch with the action rub"):
        RecordedBank(("mug",), ("press", "rub"), np.zeros((1, 1)), *np.zeros((4, 1), np.int64))
    with pytest.raises(InvalidArgument, match="has no object 7"):
        RecordedWorld(bank(), [7], [0])


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
    some = RecordedTouches(
        *columns, whole.action_names, whole.object_names, whole.labels, {"untouched": whole.features[kept, :2]}
    )
    words = r"2 of 9 objects .*thing_2 \(0 of action_1\); thing_5 \(0 of action_0\); .*--leave-out-incomplete"
    with pytest.raises(BadRecording, match=words):
        check_recorded(some, task)
    rest, notes = without_incomplete(some, task)
    check_recorded(rest, task)
    assert set(rest.objects) == set(range(9)) - {2, 5}
    assert rest.num_touches == 7 * 10
    assert len(notes) == 1
    assert without_incomplete(whole, task) == (whole, ())


def test_nothing_is_left_out_of_a_set_without_a_complete_object(rng):
    with pytest.raises(BadRecording, match="6 of 6 objects have too few sessions"):
        without_incomplete(drawn(rng, sessions=3))


def test_advice_on_the_number_of_features_comes_before_the_work(rng):
    wide = replace(drawn(rng), features=rng.normal(size=(60, 501)))
    assert "a touch has 501 features" in check_recorded(wide)[0]
    assert not any("average neighbouring" in remark for remark in check_recorded(drawn(rng)))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"features": np.full((60, 6), np.nan)}, "features of touch 0 .*thing_0"),
        ({"features": np.full((60, 6), -1e101)}, "hold -1e.101; they must be finite and of a size up to"),
        ({"actions": np.full(60, 2)}, "actions must be in"),
        ({"sessions": np.full(60, 0.5)}, "sessions must be whole numbers, got 0.5"),
        ({"objects": np.full(60, np.nan)}, "objects must be whole numbers, got nan"),
        ({"objects": np.zeros(3, np.int64)}, "objects must be"),
        ({"controls": {"a": np.zeros((2, 1))}}, "the control 'a' must be .60, C"),
        ({"labels": {"colours": ("red",) * 6}}, "labels must give"),
    ],
)
def test_touches_that_do_not_fit_are_refused(changed, words, rng):
    whole = drawn(rng)
    fields = {name: getattr(whole, name) for name in ("features", "actions", "objects", "sessions", "action_names")}
    with pytest.raises(BadRecording, match=words):
        RecordedTouches(**{**fields, "object_names": whole.object_names, **changed})
