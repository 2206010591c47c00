"""Splits, the reader and the world of recorded touches, on touches that are drawn here."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import softmax

from activetouch.errors import BadRecording
from activetouch.recorded import RecordedBank, RecordedTouches, RecordedWorld, check_recorded
from activetouch.recorded.checking import without_incomplete
from activetouch.recorded.reader import KINDS, LinearDiscriminants, _cross_calibrated, read
from activetouch.recorded.touches import by_session, for_use, splits_of
from belief.calibration import StructuredMatrixScaling, TemperatureScaling
from belief.errors import InvalidArgument


def drawn(rng, num_objects=6, sessions=5, actions=2, features=6):
    """Objects that differ in the mean of their features."""
    means = 2.0 * rng.normal(size=(num_objects, actions, features))
    things, numbers, used = (a.ravel() for a in np.mgrid[:num_objects, :sessions, :actions])
    rows = means[things, used] + rng.normal(size=(len(things), features))
    rows[:, 0] += 8.0 * (things % 2)
    names = tuple(f"thing_{i}" for i in range(num_objects))
    actions_named = tuple(f"action_{i}" for i in range(actions))
    kinds = {"categories": tuple("even" if i % 2 == 0 else "odd" for i in range(num_objects))}
    return RecordedTouches(rows, used, things, numbers, actions_named, names, kinds=kinds)


def test_a_split_by_time_tests_on_the_last_sessions(rng):
    touches = drawn(rng)
    split = by_session(touches)
    assert set(touches.sessions[split.train]) == {0, 1, 2}
    assert set(touches.sessions[split.calibration]) == {3}
    assert set(touches.sessions[split.test]) == {4}
    assert len(np.unique(np.concatenate([split.train, split.calibration, split.test]))) == touches.num_touches


def test_a_split_by_object_shares_no_object_and_tests_each_once(rng):
    touches = drawn(rng).for_task("categories")
    tested = []
    for split in splits_of(touches, 3):
        known, new = touches.objects[split.train], touches.objects[split.test]
        assert not set(known) & set(new)
        tested += sorted(set(new))
        for fold in np.unique(split.inner):  # an object is in one inner fold
            assert not set(known[split.inner == fold]) & set(known[split.inner != fold])
    assert sorted(tested) == list(range(6))
    assert sorted(for_use(touches).train) == list(range(60))


def with_few(rng, num_objects, few, many):
    """Objects that are hard to tell apart, of which the first half has fewer sessions."""
    whole = drawn(rng, num_objects, many, actions=3)
    kept = (whole.sessions < few) | (whole.objects >= num_objects // 2)
    rows = 0.3 * whole.features[kept] + rng.normal(size=(kept.sum(), 6))
    columns = (column[kept] for column in (whole.actions, whole.objects, whole.sessions))
    return RecordedTouches(rows, *columns, whole.action_names, whole.object_names)


@pytest.mark.parametrize("sessions", range(4, 12))
def test_every_object_is_learned_calibrated_on_and_tested_on(sessions, rng):
    touches = with_few(rng, 4, 4, sessions)
    split = by_session(touches)
    for rows in (split.train, split.calibration, split.test):
        assert len(np.unique(np.stack([touches.objects[rows], touches.actions[rows]]), axis=1).T) == 4 * 3


def test_the_reader_reads_and_states_what_it_reads(rng):
    touches = drawn(rng, sessions=15)
    split = by_session(touches)
    reading = read(touches, split)
    labels = touches.objects[split.test]
    right = (reading.test_ratios.argmax(axis=1) == labels).mean()
    assert right > 0.7
    probs = np.exp(reading.test_ratios + reading.reader.log_prior)
    np.testing.assert_allclose(probs.sum(axis=1), 1.0)
    assert abs(probs.max(axis=1).mean() - right) < 0.15


@pytest.mark.parametrize("kind", [TemperatureScaling(), StructuredMatrixScaling()], ids=lambda kind: kind.name)
def test_ratios_that_correlations_are_fitted_to_are_of_calibrations_that_did_not_see_them(kind, rng):
    touches = drawn(rng, sessions=12)
    split = by_session(touches)
    rows, held = split.calibration, split.folds == 0
    assert 0 < held.sum() < len(rows)
    logits = rng.normal(size=(len(rows), len(touches.object_names)))
    logits[np.arange(len(rows)), touches.objects[rows]] += 2.0
    changed = np.array(touches.objects)
    changed[rows[held]] = 0
    before, after = (
        _cross_calibrated(kind, replace(touches, objects=objects), rows, logits, split.folds)
        for objects in (touches.objects, changed)
    )
    np.testing.assert_array_equal(after[held], before[held])
    assert np.abs(after[~held] - before[~held]).max() > 0.0


def test_a_fold_of_calibration_touches_shares_no_session_or_no_object_with_the_others(rng):
    for sessions in (5, 25):
        touches = drawn(rng, sessions=sessions)
        split = by_session(touches)
        rows = split.calibration
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
    )
    split = by_session(shuffled)
    reading = read(shuffled, split)
    assert (reading.test_ratios.argmax(axis=1) == shuffled.objects[split.test]).mean() < 0.4
    assert np.abs(reading.test_ratios).max() < 3.0  # and it says so


def test_discriminants_are_log_densities_of_normals_with_one_covariance(rng):
    labels = np.arange(60) % 3
    rows = rng.normal(size=(60, 4)) + labels[:, None]
    found = LinearDiscriminants(0.0).fit(rows, labels).decision_function(rows)
    means = np.stack([rows[labels == k].mean(axis=0) for k in range(3)])
    rest = rows - means[labels]
    away = rows[:, None] - means
    wanted = -0.5 * np.einsum("nki,ij,nkj->nk", away, np.linalg.inv(rest.T @ rest / 60), away)
    np.testing.assert_allclose(found - found[:, :1], wanted - wanted[:, :1], atol=1e-5)


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
    with pytest.raises(BadRecording, match=r"thing_0 \(1 of action_0, 1 of action_1\); thing_1 .*; objects need at"):
        check_recorded(drawn(rng, sessions=1))
    with pytest.raises(BadRecording, match="at least two different objects, there is"):
        check_recorded(drawn(rng, num_objects=1))
    with pytest.raises(BadRecording, match=r"at least 3 objects of each, .* there are .'even': 2, 'odd': 2"):
        check_recorded(drawn(rng, num_objects=4).for_task("categories"))
    with pytest.raises(BadRecording, match=r"no labels for 'shapes'; they have .'objects', 'categories'"):
        drawn(rng).for_task("shapes")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"features": np.full((60, 6), np.nan)}, "features of touch 0 .*thing_0"),
        ({"features": np.full((60, 6), -1e101)}, "hold -1e.101; they must be finite and of a size up to"),
        ({"actions": np.full(60, 2)}, "actions must be in"),
        ({"sessions": np.full(60, 0.5)}, "sessions must be whole numbers, got 0.5"),
        ({"objects": np.full(60, np.nan)}, "objects must be whole numbers, got nan"),
        ({"objects": np.zeros(3, np.int64)}, "objects must be"),
        ({"kinds": {"colours": ("red",) * 6}}, "kinds must give"),
    ],
)
def test_touches_that_do_not_fit_are_refused(changed, words, rng):
    whole = drawn(rng)
    fields = {name: getattr(whole, name) for name in ("features", "actions", "objects", "sessions", "action_names")}
    with pytest.raises(BadRecording, match=words):
        RecordedTouches(**{**fields, "object_names": whole.object_names, **changed})


@pytest.mark.parametrize("sessions", [2, 3])
def test_with_few_sessions_each_object_is_tested_once_after_as_much_was_learned_as_before_calibration(sessions, rng):
    touches = drawn(rng, num_objects=7, sessions=sessions)
    tested = []
    for split in splits_of(touches, 5):
        assert set(touches.sessions[split.train]) == set(range(sessions - 1))
        assert set(touches.sessions[np.concatenate([split.test, split.calibration])]) == {sessions - 1}
        assert not set(touches.objects[split.test]) & set(touches.objects[split.calibration])
        tested += sorted(set(touches.objects[split.test]))
    assert sorted(tested) == list(range(7))
    whole = for_use(touches)
    assert len(whole.test) == 0
    assert len(whole.train) + len(whole.calibration) == touches.num_touches


def test_calibration_across_objects_states_as_much_as_is_right(rng):
    stated, right = [], []
    for sessions in (2, 3):
        touches = drawn(rng, num_objects=20, sessions=sessions, features=3)
        for split in splits_of(touches, 5):
            ratios = read(touches, split, dict(list(KINDS.items())[1:2])).test_ratios
            stated += softmax(ratios, axis=1).max(axis=1).tolist()
            right += (ratios.argmax(axis=1) == touches.objects[split.test]).tolist()
    # 160 touches: the standard error of the difference is at most 0.04; four of them fail once in 10 000
    assert abs(np.mean(stated) - np.mean(right)) < 0.16


def test_a_bank_of_objects_that_lack_actions_is_searched_with_those_that_all_have(rng):
    whole = bank()
    kept = ~((whole.objects == 1) & (whole.actions == 0))
    columns = (getattr(whole, name)[kept] for name in ("ratios", "labels", "objects", "actions", "sessions"))
    lacking = RecordedBank(whole.label_names, whole.action_names, *columns)
    assert lacking.actions_of([0]) == [0, 1]
    assert lacking.actions_of([0, 1]) == [1]
    assert lacking.repeats == 3
    both = lacking.among(("mug", "can"), lacking.actions_of([0, 1]))
    assert both.action_names == ("rub",)
    assert RecordedWorld(both, [1], [0]).touch(0, rng).logits[0] >= 110.0
    with pytest.raises(InvalidArgument, match="object 1 has no recording with the action press"):
        RecordedWorld(lacking, [1], [0]).touch(0, rng)


def test_objects_that_lack_sessions_are_left_out_by_name_or_nothing_is(rng):
    whole = drawn(rng)
    touches = whole.only((whole.objects != 2) | (whole.sessions == 0))
    with pytest.raises(BadRecording, match=r"1 of 6 objects have too few sessions: thing_2 \(1 of action_0.*--drop"):
        check_recorded(touches)
    rest, notes = without_incomplete(touches)
    assert rest.object_names == ("thing_0", "thing_1", "thing_3", "thing_4", "thing_5")
    assert np.bincount(rest.objects).tolist() == [10] * 5
    assert notes == ("1 objects are left out as they lack sessions: thing_2 (1 of action_0, 1 of action_1)",)
    assert without_incomplete(whole) == (whole, ())
    with pytest.raises(BadRecording, match="no object has enough sessions of every action"):
        without_incomplete(whole.only(whole.sessions == 0))
    kinds = replace(whole, kinds={"shapes": ("a", "a", "a", "b", "b", "b")}).without(np.array([5])).for_task("shapes")
    with pytest.raises(BadRecording, match=r"at least 3 objects of each.*'b': 2.*--drop"):
        check_recorded(kinds)


def test_sessions_in_random_order_stay_whole(rng):
    touches = drawn(rng, sessions=12)
    shuffled = touches.in_random_order(3)
    assert (shuffled.sessions != touches.sessions).any()
    for index in range(6):
        here = touches.objects == index
        pairs = {*zip(touches.sessions[here].tolist(), shuffled.sessions[here].tolist(), strict=True)}
        assert len(pairs) == 12 == len({new for _, new in pairs})
