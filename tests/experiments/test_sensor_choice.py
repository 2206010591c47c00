"""Commands refuse sensors and collections of other scenes before any work, with remedies that can be pasted."""

import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import tyro

from activetouch import SCENES, SHAPES
from activetouch.data.manifest import CollectionPlan, NoCollection, read_manifest
from activetouch.errors import LabelMismatch, NoIndependentModel, SceneShift, WrongScene
from activetouch.sensor import TactileSensor
from activetouch.sensor_files import INDEPENDENT_FILE, MODELS, OBSERVATION_FILE, READER_FILE, fitted_model
from belief.errors import CorruptFile, InvalidArgument
from belief.observation_model.doubted_sensor import DoubtedSensorModel
from belief.observation_model.rigid_body import RigidBodyModel
from belief.observation_model.varied_bodies import VariedBodyModel
from experiments.calibration.calibration_report import CalibrationReport
from experiments.cli import commands
from experiments.command_line.arguments import Trust
from experiments.ppo.train_ppo import TrainPPO
from experiments.ppo.training import kept_bank
from experiments.robustness.robustness import Robustness
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.sensor.calibrate import Calibrate, TooFewObjects
from experiments.sensor.collect import collect
from experiments.sensor.train import Train
from experiments.sensor_choice import NoSensor, doubts, open_sensor
from planners.ppo import MissingPolicy

GEL, COARSE, PAPER, MANY, KEYED = (MODELS / name for name in ("gel", "coarse", "paper", "many", "keyed"))
QUICK = SceneChoice("coarse", fidelity="quasistatic")


def compared(choice, sensor=None, **changes):
    return lambda out: Compare(
        setting=Setting(choice, sensor=sensor), deciders=("threshold",), episodes=1, jobs=1, out=out / "run", **changes
    ).run()


REFUSED = {
    "a finer pad": (compared(SceneChoice("coarse"), GEL), WrongScene, "pad.num_taxels is 32, not 128"),
    "another renderer": (compared(SceneChoice(renderer="gelsight")), WrongScene, "GelSightRenderer, not Pressure"),
    "other shapes": (compared(SceneChoice("hard"), KEYED), LabelMismatch, "torus"),
    "no sensor": (compared(SceneChoice("gel"), Path(".")), NoSensor, "there is no reader.safetensors"),
    "no policies": (
        lambda out: Compare(setting=Setting(SceneChoice("hard")), deciders=("ppo",), out=out / "run").run(),
        MissingPolicy,
        "train-ppo --scene hard",
    ),
    "policies of another sensor": (
        lambda out: Compare(setting=Setting(SceneChoice("paper")), deciders=("ppo",), out=out / "run").run(),
        MissingPolicy,
        "The sensor paper-independent has policies: add --sensor paper-independent",
    ),
    "robustness": (
        lambda out: Robustness("coarse", sensor=Path("gel"), out=out / "run").run(),
        WrongScene,
        "num_taxels",
    ),
    "train without a collection": (
        lambda out: Train(scene="coarse", data=out / "none", out=out / "run").run(),
        NoCollection,
        "collect --scene coarse --out",
    ),
    "calibrate without a collection": (
        lambda out: Calibrate(scene="coarse", data=out / "none", out=out / "run").run(),
        NoCollection,
        "collect --plan.train 0 --plan.repeats 6 --scene coarse --out",
    ),
    "train-ppo without a collection": (
        lambda out: TrainPPO(scene="coarse", data=out / "none", out=out / "run").run(),
        NoCollection,
        "collect --plan.train 0 --plan.repeats 6 --scene coarse --out",
    ),
}


@pytest.mark.torch
@pytest.mark.parametrize("what", REFUSED)
def test_what_does_not_belong_together_is_refused_before_any_work(what, tmp_path):
    run, error, told = REFUSED[what]
    with pytest.raises(error, match=re.escape(told)) as found:
        run(tmp_path)
    assert not (tmp_path / "run").exists()
    pastes(str(found.value))


def pastes(text):
    """Check that every command in a text is one: the program's own parser takes it."""
    for line in re.findall(r"activetouch (?:[a-z-]+) .*", text):
        _, name, *arguments = shlex.split(line)
        tyro.cli(commands()[name], args=arguments)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """A tiny collection of ``coarse``, pressed without an engine."""
    folder = tmp_path_factory.mktemp("data") / "quick"
    collect(QUICK, CollectionPlan(0, 1, 1, repeats=2), folder, jobs=1)
    return folder


