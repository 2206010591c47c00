"""The command that shows presses writes what it says."""

import csv
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image, ImageSequence

from activetouch import view
from activetouch.pressing.contact import Phase
from belief.errors import InvalidArgument, UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.press.touch import LOG_COLUMNS, TouchCommand, press_new_object
from experiments.scene_choice import SceneChoice

pytestmark = [pytest.mark.mujoco, pytest.mark.usefixtures("usual_pictures")]
MENAGERIE = Path(__file__).parents[2] / "fixtures" / "menagerie"


@pytest.mark.parametrize(
    "choice",
    [SceneChoice("coarse", fidelity="quasistatic"), SceneChoice("paper")],
    ids=["quasistatic", "paper"],
)
def test_a_touch_is_drawn_with_its_force_over_time_or_without(choice, tmp_path, capsys):
    path = tmp_path / "touch.png"
    TouchCommand(choice, out=path).run()
    with Image.open(path) as picture:
        assert min(picture.size) > 500
        assert len(picture.convert("RGB").getcolors(maxcolors=10**7)) > 500
    assert f"wrote {path}" in capsys.readouterr().out


def test_the_gallery_shows_every_shape_pose_and_renderer(tmp_path):
    path, mesh = tmp_path / "gallery.png", tmp_path / "box.stl"
    trimesh.creation.box((0.02, 0.03, 0.025)).export(mesh)
    TouchCommand(SceneChoice("coarse", meshes=(mesh,), only=True), all=True, out=path).run()
    with Image.open(path) as picture:
        assert 2 < picture.width / picture.height < 3  # six poses, three renderers


def test_the_same_seed_presses_the_same_object():
    scene = SceneChoice(fidelity="quasistatic").named.scene
    first, second = (press_new_object(scene, "cube", "z45", 5)[1] for _ in range(2))
    assert first.pressure.tobytes() == second.pressure.tobytes()


@pytest.mark.parametrize(("shape", "pose", "meant"), [("cones", "front", "'cone'"), ("cone", "z54", "'z45'")])
def test_an_unknown_shape_or_pose_suggests_the_nearest(shape, pose, meant):
    with pytest.raises(UnknownName, match=f"Did you mean {meant}"):
        press_new_object(SceneChoice().named.scene, shape, pose, 0)


def test_two_outputs_at_once_and_the_motion_of_what_stands_still_are_refused(tmp_path):
    with pytest.raises(BadArgument, match="--all, --view and --csv"):
        TouchCommand(all=True, view=tmp_path / "a.gif").run()
    with pytest.raises(BadArgument, match="nothing moves"):
        TouchCommand(SceneChoice(fidelity="quasistatic"), view=tmp_path / "a.gif").run()
    with pytest.raises(BadArgument, match="nothing moves in a quasistatic press, which has no time"):
        TouchCommand(SceneChoice(fidelity="quasistatic"), csv=tmp_path / "a.csv").run()
    with pytest.raises(BadArgument, match="--presses is the number of presses in a log"):
        TouchCommand(presses=2, out=tmp_path / "a.png").run()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("scene", "fidelity"), [("paper", None), ("coarse", "dynamic")])
def test_a_log_has_every_time_step_of_the_cycles_of_an_object(scene, fidelity, tmp_path):
    choice = SceneChoice(scene, fidelity=fidelity, presentation="resampled")
    TouchCommand(choice, shape="cone", csv=tmp_path / "cone.csv", presses=3).run()
    with (tmp_path / "cone.csv").open() as file:
        rows = list(csv.DictReader(file))
    columns = {name: np.array([float(row[name]) for row in rows]) for name in LOG_COLUMNS if name != "phase"}
    phases = np.array([row["phase"] for row in rows])
    for press in range(3):
        own = columns["press"] == press
        first = [int(np.flatnonzero(own & (phases == phase))[0]) for phase in ("approach", "pause", "withdraw")]
        assert first == sorted(first)
        assert set(phases[own]) <= {*Phase, "rotate"}
        np.testing.assert_allclose(np.diff(columns["time"][own]), 0.002, rtol=1e-6)
        assert columns["fx"][own & (phases == "pause")][-1] > 0.2
        assert columns["fx"][own][0] == 0.0
    model = choice.named.scene.press_model.with_trace()
    placement, contact = press_new_object(replace(choice.named.scene, press_model=model), "cone", "front", 0)
    turned = np.stack([columns[name] for name in ("qw", "qx", "qy", "qz")], axis=1)
    for press in range(2):  # between presses, the object turns to the orientation of the next in the paper's cycle
        rotation = turned[(columns["press"] == press) & (phases == "rotate")]
        assert len(rotation) == (100 if scene == "paper" else 0)
        if len(rotation):
            np.testing.assert_allclose(abs(rotation[-1] @ turned[columns["press"] == press + 1][0]), 1.0, atol=1e-5)
            steps = np.abs((rotation[1:] * rotation[:-1]).sum(axis=1))
            assert steps.min() > np.cos(np.pi / 2 / 99)  # at most half a turn
    assert "rotate" not in phases[columns["press"] == 2]
    columns = {name: column[phases != "rotate"] for name, column in columns.items()}
    first = columns["press"] == 0
    np.testing.assert_allclose(columns["x"][first], contact.trace.position[:, 0], rtol=1e-6)
    np.testing.assert_allclose(
        [columns[name][0] for name in ("qw", "qx", "qy", "qz")], placement.orientation, atol=1e-6
    )
    assert len(np.unique(columns["qw"])) == 3  # turned between presses


def test_a_grasp_and_its_motion_are_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr(view, "_FRAME", (32, 24))
    choice = SceneChoice("coarse", hand="parallel")
    TouchCommand(choice, shape="cube", out=tmp_path / "grasp.png").run()
    TouchCommand(choice, shape="cube", view=tmp_path / "grasp.gif").run()
    with Image.open(tmp_path / "grasp.png") as still, Image.open(tmp_path / "grasp.gif") as motion:
        assert len(still.convert("RGB").getcolors(maxcolors=10**7)) > 500
        assert 20 < motion.n_frames <= 60
    with pytest.raises(BadArgument, match="--hand draws a grasp"):
        TouchCommand(choice, all=True).run()
    with pytest.raises(InvalidArgument, match="--robot panda_allegro and --menagerie"):
        TouchCommand(SceneChoice("coarse", hand="parallel", menagerie=tmp_path)).run()
    with pytest.raises(FileNotFoundError, match="copy of MuJoCo Menagerie"):
        TouchCommand(SceneChoice("coarse", hand="allegro", menagerie=tmp_path)).run()


def test_the_whole_world_of_the_paper_is_drawn_and_its_arm_brings_the_hand(tmp_path, monkeypatch):
    monkeypatch.setattr(view, "_FRAME", (32, 24))
    full = SceneChoice("paper", full=True, robot="panda_allegro", menagerie=MENAGERIE)
    TouchCommand(full, view=tmp_path / "full.gif").run()
    with Image.open(tmp_path / "full.gif") as motion:
        frames = [np.asarray(frame.convert("RGB"), float) for frame in ImageSequence.Iterator(motion)]
    moved = np.array([np.abs(one - other).max() for one, other in pairwise(frames)])
    assert np.count_nonzero(moved > 50.0) > 5  # before the press, the arm moves
    TouchCommand(full, out=tmp_path / "full.png").run()
    with Image.open(tmp_path / "full.png") as still:
        assert still.convert("RGB").getcolors(maxcolors=10**7)
    with pytest.raises(InvalidArgument, match="--fidelity dynamic or guarded_move, and no --hand"):
        TouchCommand(replace(full, fidelity="quasistatic")).run()
