"""A sensor of recorded touches: what is saved is what is loaded, and what has no scene says so."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch import SCENES, RecordedSensor, TactileSensor
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
        lambda: sensor.scene,
        lambda: sensor.reader,
        lambda: sensor.search("mug"),
        lambda: TactileSensor.load(tmp_path, SCENES["coarse"].scene),
        lambda: open_sensor(tmp_path, SceneChoice("coarse")),
    ):
        with pytest.raises(WrongScene, match=r"no scene simulates recorded touches.*session\(TARGET\)"):
            needs()
    with pytest.raises(InvalidArgument, match="must be a Scene"):
        TactileSensor.load(tmp_path.parent)


@pytest.mark.parametrize(
    ("features", "actions", "error", "said"),
    [
        (np.zeros((1, 3)), ["press"], InvalidArgument, r"features \(f0, f1, f2, f3\) must be \(1, 4\).*got \(1, 3\)"),
        (np.zeros((2, 4)), ["press"], InvalidArgument, r"must be \(1, 4\).*got \(2, 4\)"),
        (np.full((1, 4), np.nan), ["press"], ValueError, "features.*not finite"),
        (np.full((1, 4), -1e101), ["press"], ValueError, "features.*1e[+]100"),
        (np.zeros((1, 4)), ["pres"], UnknownName, "press"),
        (np.zeros((1, 4)), [2], InvalidArgument, "action must be in"),
    ],
)
def test_features_that_are_not_those_of_the_recordings_are_refused(sensor, features, actions, error, said):
    with pytest.raises(error, match=said):
        sensor.read(features, actions)


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
