"""Which of its two readers a sensor reads a scene with, and what it says where neither can."""

import pickle
import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import pytest

from activetouch import SCENES, TactileSensor
from activetouch.distributions import Constant, Uniform
from activetouch.errors import LabelMismatch, NoIndependentModel, SceneShift, WrongScene
from activetouch.orientations import Upright
from activetouch.pressing.contact import Quasistatic
from activetouch.rendering import Blur, Noise, Quantisation
from activetouch.sensor_files import (
    ANY_OBJECT_FILE,
    MODELS,
    OBSERVATION_FILE,
    READER_FILE,
    files_for,
    fitted_model,
    reader_file,
)
from activetouch.shapes import Box, Cylinder
from activetouch.solids.family import Family
from belief.errors import CorruptFile, UnknownName
from belief.files import sealed_json, unsealed_json

COARSE = SCENES["coarse"].scene
FOLDER = MODELS / "coarse"
BRICKS = {"brick": Box((0.02, 0.01, 0.01)), "die": Box((0.01, 0.01, 0.01))}


def varied(**changes):
    return replace(COARSE, variation=replace(COARSE.variation, **changes))


OWN = {
    "as it is": COARSE,
    "other sizes": varied(size=Uniform(0.8, 1.2)),
    "lying otherwise": replace(COARSE, presentation=Upright()),
    "a fault that cannot be told": replace(COARSE, faults=(*COARSE.faults, Quantisation(4))),
}
OTHER = {
    "other shapes": replace(COARSE, shapes=BRICKS),
    "another order": replace(COARSE, shapes=dict(reversed(COARSE.shapes.items()))),
    "other poses": replace(COARSE, poses="directions26"),
    "a family": replace(
        COARSE, shapes={**COARSE.shapes, "cylinder": Family(Cylinder(0.016, 0.02), half_length=Uniform(0.01, 0.04))}
    ),
}
TOLD = {
    "noise": replace(COARSE, faults=(*COARSE.faults, Noise(0.1))),
    "blur": replace(COARSE, faults=(*COARSE.faults, Blur(0.2))),
    "force": varied(force=Constant(1.0)),
}


@pytest.mark.parametrize("what", OWN)
def test_the_own_reader_reads_its_objects(what):
    for independent in (False, True):
        assert reader_file(FOLDER, OWN[what], independent) == FOLDER / READER_FILE


@pytest.mark.parametrize("what", OTHER)
def test_the_reader_of_any_object_reads_others(what):
    assert reader_file(FOLDER, OTHER[what]) == FOLDER / ANY_OBJECT_FILE
    assert files_for(FOLDER, OTHER[what])[2] == ()
    with pytest.raises(NoIndependentModel, match="reads these objects, and takes all touches of one as of one body"):
        files_for(FOLDER, OTHER[what], independent=True)
    with pytest.raises(NoIndependentModel):
        TactileSensor.load(FOLDER, OTHER[what], independent=True)


@pytest.mark.parametrize("what", TOLD)
def test_the_reader_of_any_object_is_told_the_state_of_the_sensor(what):
    assert reader_file(FOLDER, TOLD[what]) == FOLDER / ANY_OBJECT_FILE
    assert files_for(FOLDER, TOLD[what])[2] == ()
    assert reader_file(FOLDER, TOLD[what], independent=True) == FOLDER / READER_FILE
    assert files_for(FOLDER, TOLD[what], independent=True)[2] != ()


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"pad": replace(COARSE.pad, half_width=0.02)}, r"pad\.half_width is 0\.02, not 0\.015"),
        ({"pad": replace(COARSE.pad, max_depth=0.002)}, r"pad\.max_depth is 0\.002, not 0\.003"),
        ({"renderer": SCENES["gel"].scene.renderer}, r"renderer\.binning is 1, not 8"),
        ({"renderer": SCENES["paper"].scene.renderer}, r"renderer is ForcePatchRenderer, not PressureRenderer"),
    ],
)
def test_another_pad_is_refused_with_its_difference(changes, told):
    scene = replace(COARSE, shapes=BRICKS, **changes)
    for load in (files_for, TactileSensor.load):
        with pytest.raises(WrongScene, match=told):
            load(FOLDER, scene)


@pytest.mark.parametrize("left", [READER_FILE, OBSERVATION_FILE])
def test_a_sensor_that_lost_a_file_is_not_replaced_by_the_reader_of_any_object(left, tmp_path):
    for name in (ANY_OBJECT_FILE, left):
        shutil.copy(FOLDER / name, tmp_path / name)
    (missing,) = {READER_FILE, OBSERVATION_FILE} - {left}
    with pytest.raises(CorruptFile, match=f"{missing} is missing"):
        TactileSensor.load(tmp_path, COARSE)


