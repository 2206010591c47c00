"""Finger, parked objects and robot are simulated, stand where they should, and change no bit of a touch."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from activetouch import SCENES
from activetouch.poses import Placement
from activetouch.pressing.contact import Pad, Quasistatic
from activetouch.pressing.dynamic import Dynamic
from activetouch.pressing.rig import Rig
from activetouch.pressing.surroundings import Surroundings
from activetouch.scene_description import require_scene, scene_fields
from activetouch.shapes import EXTENDED_SHAPES
from belief.errors import InvalidArgument

pytestmark = pytest.mark.mujoco
MENAGERIE = Path(__file__).parents[2] / "fixtures" / "menagerie"
PAPER = SCENES["paper"].scene
TRACED = replace(PAPER, pad=Pad(num_taxels=32), press_model=Dynamic(traced=True))
HOLLOW = replace(TRACED, shapes={name: EXTENDED_SHAPES[name] for name in ("torus", "cube")})
WORLDS = {"full": (True, None), "robot": (False, MENAGERIE), "both": (True, MENAGERIE)}


def felt(scene, number):
    """All that touches of a scene hold, as bytes."""
    rng, found = np.random.default_rng(5), []
    for index in range(number):
        thing = scene.sample_object(index % len(scene.shapes), rng)
        contact, image, *_ = scene.press(thing, index % 6, rng)
        arrays = image, contact.pressure, contact.gap, *(getattr(contact.trace, name) for name in ("force", "position"))
        found += [array.tobytes() for array in arrays]
    return found


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("scene", [PAPER, TRACED, HOLLOW], ids=["paper", "dynamic", "hollow"])
def test_touches_are_the_same_to_the_last_bit(world, scene):
    full = scene.with_surroundings(*WORLDS[world])
    assert felt(full, 8) == felt(scene, 8)
    assert full != scene
    assert require_scene("the sensor", scene_fields(scene), scene_fields(full)) == ()


def rig_of(scene, shape="cube"):
    """The model of a press of a shape, which waits in front of the pad."""
    solid = scene.solids[shape]
    rig = Rig(scene.pad, solid.geom, 0.002, around=scene.around(solid))
    rig.place(0.05, Placement(solid, 1.0, np.array([1.0, 0.0, 0.0, 0.0])))
    mujoco.mj_forward(rig.model, rig.data)
    return rig


def test_the_finger_stands_on_the_table_behind_the_pad_and_the_others_are_parked_on_their_guides():
    rig = rig_of(PAPER.with_surroundings())
    geoms = [rig.model.geom(number) for number in range(rig.model.ngeom)]
    tip, base = [geom for geom in geoms if geom.type == mujoco.mjtGeom.mjGEOM_BOX and not geom.name]
    pad, table = rig.model.geom("pad"), rig.model.geom("table")
    assert tip.pos[0] + tip.size[0] == pytest.approx(pad.pos[0] - pad.size[0])
    assert base.pos[0] + base.size[0] == pytest.approx(tip.pos[0] - tip.size[0])
    assert base.pos[2] - base.size[2] == pytest.approx(table.pos[2]) == -0.07
    parked = [geom.name for geom in geoms if geom.name.startswith("parked")]
    assert parked == ["parked0", "parked2", "parked3"]
    assert rig.model.njnt == rig.model.nu == 4
    assert rig.data.geom("parked0").xpos[1] > 0.2


def test_the_hand_is_behind_the_pad_and_its_servos_hold_it_there():
    rig = rig_of(PAPER.with_surroundings(False, MENAGERIE))
    np.testing.assert_allclose(rig.data.body("robot_hand_mf_tip").xpos[1:], 0.0, atol=1e-9)
    ends = [rig.data.geom(g).xpos[0] for g in range(rig.model.ngeom) if rig.model.geom(g).bodyid > 2]
    assert max(ends) < -2 * PAPER.pad.half_thickness
    before = rig.data.qpos.copy()
    for _ in range(200):
        mujoco.mj_step(rig.model, rig.data)
    np.testing.assert_allclose(rig.data.qpos, before, atol=1e-9)
    assert rig.model.nu == rig.model.njnt == 24
    assert rig.data.ncon == 0


def test_the_arm_brings_the_hand_by_its_servos():
    scene = PAPER.with_surroundings(True, MENAGERIE)
    rig = rig_of(scene)
    states = np.array(scene.around(scene.solids["cube"]).arrival(rig))
    away = np.abs(states - rig.data.qpos).max(axis=1)
    assert away[0] > 0.5
    assert away[-1] < 1e-3
    assert np.abs(np.diff(states, axis=0)).max() < 0.05  # it moves, and does not jump
    np.testing.assert_array_equal(np.ptp(states[:, :4], axis=0), 0.0)  # the objects wait
    assert Surroundings().arrival(rig) == []


def test_what_is_missing_or_cannot_be_simulated_is_said_at_once(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"panda_nohand.xml does not exist; give a copy of MuJoCo Menagerie"):
        PAPER.with_surroundings(True, tmp_path)
    for scene in (replace(PAPER, press_model=Quasistatic()), SCENES["gel"].scene.with_hand("parallel")):
        with pytest.raises(InvalidArgument, match="--fidelity dynamic or guarded_move"):
            scene.with_surroundings()
    for name in ("franka_emika_panda/panda_nohand.xml", "wonik_allegro/right_hand.xml"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text('<mujoco><worldbody><body name="palm"/></worldbody></mujoco>')
    scene = PAPER.with_surroundings(True, tmp_path)
    with pytest.raises(InvalidArgument, match="other models than those of the Panda arm"):
        rig_of(scene)
