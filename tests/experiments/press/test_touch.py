"""The command that shows presses writes what it says."""

from pathlib import Path

import pandas
import pytest
import trimesh
from PIL import Image

from activetouch import SCENES, SHAPES
from activetouch.errors import WrongPress
from activetouch.pressing.trace import Phase
from activetouch.view import picture
from belief.errors import MissingPackage, UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.press.touch import TouchCommand, press_new_object, write_presses
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


def test_a_log_is_written_for_every_object(tmp_path):
    write_presses(SCENES["paper"].scene, 0, tmp_path, num_cycles=2)
    assert {path.stem for path in tmp_path.iterdir()} == set(SHAPES)
    for path in tmp_path.iterdir():
        table = pandas.read_csv(path)
        assert set(table["phase"]) == {phase.value for phase in Phase}
        assert table["cycle"].nunique() == 2
        assert table["fx"].max() > 0.3


def test_the_same_seed_presses_the_same_object():
    scene = SceneChoice(fidelity="quasistatic").named.scene
    first, second = (press_new_object(scene, "cube", "z45", 5)[1] for _ in range(2))
    assert first.pressure.tobytes() == second.pressure.tobytes()


@pytest.mark.parametrize(("shape", "pose", "meant"), [("cones", "front", "'cone'"), ("cone", "z54", "'z45'")])
def test_an_unknown_shape_or_pose_suggests_the_nearest(shape, pose, meant):
    with pytest.raises(UnknownName, match=f"Did you mean {meant}"):
        press_new_object(SceneChoice().named.scene, shape, pose, 0)


def test_the_viewer_says_what_it_lacks(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(MissingPackage, match=r"\[viewer\]'|no display"):
        TouchCommand(view=Path("window")).run()
    with pytest.raises(WrongPress, match="nothing moves"):
        TouchCommand(SceneChoice(fidelity="quasistatic"), view=Path("window")).run()


def test_a_log_of_another_press_than_the_papers_is_refused(tmp_path):
    with pytest.raises(WrongPress, match="use the scene 'paper'"):
        TouchCommand(csv=tmp_path).run()


def test_two_outputs_at_once_are_refused(tmp_path):
    with pytest.raises(BadArgument, match="--all, --view and --csv"):
        TouchCommand(all=True, csv=tmp_path).run()


def test_a_grasp_and_its_motion_are_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr(picture, "_FRAME", (32, 24))
    choice = SceneChoice("coarse", hand="parallel")
    TouchCommand(choice, shape="cube", out=tmp_path / "grasp.png").run()
    TouchCommand(choice, shape="cube", view=tmp_path / "grasp.gif").run()
    with Image.open(tmp_path / "grasp.png") as still, Image.open(tmp_path / "grasp.gif") as motion:
        assert len(still.convert("RGB").getcolors(maxcolors=10**7)) > 500
        assert 20 < motion.n_frames <= 60
    for wrong in ({"all": True}, {"csv": tmp_path}, {"view": Path("window")}):
        with pytest.raises(BadArgument, match="--hand draws a grasp"):
            TouchCommand(choice, **wrong).run()
    with pytest.raises(BadArgument, match="add --hand allegro"):
        TouchCommand(choice, menagerie=tmp_path).run()
    with pytest.raises(FileNotFoundError, match="copy of MuJoCo Menagerie"):
        TouchCommand(SceneChoice("coarse", hand="allegro"), menagerie=tmp_path).run()
