"""Every row of the table "Added in exactly one place" in CONTRIBUTING.md holds: a part that is added there works."""

import re
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import get_args

import numpy as np
import pytest

import experiments.scene_choice
import experiments.sensor.train
from activetouch import POSES, SCENES, SHAPES, Quasistatic, Scene
from activetouch.orientations import Upright
from activetouch.perception import backbones
from activetouch.perception.backbones import BACKBONES, SmallCNN
from activetouch.rendering import RENDERERS, PressureRenderer, read_out
from activetouch.solids.primitives import Sphere
from belief.calibration import TemperatureScaling
from belief.observation_model import ConfusionModel, OutcomeTable
from belief.observation_model import registry as models
from experiments.cli import commands
from experiments.robustness import conditions
from experiments.scene_choice import FIDELITIES, PRESENTATIONS, SceneChoice
from planners import DECIDERS, make_decider
from planners.stopping import RandomConfirm

ROOT = Path(__file__).parent.parent


@pytest.fixture
def add(monkeypatch):
    """Adds a line to a registry."""

    def add(module, name, **parts):
        monkeypatch.setattr(module, name, MappingProxyType({**getattr(module, name), **parts}))

    return add


def shape(add):
    scene = Scene(shapes={**SHAPES, "ball": Sphere(0.01)}, press_model=Quasistatic())
    rng = np.random.default_rng(0)
    assert scene.shape_labels[-1] == "ball"
    assert scene.press(scene.sample_object("ball", rng), 0, rng).contact.force > 0.0


def pose(add):
    scene = Scene(poses={**POSES, "tilted": POSES["y45"]})
    assert scene.pose_labels[-1] == "tilted"


def renderer(add):
    add(experiments.scene_choice, "RENDERERS", mine=PressureRenderer(binning=4))
    assert SceneChoice(renderer="mine").named.scene.image_shape == (32, 32)


def fault(add):
    def black(image, rng):
        return np.zeros_like(image)

    assert not read_out(np.full((4, 4), 0.5), (black,), np.random.default_rng(0)).any()


def presentation(add):
    add(experiments.scene_choice, "PRESENTATIONS", mine=Upright())
    assert SceneChoice(presentation="mine").named.scene.presentation == Upright()
    assert get_args(experiments.scene_choice.PresentationName) == tuple(PRESENTATIONS)


def way_to_press(add):
    add(experiments.scene_choice, "FIDELITIES", mine=Quasistatic())
    assert SceneChoice(fidelity="mine").named.scene.press_model == Quasistatic()
    assert get_args(experiments.scene_choice.FidelityName) == tuple(FIDELITIES)


def backbone(add):
    add(backbones, "BACKBONES", mine=SmallCNN((4, 8)))
    assert backbones.BACKBONES["mine"].num_features == 8
    assert get_args(experiments.sensor.train.BackboneName) == tuple(BACKBONES)


def condition(add):
    add(conditions, "CONDITIONS", mine=lambda scene: scene)
    assert "mine" in conditions.CONDITIONS


def named_scene(add):
    add(experiments.scene_choice, "SCENES", mine=SCENES["coarse"])
    assert SceneChoice("mine").named is not None
    assert SceneChoice("mine").named.input_size == SCENES["coarse"].input_size


def decider(add):
    import planners.registry

    add(planners.registry, "DECIDERS", mine=RandomConfirm)
    assert isinstance(make_decider("mine", OutcomeTable(np.full((1, 2, 2), 0.5))), RandomConfirm)


@dataclass(frozen=True, eq=False)
class Mine(ConfusionModel):
    """A model whose files bear a name of their own."""

    name = "mine"


def observation_model(add):
    from belief.observation_model import read_observation_model

    add(models, "OBSERVATION_MODELS", mine=Mine)
    assert models.fit_named("mine").__self__ is Mine
    made = Mine(("a", "b"), np.full((1, 2, 2), 0.5), TemperatureScaling())
    assert isinstance(read_observation_model(made.to_json()), Mine)


def command(add):
    for kind in commands().values():
        assert is_dataclass(kind)
        assert callable(kind.run)


ROWS = {
    "shape": shape,
    "pose": pose,
    "renderer": renderer,
    "fault": fault,
    "presentation": presentation,
    "way to press": way_to_press,
    "backbone": backbone,
    "condition of the robustness report": condition,
    "named scene": named_scene,
    "decider": decider,
    "observation model": observation_model,
    "command": command,
}


def test_every_row_of_the_table_is_tried():
    table = (ROOT / "CONTRIBUTING.md").read_text().split("## Added in exactly one place")[1].split("##")[0]
    rows = [row.split("|")[1].strip() for row in table.splitlines() if row.startswith("|")]
    assert rows[2:] == list(ROWS)
    for path in re.findall(r"`([\w/]+\.py|[\w/]+/)`", table):
        assert (ROOT / path).exists(), path


@pytest.mark.parametrize("name", ROWS)
def test_what_is_added_in_the_place_that_the_table_names_works(name, add):
    ROWS[name](add)


@pytest.mark.parametrize(
    "names", [RENDERERS, DECIDERS, models.OBSERVATION_MODELS], ids=["renderers", "deciders", "models"]
)
def test_a_registry_cannot_be_changed_by_accident(names):
    with pytest.raises(TypeError):
        names["mine"] = None
