"""Explain names the hardest pairs, and what the belief about an object holds hidden in each presentation."""

from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from activetouch import SCENES
from activetouch.distributions import Constant
from activetouch.orientations import Inexact, Resampled, Tumbled, Upright
from activetouch.sensor_files import MODELS
from belief.observation_model import OutcomeTable
from experiments.press import explain
from experiments.press.alike import Alike
from experiments.press.belief_table import belief_table, latent
from experiments.press.explain import Explain, limits_table
from experiments.press.step_counter import Cost
from experiments.scene_choice import SceneChoice


def test_explain_shows_the_hardest_pairs_first_and_names_those_beyond_telling():
    rows = [[0.9, 0.05, 0.05], [0.1, 0.8, 0.1], [0.1, 0.8, 0.1], [0.2, 0.2, 0.6]]
    console = Console(width=100, record=True)
    console.print(limits_table(OutcomeTable([rows]), ("sphere", "cube", "box", "cone")).rich())
    text = console.export_text()
    body = [line.split() for line in text.splitlines() if "sphere" in line or "cube" in line]
    assert body[0][:5] == ["cube", "box", "inf", "inf", "0.00"]
    assert "distinguishes: cube and box" in " ".join(text.split())


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
    scene = replace(SCENES["coarse"].scene, presentation=presentation)
    assert latent(scene) == words
    fixed = replace(scene, variation=replace(scene.variation, size=Constant(1.0)))
    assert latent(fixed) == [word for word in words if word != "size"]
    text = belief_table("coarse", scene, None).markdown()
    assert ("independent model is exact here" in text) == (not words)
    assert "No shipped sensor with a joint model" in text


def test_the_joint_belief_costs_more_than_the_independent_one_and_both_are_measured():
    scene = SCENES["coarse"].scene
    table = belief_table("coarse", scene, MODELS / "coarse")
    joint, independent = (row[2:] for row in table.rows)
    assert (joint[0], independent[0]) == (2048, None)
    assert joint[1] > 12.5  # the table: 6 poses, 4 shapes, 2 048 hypotheses, 64 numbers of 4 bytes
    assert 0.0 < independent[1] < joint[1]
    assert 0.0 < independent[2] < joint[2]


@pytest.mark.parametrize(
    ("change", "fits"),
    [
        ({}, True),
        ({"fidelity": "quasistatic"}, True),
        ({"renderer": "gelsight"}, False),
        ({"poses": "directions26"}, False),
        ({"meshes": (Path("pebble.off"),)}, False),
    ],
)
def test_explain_measures_only_sensors_that_fit_the_scene(change, fits, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    corners = "0 0 0\n.03 0 0\n0 .03 0\n0 0 .03"
    Path("pebble.off").write_text(f"OFF\n4 4 0\n{corners}\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n")
    monkeypatch.setattr(explain, "press_cost", lambda scene, presses: Cost(0.0, 0.0, 0.0, 0.0, 0.0, ()))
    Explain(SceneChoice("coarse", **change), presses=1, alike=False).run()
    text = " ".join(capsys.readouterr().out.split())
    assert ("lower bounds on the touches" in text) == fits
    assert ("No shipped sensor with a joint model" in text) != fits
    assert "what a press costs" in text
    assert "layer bottoms out" in text
    assert "feel most alike" not in text


def test_explain_compares_the_shapes_and_says_where_their_touches_land(monkeypatch, capsys):
    monkeypatch.setattr(explain, "press_cost", lambda scene, presses: Cost(0.0, 0.0, 0.0, 0.0, 0.0, ()))
    known = Alike((), dict.fromkeys(SCENES["coarse"].scene.shapes, (0.7, 0.3)), 6)
    monkeypatch.setattr(explain, "compare_shapes", lambda scene, jobs: known)
    Explain(SceneChoice("coarse"), presses=1).run()
    text = " ".join(capsys.readouterr().out.split())
    assert "feel most alike" in text
    assert "70%" in text


def test_a_sensor_without_an_independent_model_is_measured_alone():
    table = belief_table("keyed", SCENES["keyed"].scene, MODELS / "keyed")
    assert [row[0] for row in table.rows] == ["joint: one rigid body"]
