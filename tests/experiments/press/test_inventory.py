"""What a scene models is counted in the compiled model, and less or more is one step away."""

import pytest

from activetouch import SCENES, Quasistatic, Scene
from activetouch.pressing.rig import build_spec
from activetouch.pressing.setup import Setup
from experiments.press.inventory import inventory, leaner, richer
from experiments.press.step_counter import press_cost

pytestmark = pytest.mark.mujoco


def numbers(scene):
    return {entry.part: entry.number for entry in inventory(scene)}


def test_the_default_scene_models_a_pad_an_object_and_nothing_else():
    modelled = numbers(Scene())
    assert modelled["moving bodies"] == 2
    assert modelled["slide joint"] == modelled["contact pair"] == modelled["actuator"] == 1
    assert not modelled.keys() & {"sensor", "finger segments", "parked objects"}


def test_the_paper_scene_adds_finger_parking_and_a_sensor_but_no_contact_pair():
    modelled = numbers(SCENES["paper"].scene)
    assert (modelled["finger segments"], modelled["parked objects"], modelled["sensor"]) == (2, 3, 1)
    assert modelled["contact pair"] == 1


def test_without_time_stepping_there_are_no_bodies():
    assert "moving bodies" not in numbers(Scene(press_model=Quasistatic()))


def test_leaner_and_leaner_ends_without_physics_and_richer_and_richer_with_all_objects():
    scene, changes = SCENES["paper"].scene, []
    while (found := leaner(scene)) is not None:
        changes.append(found[0])
        scene = found[1]
    assert isinstance(scene.press_model, Quasistatic)
    assert scene.setup == Setup(height=scene.height)
    assert len(changes) == 3
    while (found := richer(scene)) is not None:
        scene = found[1]
    assert scene.press_model.traced
    assert scene.parking


def test_parked_objects_and_the_finger_add_no_motion_and_no_contact():
    bare, loaded = (
        build_spec(setup, Scene().shapes["cone"], 0.002).compile()
        for setup in (Setup(), Setup(finger=True, loaded=tuple(Scene().shapes.values())))
    )
    assert loaded.ngeom == bare.ngeom + 5
    for count in ("nbody", "nv", "nu", "npair"):
        assert getattr(loaded, count) == getattr(bare, count)


@pytest.mark.slow
def test_the_leanest_scene_never_loads_mujoco():
    cost = press_cost(Scene(press_model=Quasistatic()), 8)
    assert "mujoco" not in cost.imports
    assert "torch" not in cost.imports
    assert cost.num_steps == 0
    assert press_cost(Scene(), 8).memory > cost.memory


@pytest.mark.slow
@pytest.mark.mujoco
def test_the_steps_of_a_press_are_counted_and_timed():
    cost = press_cost(Scene(), 8)
    assert cost.num_steps > 10
    assert min(cost.step, cost.press) > 0.0  # no more than that, because other programs may run
