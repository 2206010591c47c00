"""The command that shows presses writes what it says."""

import csv
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from PIL import Image

from activetouch.pressing.contact import Phase
from activetouch.view import picture
from belief.errors import UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.press.touch import LOG_COLUMNS, TouchCommand, press_new_object
from experiments.scene_choice import SceneChoice

pytestmark = pytest.mark.mujoco


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
        assert set(phases[own]) <= set(Phase)
        np.testing.assert_allclose(np.diff(columns["time"][own]), 0.002, rtol=1e-6)
        assert columns["fx"][own & (phases == "pause")][-1] > 0.2
        assert columns["fx"][own][0] == 0.0
    model = choice.named.scene.press_model.with_trace()
    placement, contact = press_new_object(replace(choice.named.scene, press_model=model), "cone", "front", 0)
    first = columns["press"] == 0
    np.testing.assert_allclose(columns["x"][first], contact.trace.position[:, 0], rtol=1e-6)
    np.testing.assert_allclose(
        [columns[name][0] for name in ("qw", "qx", "qy", "qz")], placement.orientation, atol=1e-6
    )
    assert len(np.unique(columns["qw"])) == 3  # turned between presses


def test_a_grasp_and_its_motion_are_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr(picture, "_FRAME", (32, 24))
    choice = SceneChoice("coarse", hand="parallel")
    TouchCommand(choice, shape="cube", out=tmp_path / "grasp.png").run()
    TouchCommand(choice, shape="cube", view=tmp_path / "grasp.gif").run()
    with Image.open(tmp_path / "grasp.png") as still, Image.open(tmp_path / "grasp.gif") as motion:
        assert len(still.convert("RGB").getcolors(maxcolors=10**7)) > 500
        assert 20 < motion.n_frames <= 60
    with pytest.raises(BadArgument, match="--hand draws a grasp"):
        TouchCommand(choice, all=True).run()
    with pytest.raises(BadArgument, match="add --hand allegro"):
        TouchCommand(choice, menagerie=tmp_path).run()
    with pytest.raises(FileNotFoundError, match="copy of MuJoCo Menagerie"):
        TouchCommand(SceneChoice("coarse", hand="allegro"), menagerie=tmp_path).run()
