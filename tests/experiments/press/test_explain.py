"""Explain counts the parts of the model, measures what it costs, and says what touches of a scene show."""

import re
from dataclasses import replace

import pytest

from activetouch import SCENES, PadDescription, Quasistatic, Response, Scene, Taxels
from activetouch.distributions import Constant
from activetouch.named_scenes import NamedScene
from activetouch.orientations import Inexact, Resampled, Tumbled, Upright
from activetouch.shapes import EXTENDED_SHAPES, Box, Sphere, Union
from experiments.meshes.near_twins import NearTwins
from experiments.press import explain
from experiments.press.explain import Explain, inventory, latent
from experiments.scene_choice import SceneChoice

COARSE = SCENES["coarse"]
STILL = replace(COARSE.scene, press_model=Quasistatic())
CROSS = Union((Box((0.02, 0.006, 0.006)), Box((0.006, 0.006, 0.02))))


def numbers(scene):
    return {entry.part: entry.number for entry in inventory(NamedScene(scene, 4, 16))}


@pytest.mark.mujoco
def test_the_default_scene_models_a_pad_an_object_and_nothing_else():
    modelled = numbers(Scene())
    assert modelled["moving bodies"] == 2
    assert modelled["slide joint"] == modelled["contact pair"] == 1
    assert not modelled.keys() & {"sensor", "finger segments", "parked objects"}
    assert "moving bodies" not in numbers(Scene(press_model=Quasistatic()))


@pytest.mark.mujoco
@pytest.mark.parametrize(
    ("shapes", "press", "words"),
    [
        ({"ball": Sphere(0.01)}, None, []),
        ({"cross": CROSS}, None, ["what lies in front of the pad, with the same first touch: cross"]),
        ({"torus": EXTENDED_SHAPES["torus"]}, None, ["the convex hull, so force and image may disagree: torus"]),
        ({"cross": CROSS, "torus": EXTENDED_SHAPES["torus"]}, Quasistatic(), []),
    ],
)
def test_the_inventory_names_shapes_that_are_pressed_as_something_simpler(shapes, press, words):
    scene = replace(COARSE.scene, shapes=shapes)
    scene = scene if press is None else replace(scene, press_model=press)
    found = [item.why for item in inventory(NamedScene(scene, 1, 16)) if item.part == "hollow shapes"]
    assert len(found) == len(words)
    assert all(why.endswith(end) for why, end in zip(found, words, strict=True))


@pytest.mark.parametrize(
    ("presentation", "words"),
    [
        (Tumbled(), ["orientation", "size"]),
        (Inexact(), ["orientation", "size"]),
        (Upright(), ["heading", "tilt", "size"]),
        (Resampled(), []),
    ],
)
def test_what_is_hidden_follows_from_the_presentation(presentation, words):
    scene = replace(COARSE.scene, presentation=presentation)
    assert latent(scene) == words
    fixed = replace(scene, variation=replace(scene.variation, size=Constant(1.0)))
    assert latent(fixed) == [word for word in words if word != "size"]


def test_the_time_of_a_press_is_measured_without_its_image():
    press, image = map(float, re.findall(r"[\d.]+(?= ms)", explain._cost_words(STILL, 8)))
    assert min(press, image) > 0.0


def test_explain_says_what_the_belief_holds_and_what_a_press_costs(capsys):
    Explain(SceneChoice("coarse"), presses=1, alike=False).run()
    text = " ".join(capsys.readouterr().out.split())
    assert "holds its shape, orientation, size." in text
    assert "A press takes" in text
    assert "feel nearly alike" not in text


def test_explain_names_shapes_that_feel_nearly_alike(monkeypatch, capsys):
    twins = [NearTwins("cube", "cone", 0.5)]
    monkeypatch.setattr(explain, "near_twins", lambda model: twins)
    monkeypatch.setattr(explain, "sensor_of", lambda solids, sensor, plan, jobs: None)
    monkeypatch.setattr(explain, "model_of", lambda sensor: None)
    Explain(SceneChoice("coarse"), presses=1).run()
    printed = capsys.readouterr().out
    text = " ".join(printed.split())
    for words in ("contact pair", "ms on one core", "a touch favours the true one 1.65 times (0.50 nats)."):
        assert words in text
    assert len(printed.splitlines()) < 45
    twins.clear()
    [_, none] = explain._alike_words(COARSE.scene, "coarse", None, 1)
    assert none.endswith(
        "from 26 directions, a touch favours the true one 2.2 times or more against any other (0.8 nats)."
    )
    assert "no sensor that reads any object" in explain._alike_words(COARSE.scene, "paper", None, 1)[0]


@pytest.mark.parametrize("name", ["coarse", "gel", "hard"])
def test_shapes_are_compared_by_the_reader_of_the_scene_alone(name, monkeypatch):
    for part in ("near_twins", "sensor_of", "model_of"):
        monkeypatch.setattr(explain, part, lambda *given, **named: [])
    scene = SCENES[name].scene
    where, found = explain._alike_words(scene, name, None, 1)
    assert where.startswith(f"Shapes are compared on the pad of {name}, by its reader")
    assert "feel nearly alike" in found
    [words] = explain._alike_words(SceneChoice(name, hand="parallel").named.scene, name, None, 1)
    assert words == f"Shapes are not compared: the reader of {name} was trained for another hand."


@pytest.mark.nightly  # as on the pads of scenes
def test_shapes_are_compared_on_a_described_pad(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(explain, "_PLAN", replace(explain._PLAN, pressed=8))
    path = tmp_path / "mine.toml"
    known = Response.of({"stiffness": 5e7, "law": 1.0})
    PadDescription(Taxels.grid(4, 4, 0.005), known, is_relative=True).save(path)
    Explain(SceneChoice(pad=path), presses=2, jobs=1).run()
    said = " ".join(capsys.readouterr().out.split())
    assert "16 taxels" in said
    assert "by the reader of any pad; on another pad, others may feel alike." in said
    assert "feel nearly alike" in said
    assert "activetouch compare searches with this pad" in said
