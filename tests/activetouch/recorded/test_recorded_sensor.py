"""A sensor of recorded touches: what is saved is what is loaded, and what has no scene says so."""

from dataclasses import replace

import numpy as np
import pytest

import activetouch
from activetouch import SCENES, RecordedSensor, Sensor, TactileSensor
from activetouch.errors import LabelMismatch, WrongScene
from activetouch.recorded import RecordedTouches
from activetouch.recorded.reader_file import RECORDED_READER, read_recorded_reader, write_recorded_reader
from belief.errors import CannotWrite, CorruptFile, InvalidArgument, UnknownName
from belief.sealed_tensors import read_tensors, write_tensors
from experiments.scene_choice import SceneChoice
from experiments.sensor_choice import open_sensor

THINGS = ("mug", "can", "ball", "box", "bowl", "cup")


def recordings(rng, things=THINGS):
    """Five sessions of each thing by two actions."""
    objects, sessions, actions = (axis.ravel() for axis in np.indices((len(things), 5, 2)))
    means = 3.0 * rng.normal(size=(len(things), 4))
    features = means[objects] + rng.normal(size=(len(objects), 4))
    names = ("f0", "f1", "f2", "f3")
    return RecordedTouches(
        features, actions, objects, sessions, ("press", "rub"), things, feature_names=names, licence="mine"
    )


@pytest.fixture(scope="module")
def sensor():
    return RecordedSensor.fit(recordings(np.random.default_rng(0)))


def test_a_loaded_sensor_reads_the_same_to_the_last_bit(rng, tmp_path):
    made = RecordedSensor.fit(recordings(rng))
    made.save(tmp_path)
    loaded = TactileSensor.load(tmp_path)
    asked, actions = rng.normal(size=(30, 4)) * 10.0 ** rng.integers(-3, 90, size=(30, 1)), rng.integers(2, size=30)
    for before, after in zip(made.read(asked, actions), loaded.read(asked, actions), strict=True):
        assert before.logits.tobytes() == after.logits.tobytes()
        assert np.isfinite(after.logits).all()
    assert loaded.model.to_fields() == made.model.to_fields()
    assert (loaded.shape_labels, loaded.pose_labels) == (THINGS, ("press", "rub"))
    assert loaded.origin == made.origin
    assert loaded.origin["licence"] == "mine"


def test_a_sensor_names_what_it_touches(sensor, rng):
    fresh = recordings(np.random.default_rng(0))
    touches = sensor.read(fresh.features, [fresh.action_names[action] for action in fresh.actions])
    known = [sensor.shape_labels[touch.logits.argmax()] for touch in touches]
    assert np.mean([name == THINGS[index] for name, index in zip(known, fresh.objects, strict=True)]) > 0.8
    both = sensor.among(["can", "mug"])
    assert both.shape_labels == both.model.shape_labels == ("can", "mug")
    first = both.read(fresh.features[:1], ["press"])[0].logits
    assert first.tolist() == [touches[0].logits[sensor.shape_labels.index(name)] for name in ("can", "mug")]


def test_what_needs_a_scene_refuses_a_sensor_of_recorded_touches(sensor, tmp_path):
    sensor.save(tmp_path)
    for needs in (
        lambda: activetouch.compare("coarse", sensor=sensor),
        lambda: TactileSensor.load(tmp_path, SCENES["coarse"].scene),
        lambda: open_sensor(tmp_path, SceneChoice("coarse")),
    ):
        with pytest.raises(WrongScene, match=r"no scene simulates recorded touches.*session\(TARGET\)"):
            needs()
    with pytest.raises(InvalidArgument, match=r"must be a Scene.*holds no recorded_reader.safetensors"):
        TactileSensor.load(tmp_path.parent)


def test_a_search_touches_objects_that_the_observation_model_draws(sensor):
    assert isinstance(sensor, Sensor)
    found = [sensor.search("mug", seed=(7, 0, number)) for number in range(30)]
    assert np.mean([one.success for one in found]) > 0.7  # a guess is right in 0.25; fails with probability < 1e-4
    assert sensor.search("mug", seed=7).to_dict() == found[0].to_dict()
    assert sensor.search("ball", num_objects=2, composition="independent").arrangement != ()


