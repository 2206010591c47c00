import json
import warnings
from dataclasses import replace
from pathlib import Path

import pytest

from activetouch import Dynamic, Quasistatic
from activetouch.distributions import Constant, Uniform
from activetouch.errors import DuplicateShape
from activetouch.named_scenes import SCENES
from activetouch.orientations import Upright
from activetouch.pressing.dynamic import GuardedMove
from activetouch.rendering import GelSightRenderer, PressureRenderer
from belief.errors import InvalidArgument, UnknownName
from belief.references import BadReference
from experiments.command_line.arguments import Trust
from experiments.command_line.console import plain_warnings
from experiments.scene_choice import SceneChoice, choice_name, renderer_named
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.sensor.collect import Collect, PlanArguments

MENAGERIE = Path(__file__).parents[1] / "fixtures" / "menagerie"
TETRAHEDRON = "v 0 0 0\nv 30 0 0\nv 0 30 0\nv 0 0 30\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def mesh(tmp_path):
    path = tmp_path / "pebble.obj"
    path.write_text(TETRAHEDRON)
    return path


@pytest.mark.parametrize("name", list(SCENES))
def test_a_name_alone_gives_the_named_scene(name):
    assert repr(SceneChoice(scene=name).named) == repr(SCENES[name])


def test_parts_of_a_scene_can_be_changed_by_name():
    scene = SceneChoice(fidelity="quasistatic", renderer="gelsight", presentation="upright").named.scene
    assert scene.press_model == Quasistatic()
    assert scene.renderer == GelSightRenderer()
    assert isinstance(scene.presentation, Upright)
    assert SceneChoice(scene="paper").named.scene.press_model == GuardedMove()
    assert SceneChoice(scene="paper", fidelity="dynamic").named.scene.press_model == Dynamic()


def test_a_mesh_adds_a_shape_called_like_its_file(mesh):
    named = SceneChoice(meshes=(Path(f"{mesh}@0.001"),)).named
    assert named.scene.shape_labels == ("sphere", "cube", "cylinder", "cone", "pebble")
    assert named.scene.shapes["pebble"].bounding_radius == pytest.approx(0.0252, abs=1e-3)


def test_two_shapes_of_one_name_are_refused(mesh):
    with pytest.raises(DuplicateShape, match="must have other names"):
        _ = SceneChoice(meshes=(Path(f"{mesh}@0.001"),) * 2).named
    cone = mesh.rename(mesh.with_name("cone.obj"))
    with pytest.raises(DuplicateShape, match="sphere, cube, cylinder, cone"):
        _ = SceneChoice(meshes=(Path(f"{cone}@0.001"),)).named


def test_an_unknown_scene_suggests_the_nearest():
    with pytest.raises(UnknownName, match="Did you mean 'coarse'"):
        _ = SceneChoice(scene="course").named


def test_a_choice_survives_the_way_through_a_run_file(mesh):
    choice = SceneChoice(scene="hard", fidelity="dynamic", meshes=(Path(f"{mesh}@0.001"),))
    assert SceneChoice.from_dict(choice.to_dict(), Trust(Path("run.json"))) == choice


def test_settings_of_a_renderer_that_is_ready_are_refused_rather_than_ignored():
    with pytest.raises(BadReference, match="pressure is a PressureRenderer and takes no settings"):
        renderer_named("pressure(binning=2)")
    assert renderer_named("activetouch.rendering:PressureRenderer(binning=2)") == PressureRenderer(2)


