from pathlib import Path

import pytest

from activetouch import Dynamic, Quasistatic
from activetouch.errors import DuplicateShape
from activetouch.named_scenes import SCENES
from activetouch.orientations import Upright
from activetouch.pressing.guarded_move import GuardedMove
from activetouch.rendering import GelSightRenderer, PressureRenderer
from belief.errors import UnknownName
from belief.references import BadReference
from experiments.command_line.trust import Trust
from experiments.scene_choice import SceneChoice, renderer_named

TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n30 0 0\n0 30 0\n0 0 30\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


@pytest.fixture
def mesh(tmp_path):
    path = tmp_path / "pebble.off"
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
    named = SceneChoice(meshes=(mesh,), mesh_scale=0.001).named
    assert named.scene.shape_labels == ("sphere", "cube", "cylinder", "cone", "pebble")
    assert named.scene.shapes["pebble"].bounding_radius == pytest.approx(0.0252, abs=1e-3)


def test_two_shapes_of_one_name_are_refused(mesh):
    with pytest.raises(DuplicateShape, match="must have other names"):
        _ = SceneChoice(meshes=(mesh, mesh), mesh_scale=0.001).named
    cone = mesh.rename(mesh.with_name("cone.off"))
    with pytest.raises(DuplicateShape, match="sphere, cube, cylinder, cone"):
        _ = SceneChoice(meshes=(cone,), mesh_scale=0.001).named


def test_an_unknown_scene_suggests_the_nearest():
    with pytest.raises(UnknownName, match="Did you mean 'coarse'"):
        _ = SceneChoice(scene="course").named


def test_a_choice_survives_the_way_through_a_run_file(mesh):
    choice = SceneChoice(scene="hard", fidelity="dynamic", meshes=(mesh,), mesh_scale=0.001)
    assert SceneChoice.from_dict(choice.to_dict(), Trust(Path("run.json"))) == choice


def test_settings_of_a_renderer_that_is_ready_are_refused_rather_than_ignored():
    with pytest.raises(BadReference, match="pressure is a PressureRenderer and takes no settings"):
        renderer_named("pressure(binning=2)")
    assert renderer_named("activetouch.rendering:PressureRenderer(binning=2)") == PressureRenderer(2)