def test_a_folder_with_the_reader_of_any_object_alone_is_a_sensor(few_hypotheses, tmp_path):
    shutil.copy(FOLDER / ANY_OBJECT_FILE, tmp_path / ANY_OBJECT_FILE)
    scene = replace(COARSE, shapes=BRICKS, poses={"front": COARSE.rotations["front"]}, press_model=Quasistatic())
    assert reader_file(tmp_path, COARSE).name == ANY_OBJECT_FILE
    with warnings.catch_warnings():
        warnings.simplefilter("error", SceneShift)
        warnings.filterwarnings("ignore", message="in simulation")
        sensor = TactileSensor.load(tmp_path, scene)
    assert sensor.model.shape_labels == ("brick", "die")


def test_a_damaged_reader_of_any_object_is_refused_where_it_would_be_asked(tmp_path):
    shutil.copytree(FOLDER, tmp_path / "sensor")
    path = tmp_path / "sensor" / ANY_OBJECT_FILE
    path.write_bytes(path.read_bytes()[:300])
    for scene in (OTHER["other shapes"], TOLD["noise"], COARSE):
        with pytest.raises(CorruptFile, match=ANY_OBJECT_FILE):
            TactileSensor.load(tmp_path / "sensor", scene)


DAMAGES = {
    "truncated": lambda path: path.read_bytes()[:999],
    "empty": lambda path: b"",
    "changed in one bit": lambda path: (data := path.read_bytes())[:-9] + bytes([data[-9] ^ 1]) + data[-8:],
    "a text": lambda path: b"I am no file of yours\n",
    "a pickle": lambda path: pickle.dumps(Trap(path.with_name("unpickled"))),
}


class Trap:
    """Leaves a file behind where it is unpickled."""

    def __init__(self, bait):
        self.bait = bait

    def __reduce__(self):
        return Path.touch, (self.bait,)


@pytest.mark.parametrize("what", DAMAGES)
@pytest.mark.parametrize("name", [READER_FILE, OBSERVATION_FILE])
def test_a_damaged_file_is_refused_by_name_and_no_code_in_it_runs(name, what, tmp_path):
    for file in (READER_FILE, OBSERVATION_FILE):
        (tmp_path / file).symlink_to(FOLDER / file)
    content = DAMAGES[what](tmp_path / name)
    (tmp_path / name).unlink()
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CorruptFile, match=name):
        TactileSensor.load(tmp_path, COARSE)
    assert not (tmp_path / "unpickled").exists()


def test_a_sensor_that_is_not_there_is_named(tmp_path):
    with pytest.raises(UnknownName, match="Did you mean 'gel'"):
        TactileSensor.shipped("gell")
    (tmp_path / READER_FILE).symlink_to(FOLDER / READER_FILE)
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(CorruptFile, match=folder.name):
            TactileSensor.load(folder, COARSE)
    with pytest.raises(CorruptFile, match="cannot be read"):
        fitted_model(tmp_path)


@pytest.mark.parametrize(
    ("change", "error", "told"),
    [
        ({"model": "oracle"}, CorruptFile, "unknown kind 'oracle'"),
        ({"shape_labels": [*"abcd"]}, LabelMismatch, "the scene has"),
        ({"shape_labels": None}, CorruptFile, "no observation model"),
    ],
)
def test_a_sealed_observation_model_of_something_else_is_refused(change, error, told, tmp_path):
    (tmp_path / READER_FILE).symlink_to(FOLDER / READER_FILE)
    fields = unsealed_json((FOLDER / OBSERVATION_FILE).read_text())
    (tmp_path / OBSERVATION_FILE).write_text(sealed_json(fields | change))
    with pytest.raises(error, match=told):
        TactileSensor.load(tmp_path, COARSE)


@pytest.mark.parametrize(
    ("place", "values"),
    [
        (("num_hypotheses",), (0, -1, 2.5, 1e300, True, "x")),
        (("temperature",), (0, -1, "x")),
        (("correlation",), (-0.1, 1.1, 1e300)),
        (("drift",), (-0.1, 1.1)),
        (("conflict", "num_objects"), (0, -1, 19, 2.5, True, 1e300, None)),
        (("conflict", "correlations"), ([-0.1, 0.2], [0.1, 1.5], ["x", 0.1], [None, 0.1], 3)),
    ],
)
def test_a_model_with_a_number_out_of_its_range_is_refused_though_it_is_sealed(place, values, tmp_path):
    for value in values:
        fields = unsealed_json((FOLDER / OBSERVATION_FILE).read_text())
        (fields if len(place) == 1 else fields[place[0]])[place[-1]] = value
        (tmp_path / OBSERVATION_FILE).write_text(sealed_json(fields))
        with pytest.raises(CorruptFile, match="no observation model"):
            fitted_model(tmp_path)