def test_only_the_meshes_are_left_and_their_sizes_do_not_vary_unless_asked(mesh):
    choice = SceneChoice(scene="many", meshes=(Path(f"{mesh}@0.001"), Path(f"big={mesh}@0.0015")), only=True)
    named = choice.named
    assert named.scene.shape_labels == ("pebble", "big")
    assert named.scene.variation.size == Constant(1.0)
    assert named.scene.variation.force == SCENES["many"].scene.variation.force
    assert named.num_objects == 2
    varied = replace(choice, family=("size=0.9..1.2",))
    assert varied.named.scene.variation.size == Uniform(0.9, 1.2)
    for one in (choice, varied):
        plain = json.loads(json.dumps(one.to_dict()))
        assert SceneChoice.from_dict(plain, Trust(Path("run.json"))) == one


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"only": True}, "--only leaves out the scene's own shapes; give others with --meshes"),
        ({"family": ("size=1.1..0.9",)}, "size=LOW..HIGH, got 'size=1.1..0.9'"),
    ],
)
def test_a_choice_that_makes_no_scene_is_refused(changes, words):
    with pytest.raises(InvalidArgument, match=words):
        _ = SceneChoice(**changes).named


def test_a_file_called_like_a_shape_is_told_how_to_be_called_otherwise(mesh):
    cube = mesh.rename(mesh.with_name("cube.obj"))
    with pytest.raises(DuplicateShape, match=r"my_cube=cube\.obj, or leave the scene's own shapes out with --only"):
        _ = SceneChoice(meshes=(Path(f"{cube}@0.001"),)).named
    assert SceneChoice(meshes=(Path(f"{cube}@0.001"),), only=True).named.scene.shape_labels == ("cube",)
    assert "my_cube" in SceneChoice(meshes=(Path(f"my_cube={cube}@0.001"),)).named.scene.shape_labels


def test_the_command_prints_a_warning_of_its_own_as_one_line(mesh, capsys):
    with warnings.catch_warnings(record=True) as others:
        warnings.simplefilter("always")
        with plain_warnings():
            _ = SceneChoice(meshes=(mesh,)).named
            warnings.warn("of another library", UserWarning, stacklevel=1)
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith("warning: pebble.obj: read in millimetres (30 × 30 × 30 mm)")
    assert [str(other.message) for other in others] == ["of another library"]


def test_the_whole_world_of_the_paper_is_chosen_by_name_and_keeps_the_way_through_a_run_file():
    choice = SceneChoice("coarse", full=True, robot="panda_allegro", menagerie=MENAGERIE)
    assert SceneChoice.from_dict(json.loads(json.dumps(choice.to_dict())), Trust(Path("run.json"))) == choice
    around = choice.named.scene.press_model.surroundings
    assert len(around.parked) == 4
    assert around.menagerie == MENAGERIE
    assert SceneChoice("coarse", full=True).named.scene.press_model.surroundings.menagerie is None
    assert choice_name(choice) == choice_name(SceneChoice("coarse"))  # the same touches, in the same folders
    for wrong in (SceneChoice(robot="panda_allegro"), SceneChoice(menagerie=MENAGERIE)):
        with pytest.raises(InvalidArgument, match="go together"):
            _ = wrong.named


@pytest.mark.mujoco
@pytest.mark.torch
def test_a_comparison_and_a_collection_in_the_whole_world_have_the_same_bytes(tmp_path):
    choices = {"lean": SceneChoice("coarse"), "full": SceneChoice("coarse", None, full=True, robot="panda_allegro")}
    choices["full"] = replace(choices["full"], menagerie=MENAGERIE)
    for name, choice in choices.items():
        Compare(deciders=("fixed_poses",), episodes=1, setting=Setting(choice), out=tmp_path / name, jobs=1).play()
        plan = PlanArguments(train=0, calibration=1, test=0)
        Collect(choice, out=tmp_path / f"{name}-touches", plan=plan, jobs=1).run()
    one, other = ((tmp_path / name / "episodes.jsonl").read_bytes() for name in choices)
    assert one == other
    shards = [sorted((tmp_path / f"{name}-touches").rglob("*.npz")) for name in choices]
    assert [len(files) for files in shards] == [1, 1]
    assert shards[0][0].read_bytes() == shards[1][0].read_bytes()
    Collect(choices["full"], out=tmp_path / "lean-touches", plan=plan, jobs=1).run()  # it is complete
