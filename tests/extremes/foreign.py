"""Extremes of foreign parts: sensors and collections of other scenes, and deciders and renderers of the user's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from activetouch import Quasistatic, Scene
from activetouch.data.manifest import CollectionPlan
from activetouch.errors import WrongRenderer, WrongScene
from activetouch.pressing.contact import Contact, Pad
from activetouch.rendering import PressureRenderer
from activetouch.sensor import TactileSensor
from activetouch.sensor_files import MODELS, READER_FILE
from belief import Confirm, Probe, SearchProblem, Unsure
from belief.errors import ActiveTouchError
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from experiments.calibration.calibration_report import CalibrationReport
from experiments.ppo.train_ppo import TrainPPO
from experiments.robustness.robustness import Robustness
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.sensor.calibrate import Calibrate
from experiments.sensor.collect import collect
from planners import Decision, search
from planners.decider import BadDecision
from tests.extremes.cases import Case, in_folder, refusals, refuses

_LABELS, _POSES = ("cube", "cone", "sphere"), ("front", "side")
_OTHER = "made for another scene|made for other|knows the shapes|reads images"


@dataclass(frozen=True)
class _Decider:
    """A decider of the user's own that always gives the same answer."""

    answer: Any

    def decide(self, state: object, rng: np.random.Generator) -> Any:
        return self.answer


def _decides(answer: Any) -> Callable[[], object]:
    def searched() -> object:
        rng = np.random.default_rng(0)
        model, problem = random_model(rng, len(_LABELS), len(_POSES)), SearchProblem(_LABELS, _POSES, num_objects=2)
        model = replace(model, shape_labels=_LABELS)
        world = SyntheticWorld(model, sample_arrangement(problem, rng))
        return search(world, _Decider(answer), problem, target=0, model=model, seed=(0,))

    return searched


def _compared(scene: str, sensor: str) -> Callable[[], object]:
    setting = Setting(SceneChoice(scene), sensor=MODELS / sensor)
    compare = Compare(("random_confirm",), targets=("cone",), episodes=1, setting=setting, jobs=1)
    return in_folder(lambda folder: replace(compare, out=folder).play())


def _with_gel(command: Callable[[Path, Path], Any]) -> Callable[[], object]:
    """Run a command for another scene on a small collection of the scene gel."""

    def run(folder: Path) -> object:
        choice = SceneChoice("gel", fidelity="quasistatic")
        collect(choice, CollectionPlan(train=0, calibration=1, test=1, repeats=2), folder / "gel", jobs=1)
        return command(folder / "gel", folder / "out").run()

    return in_folder(run)


def _sensors() -> list[Case]:
    pairs = [(scene, sensor) for scene in ("coarse", "gel", "hard") for sensor in ("coarse", "gel", "many", "paper")]
    gel = MODELS / "gel"
    commands: dict[str, Any] = {
        "robustness": Robustness("coarse", sensor=gel),
    }
    other = SceneChoice("coarse", renderer="gelsight").named.scene
    return [
        *(
            refuses("compare", f"--scene {one} and the sensor of {two}", _compared(one, two), ActiveTouchError, _OTHER)
            for one, two in pairs
            if one != two
        ),
        *(
            refuses(name, "--scene coarse and the sensor of gel", command.run, WrongScene, _OTHER)
            for name, command in commands.items()
        ),
        refuses(
            "TactileSensor.load",
            "images of another renderer",
            lambda: TactileSensor.load(MODELS / "coarse", other),
            ActiveTouchError,
            _OTHER,
        ),
    ]


def _collections() -> list[Case]:
    reader, pattern = MODELS / "coarse" / READER_FILE, "made for another scene"
    commands: dict[str, Callable[[Path, Path], Any]] = {
        "calibrate": lambda data, out: Calibrate("coarse", reader, data, out),
        "calibration-report": lambda data, out: CalibrationReport("coarse", data, out=out),
        "train-ppo": lambda data, out: TrainPPO("coarse", data, out=out, jobs=1),
    }
    return [
        refuses(name, "--scene coarse and a collection of gel", _with_gel(command), ActiveTouchError, pattern)
        for name, command in commands.items()
    ]


def _deciders() -> tuple[Case, ...]:
    answers = {
        "a word": "confirm",
        "nothing": None,
        "a number": 3,
        "a pose that does not exist": Decision(Probe(9)),
        "a decision on a word": Decision("confirm"),
        "that it is unsure, which the search does not have": Decision(Unsure()),
        "a score of NaN": Decision(Confirm(), {"value": float("nan")}),
    }
    cases = {
        f"a user's decider that answers {words}": (_decides(one), "_Decider ans") for words, one in answers.items()
    }
    return refusals("search", BadDecision, cases)


@dataclass(frozen=True)
class _Renderer:
    """A renderer of the user's own that scales and casts the image of another one."""

    scale: float
    kind: str
    isotropic: ClassVar[bool] = True

    def __call__(self, contact: Contact) -> Any:
        return (self.scale * PressureRenderer()(contact)).astype(self.kind)


def _touched(renderer: Any) -> Callable[[], object]:
    def touched() -> object:
        rng = np.random.default_rng(0)
        scene = Scene(renderer=renderer, press_model=Quasistatic(), pad=Pad(num_taxels=8))
        return scene.press(scene.sample_object(0, rng), 0, rng)

    return touched


def _renderers() -> tuple[Case, ...]:
    return refusals(
        "Scene",
        WrongRenderer,
        {
            "a user's renderer that gives uint8": (_touched(_Renderer(255.0, "uint8")), "uint8; divide by 255"),
            "a user's renderer with values up to 255": (_touched(_Renderer(255.0, "float64")), "values from 0"),
            "the name of a renderer instead of an object": (_touched("pressure"), "not the name 'pressure'"),
        },
    )


CASES: tuple[Case, ...] = (*_sensors(), *_collections(), *_deciders(), *_renderers())
"""Cases of foreign parts. Each must be refused before any work, with a message that names the difference."""