@pytest.mark.parametrize(
    ("features", "actions", "error", "said"),
    [
        (np.zeros((1, 3)), ["press"], InvalidArgument, r"features \(f0, f1, f2, f3\) must be \(1, 4\).*got \(1, 3\)"),
        (np.zeros((2, 4)), ["press"], InvalidArgument, r"must be \(1, 4\).*got \(2, 4\)"),
        (np.full((1, 4), np.nan), ["press"], InvalidArgument, "features.*not finite"),
        (np.full((1, 4), -1e101), ["press"], InvalidArgument, "features.*1e[+]100"),
        (np.zeros((1, 4)), ["pres"], UnknownName, "press"),
        (np.zeros((1, 4)), [2], InvalidArgument, "action must be in"),
    ],
)
def test_features_that_are_not_those_of_the_recordings_are_refused(sensor, features, actions, error, said):
    with pytest.raises(error, match=said):
        sensor.read(features, actions)


@pytest.mark.parametrize(
    "row",
    [
        ["a", "b", "c", "d"],
        ["1", "2", "3", "4"],
        [1j, 0.0, 0.0, 0.0],
        {"f0": 1.0},
        [[1.0], [2.0, 3.0]],
        [None, 0.0, 0.0, 0.0],
        [np.nan, 0.0, 0.0, 0.0],
        np.ma.masked_array([0.0, 1.0, 2.0, 3.0], [True, False, False, False]),
        [0.0, 1.0, 2.0],
    ],
)
def test_a_row_that_a_session_cannot_read_is_refused_and_changes_nothing(sensor, row):
    session = sensor.session("mug")
    asked = session.ask()
    with pytest.raises(InvalidArgument, match=r"image must|features"):
        session.tell(image=row)
    assert (session.step, session.ask()) == (0, asked)


@pytest.mark.parametrize("labels", [[], "mug", ["mug", "spoon"], ["mug", "mug"]])
def test_a_sensor_is_among_some_of_its_own_labels(sensor, labels):
    with pytest.raises(InvalidArgument, match=r"one or more of mug|does not know \['spoon'\]|must differ"):
        sensor.among(labels)


def test_no_touches_are_read_as_none(sensor):
    assert sensor.read(np.empty((0, 4)), []) == []


def test_files_that_do_not_fit_are_refused(sensor, tmp_path):
    path = tmp_path / "recorded_reader.safetensors"
    sensor.save(tmp_path)
    arrays, header = read_tensors(path, RECORDED_READER)
    wrong = [
        ({**arrays, "log_prior": np.zeros(5)}, header),
        ({**arrays, "0.centre": np.zeros(3)}, header),
        ({**arrays, "0.classifier.means": np.full((6, 4), np.nan)}, header),
        ({**arrays, "0.classifier.os": np.zeros(3)}, header),
        ({name: array for name, array in arrays.items() if name != "1.scale"}, header),
        (arrays, {**header, "label_names": ["mug"]}),
        (arrays, {**header, "feature_names": ["f0"]}),
        (arrays, {**header, "calibration": {**header["calibration"], "kind": "os.system"}}),
    ]
    for content in wrong:
        write_tensors(path, *content, RECORDED_READER)
        with pytest.raises(CorruptFile):
            read_recorded_reader(path)
    sensor.save(tmp_path)
    damaged = bytearray(path.read_bytes())
    damaged[-1] ^= 1
    path.write_bytes(damaged)
    with pytest.raises(CorruptFile, match="changed after it was written"):
        TactileSensor.load(tmp_path)
    fewer = replace(sensor.recorded_reader, label_names=("mug", "can", "ball", "box", "bowl", "saucer"))
    write_recorded_reader(path, fewer)
    with pytest.raises(LabelMismatch, match="reader does not know cup of"):
        TactileSensor.load(tmp_path)


def test_a_sensor_is_not_saved_over_one_of_a_scene(sensor, tmp_path):
    (tmp_path / "reader.safetensors").touch()
    with pytest.raises(CannotWrite, match="another folder"):
        sensor.save(tmp_path)


def pressed(rng, means, forces, sessions=8, noise=0.3):
    """Recordings of 8 things by two actions, with features that grow with the force of the press."""
    objects, numbers, actions, levels = (a.ravel() for a in np.indices((8, sessions, 2, len(forces))))
    rows = means[objects, actions] * np.array(forces)[levels, None] + noise * rng.normal(size=(len(objects), 6))
    names = tuple(f"thing{i}" for i in range(8))
    return RecordedTouches(rows, actions, objects, numbers * len(forces) + levels, ("press", "rub"), names)