@pytest.mark.torch
@pytest.mark.parametrize("command", [CalibrationReport, TrainPPO])
def test_a_collection_of_another_scene_than_the_sensors_is_refused(command, quick, tmp_path):
    with pytest.raises(WrongScene, match=r"pad\.num_taxels is 32, not 128") as found:
        command(scene="gel", data=quick, out=tmp_path / "out").run()
    assert "--anyway" in str(found.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.torch
def test_calibrate_refuses_a_collection_of_another_scene_and_results_under_a_wrong_name(quick, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(WrongScene, match="the reader was made for another scene"):
        Calibrate(scene="coarse", data=quick, reader=GEL / READER_FILE).run()
    with pytest.raises(WrongScene, match="the scene 'gel' was made for another scene"):
        Calibrate(scene="gel", data=quick, reader=COARSE / READER_FILE).run()
    assert not list(tmp_path.iterdir())


def test_train_refuses_results_under_the_name_of_a_scene_that_the_collection_is_not_of(quick, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(WrongScene, match=r"the scene 'gel' .*: pad\.num_taxels is 32.*--out"):
        Train(scene="gel", data=quick).run()
    assert not list(tmp_path.iterdir())


@pytest.mark.torch
def test_calibrating_on_four_objects_says_how_many_it_takes(quick, tmp_path, capsys):
    with pytest.raises(TooFewObjects, match=r"1 calibration objects and 1 test objects of every shape; .* at least 2"):
        Calibrate(scene="coarse", data=quick, reader=COARSE / READER_FILE, out=tmp_path / "out").run()
    assert "press_model is Quasistatic, not Dynamic" in capsys.readouterr().err  # a known shift warns


def test_calibrating_before_training_names_the_command_that_trains(quick, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(NoSensor, match=r"is missing; train it with: activetouch train --scene coarse"):
        Calibrate(scene="coarse", data=quick).run()


@pytest.mark.torch
def test_a_sensor_remembers_the_scene_it_was_calibrated_in(tmp_path):
    data, out = tmp_path / "data", tmp_path / "sensor"
    collect(QUICK, CollectionPlan(0, 2, 1, repeats=2), data, jobs=1)
    Calibrate(scene="coarse", data=data, reader=COARSE / READER_FILE, observation_model=("ratio",), out=out).run()
    with pytest.warns(SceneShift, match="press_model is Quasistatic, not Dynamic"):
        sensor = TactileSensor.load(out, QUICK.named.scene)
    assert sensor.shift == ("press_model is Quasistatic, not Dynamic",)
    bank = kept_bank(sensor.reader, data, "test", tmp_path / "bank")
    assert bank.scene == read_manifest(data).scene
    before = [path.stat().st_mtime_ns for path in (tmp_path / "bank").iterdir()]
    kept_bank(sensor.reader, data, "test", tmp_path / "bank")
    assert [path.stat().st_mtime_ns for path in (tmp_path / "bank").iterdir()] == before


@pytest.mark.torch
@pytest.mark.filterwarnings("ignore::activetouch.errors.AlikeShapes")  # as its taxels are too wide for the reader
def test_a_sensor_of_another_scene_is_used_anyway_when_asked_to(few_hypotheses, tmp_path, capsys):
    setting = Setting(QUICK, sensor=GEL, anyway=True)
    with pytest.raises(WrongScene, match="num_taxels"):
        replace(setting, anyway=False).open_sensor()
    Compare(setting=setting, deciders=("threshold",), targets=("cone",), episodes=1, jobs=1, out=tmp_path / "run").run()
    for text in (capsys.readouterr().err, (tmp_path / "run" / "report.html").read_text(encoding="utf-8")):
        assert "pad.num_taxels is 32, not 128" in text
    assert Setting.from_dict(setting.to_dict(), Trust(Path("run.json"))) == setting


@pytest.mark.parametrize("name", list(SCENES))
def test_a_shipped_sensor_belongs_to_its_scene(name):
    assert Setting(SceneChoice(name)).open_sensor().shift == ()
    assert Setting(SceneChoice(name, presentation="upright")).open_sensor().shift != ()


@pytest.mark.parametrize("file", [READER_FILE, OBSERVATION_FILE])
def test_a_damaged_sensor_is_refused_before_any_work(file, tmp_path):
    shutil.copytree(COARSE, tmp_path / "sensor")
    path = tmp_path / "sensor" / file
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(CorruptFile, match=file):
        Setting(SceneChoice("coarse"), sensor=tmp_path / "sensor").open_sensor()


def test_an_observation_model_in_which_one_digit_flipped_is_refused(tmp_path):
    shutil.copytree(COARSE, tmp_path / "sensor")
    path = tmp_path / "sensor" / OBSERVATION_FILE
    text = path.read_text()
    digits = [found.start() + 2 for found in re.finditer(r"\d\.[1-8]", text)]
    at = digits[len(digits) // 2]
    path.write_text(text[:at] + str(int(text[at]) + 1) + text[at + 1 :])
    with pytest.raises(CorruptFile, match="was changed after it was written"):
        fitted_model(tmp_path / "sensor")


@pytest.mark.parametrize(
    ("choice", "given", "remedy"),
    [
        (SceneChoice("coarse", poses="directions26"), MODELS / "hard", "Leave out --sensor"),
        (SceneChoice("many", poses="directions26"), MODELS / "many", "Add --sensor gel"),
        (replace(SCENES["many"], scene=SCENES["gel"].scene), MODELS / "hard", "Add --sensor gel"),
        (SceneChoice(renderer="gelsight"), GEL, "Make one with the commands collect, train and calibrate"),
    ],
)
def test_a_remedy_names_a_sensor_that_ships_or_the_commands_that_make_one(choice, given, remedy):
    with pytest.raises((LabelMismatch, WrongScene)) as found:
        open_sensor(given, choice)
    assert re.search(rf"(\. |:\n){re.escape(remedy)}", str(found.value))
    pastes(str(found.value))


_IN_NEED = "collect|train|calibrate|train-ppo|compare"
HALF = rf"(with|run|calibrate|scene|again)[:,]? `?activetouch ({_IN_NEED})\b(?! \{{)"


def test_no_remedy_in_the_code_is_half_a_command():
    """What tells people to type a command of those that need a scene is made by ``command``, never written by hand."""
    root, halves = Path(__file__).parents[2], []
    for package in ("belief", "planners", "activetouch", "experiments"):
        for path in (root / package).rglob("*.py"):
            lines = path.read_text(encoding="utf-8").splitlines()
            halves += [f"{path.name}:{n}: {line}" for n, line in enumerate(lines, 1) if re.search(HALF, line)]
    assert not halves


def test_a_joint_sensor_keeps_its_independent_model_and_compare_can_play_it(tmp_path):
    joint = MODELS / "coarse"
    assert [fitted_model(joint, independent).model.name for independent in (False, True)] == ["rigid body", "ratio"]
    assert fitted_model(MODELS / "paper-independent", independent=True).model.name == "ratio"  # it has no other
    own = Setting(SceneChoice("coarse"))
    independent = replace(own, observation_model="independent")
    assert [setting.open_sensor().model.name for setting in (own, independent)] == ["rigid body", "ratio"]
    assert own.sensor_files(own.scene) != independent.sensor_files(own.scene)
    assert Setting.from_dict(independent.to_dict(), Trust(Path("run.json"))) == independent
    shutil.copytree(joint, tmp_path / "sensor")
    (tmp_path / "sensor" / INDEPENDENT_FILE).unlink()
    with pytest.raises(NoIndependentModel, match="calibrate writes both"):
        replace(independent, sensor=tmp_path / "sensor").open_sensor()


def test_a_doubting_sensor_doubts_what_it_can_also_among_other_objects(few_hypotheses):
    doubting = open_sensor(None, SceneChoice("coarse"), doubting=True)
    assert isinstance(doubting.model, DoubtedSensorModel)
    assert isinstance(doubting.model.nominal, VariedBodyModel)
    among_others = doubting.with_objects({label: SHAPES[label] for label in ("cube", "cone")}).model
    assert isinstance(among_others, DoubtedSensorModel)
    assert isinstance(among_others.nominal, RigidBodyModel)  # all bodies of the reader that doubts
    for other in (SceneChoice("paper"), SceneChoice("keyed"), SceneChoice("coarse", hand="parallel")):
        assert not isinstance(open_sensor(None, other, doubting=True).model, DoubtedSensorModel | VariedBodyModel)


def test_a_described_pad_in_place_of_a_sensor_is_named_with_the_option_that_takes_it():
    with pytest.raises(InvalidArgument, match=r"give it as --pad mine\.toml"):
        open_sensor(Path("mine.toml"), SceneChoice("coarse"))


def test_all_doubts_are_asked_for_unless_some_are_or_none():
    asked = {"unknown_state": False, "other_proportions": False, "doubting": True}
    assert doubts(False, False, False, False) == asked
    assert doubts(True, False, False, False) == asked | {"doubting": False}
    assert doubts(False, False, True, False) == asked | {"doubting": False, "unknown_state": None}
    with pytest.raises(InvalidArgument, match="leave it out"):
        doubts(True, False, False, True)