def searched(sensor, feel, runs=6):
    """Ends of searches among four of eight things by a robot that feels rows, and their numbers of touches."""
    ends, numbers, rng = [], [], np.random.default_rng(0)
    for seed in range(runs):
        things = rng.permutation(8)[:4]
        names = [sensor.shape_labels[i] for i in things]
        session = sensor.among(names).session(names[0], num_objects=4, seed=seed)
        table = rng.permutation(things)
        while (action := session.ask()) is not None:
            session.tell(
                **({"image": feel(table[session.object_index], action.pose)} if hasattr(action, "pose") else {})
            )
        ends.append(str(session.outcome))
        numbers.append(len([step for step in session.steps if step.touch is not None]))
    return ends, numbers


@pytest.fixture(scope="module")
def of_forces():
    """The means of things, and a sensor that was trained on presses of 1 and 2 N, as it is saved."""
    rng = np.random.default_rng(0)
    means = 0.5 * rng.normal(size=(8, 2, 6)) + rng.normal(size=6)
    return means, RecordedSensor.fit(pressed(rng, means, (1.0, 2.0)))


def test_a_force_never_learned_no_contact_and_noise_end_unsure_and_the_known_world_does_not(of_forces, rng, tmp_path):
    means, made = of_forces
    made.save(tmp_path)
    sensor = TactileSensor.load(tmp_path)

    def replayed(touches):
        rows = {
            (i, a): touches.features[(touches.objects == i) & (touches.actions == a)] for i in range(8) for a in (0, 1)
        }
        return lambda thing, action: rng.choice(rows[thing, action])

    known = searched(sensor, replayed(pressed(rng, means, (1.0, 2.0))))
    assert known[0].count("confirmed") >= 5
    for feel in (
        replayed(pressed(rng, means, (5.0,))),
        lambda thing, action: np.zeros(6),
        lambda thing, action: 3.0 * rng.normal(size=6),
    ):
        ends, numbers = searched(sensor, feel)
        assert ends.count("unsure") >= 4
        assert np.mean(numbers) < 10  # of 48


def test_a_row_like_those_of_no_contact_is_a_miss(rng, tmp_path):
    touches = pressed(rng, rng.normal(size=(8, 2, 6)) + 3.0, (1.0, 2.0))
    untouched = 7.0 + 0.1 * rng.normal(size=touches.features.shape)
    sensor = RecordedSensor.fit(replace(touches, controls={"untouched": untouched}))
    sensor.save(tmp_path)
    for one in (sensor, TactileSensor.load(tmp_path)):
        for row, missed in ((np.full(6, 7.0), True), (untouched[3], True), (touches.features[0], False)):
            session = one.session("thing0", num_objects=2)
            session.ask()
            before = session.belief.probs
            session.tell(image=row)
            assert (session.steps[-1].decision.scores.get("is_miss", 0.0) == 1.0) == missed
            assert np.array_equal(session.belief.probs, before) == missed
    zeros = RecordedSensor.fit(touches).recorded_reader
    assert zeros.is_blank(np.zeros(6))
    assert not any(zeros.is_blank(row) for row in touches.features)


def test_few_touches_give_no_conflict_test(rng):
    few = recordings(rng, THINGS[:3])
    sensor = RecordedSensor.fit(few)
    assert sensor.model.conflict is None
    assert sensor.read(few.features[:1], ["press"])[0].features is None


def test_a_label_that_was_never_touched_with_an_action_is_told_nothing_by_it(rng):
    whole = recordings(rng)
    touches = whole.only((whole.objects > 0) | (whole.actions == 0))
    sensor = RecordedSensor.fit(touches)
    logits = np.array([touch.logits for touch in sensor.read(whole.features, whole.actions.tolist())])
    assert not logits[whole.actions == 1, 0].any()
    assert logits[whole.actions == 0, 0].all()


def test_logits_as_features_are_read_as_they_are(rng, tmp_path):
    objects, sessions = (axis.ravel() for axis in np.indices((4, 10)))
    logits = 3.0 * np.eye(4)[objects] + 2.0 * rng.normal(size=(40, 4))
    columns = [2, 0, 3, 1]
    touches = RecordedTouches(
        logits[:, columns], 0 * objects, objects, sessions, ("press",), tuple("abcd"), feature_names=tuple("cadb")
    )
    RecordedSensor.fit(touches, is_logits=True).save(tmp_path)
    read = np.array([t.logits for t in TactileSensor.load(tmp_path).read(touches.features, [0] * 40)])
    assert np.corrcoef(read.ravel(), (logits - logits.mean(axis=1, keepdims=True)).ravel())[0, 1] > 0.9
