"""The robot behind the pad: a small one everywhere, the real one where a Menagerie checkout is at hand."""

import os
import pickle
import subprocess
import sys
from dataclasses import replace
from math import pi
from pathlib import Path

import mujoco
import numpy as np
import pytest

from activetouch import SHAPES, Scene
from activetouch.errors import MissingRobot
from activetouch.placement import Placement
from activetouch.pressing.rig import Rig
from activetouch.pressing.robot import ROBOTS, Robot, attach_robot
from activetouch.pressing.setup import Setup
from activetouch.pressing.trace import Phase

pytestmark = pytest.mark.mujoco
BOX, SPHERE = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE
PAD_BACK = -0.014

# An arm that rises 0.5 m and whose two joints bend it to point along +x, and a hand with one finger. As in real models,
# the options differ from a press's, and actuators, a keyframe, an exclusion and a light come along.
ARM = """
<mujoco model="arm">
  <option timestep="0.01" impratio="10" cone="pyramidal"/>
  <worldbody>
    <light pos="0 0 2"/>
    <body name="base">
      <geom type="box" size="0.05 0.05 0.25" pos="0 0 0.25"/>
      <body name="upper" pos="0 0 0.5">
        <joint name="one" axis="0 1 0"/>
        <geom type="box" size="0.02 0.02 0.1" pos="0 0 0.1"/>
        <geom size="0.03" contype="0" conaffinity="0" mass="0"/>
        <body name="lower" pos="0 0 0.2" quat="1 0 0 1">
          <joint name="two" axis="1 0 0"/>
          <geom type="box" size="0.02 0.02 0.1" pos="0 0 0.1"/>
          <site name="attachment_site" pos="0 0 0.2"/>
        </body>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="base" body2="upper"/></contact>
  <actuator><position name="one" joint="one" kp="100"/></actuator>
  <keyframe><key name="home" qpos="1 0" ctrl="1"/></keyframe>
</mujoco>
"""
HAND = """
<mujoco model="hand">
  <option impratio="5"/>
  <worldbody>
    <body name="palm" quat="0 1 0 1">
      <geom type="box" size="0.08 0.08 0.05"/>
      <body name="mf_tip" pos="0 0.01 0.1">
        <joint name="three" axis="0 1 0"/>
        <geom type="capsule" size="0.01 0.01"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="three" joint="three"/></actuator>
</mujoco>
"""


@pytest.fixture
def small(tmp_path) -> Robot:
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "hand.xml").write_text(HAND)
    return Robot("arm.xml", "hand.xml", tmp_path, arm_angles=(pi / 3, pi / 6), hand_angles=(0.0,))


@pytest.fixture
def real() -> Robot:
    if "MENAGERIE_ROOT" not in os.environ:
        pytest.skip("MENAGERIE_ROOT names no checkout of MuJoCo Menagerie")
    return ROBOTS["panda_allegro"]


@pytest.fixture(params=["small", "real"])
def robot(request) -> Robot:
    return request.getfixturevalue(request.param)


def press_spec(offset: float = 0.0) -> mujoco.MjSpec:
    """A pad, and a ball on a guide with a servo."""
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.002
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.worldbody.add_geom(name="pad", type=BOX, size=[0.007, 0.015, 0.015], pos=[-0.007, 0.0, 0.0])
    guide = spec.worldbody.add_body(name="guide")
    guide.add_joint(name="guide", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
    ball = guide.add_body(name="object", pos=[0.0, offset, 0.0])
    ball.add_geom(name="object", type=SPHERE, size=[0.02, 0.0, 0.0], mass=0.5)
    servo = spec.add_actuator(name="guide", target="guide", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_position(kp=20_000.0, dampratio=1.0)
    return spec


def geoms_of_robot(model: mujoco.MjModel) -> list[int]:
    return [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith("robot_")]


def compiled(robot: Robot | None, offset: float = 0.0) -> mujoco.MjModel:
    spec = press_spec(offset)
    if robot is not None:
        attach_robot(spec, robot, (0.0, 0.0, 0.0))
    return spec.compile()


def forces(model: mujoco.MjModel, end: float = 0.018) -> tuple[list[float], set[str], mujoco.MjData]:
    """The push on the guide in every step of 1.2 s, most at ``end``, and which geoms met in it."""
    data = mujoco.MjData(model)
    data.qpos[0] = position = 0.04
    pushes, met = [], set()
    for _ in range(600):
        position = max(position - 0.0004, end)
        data.ctrl[0] = position
        mujoco.mj_step(model, data)
        pushes.append(data.qfrc_constraint[0])
        met |= {model.geom(geom).name for contact in data.contact for geom in contact.geom}
    return pushes, met, data


def test_a_press_does_not_notice_the_robot(robot):
    alone, _, _ = forces(compiled(None))
    beside, met, _ = forces(compiled(robot))
    assert beside == alone
    assert max(alone) > 1.0
    assert met == {"pad", "object"}


@pytest.mark.parametrize("jointed", [False, True], ids=["statue", "jointed"])
def test_a_scene_with_a_robot_feels_the_same_to_the_bit(robot, jointed):
    bare = Scene(finger=True, height=0.07)
    held = replace(bare, robot=replace(robot, jointed=jointed))
    for number in range(24):
        touches = []
        for scene in (bare, held):
            rng = np.random.default_rng(number)
            contact, image, *_ = scene.press(scene.sample_object(number % 4, rng), number % 6, rng)
            touches.append((contact.force, image.tobytes()))
        assert touches[0] == touches[1]


def test_a_jointed_robot_has_its_joints_and_holds_its_pose(robot):
    placement = Placement(SHAPES["cube"], 1.0, np.array([1.0, 0.0, 0.0, 0.0]))
    rig = Rig(Setup(robot=replace(robot, jointed=True)), SHAPES["cube"], 0.002)
    angles = (*robot.arm_angles, *robot.hand_angles)
    assert rig.model.njnt == 1 + len(angles)
    rig.place(0.05, placement)
    for _ in range(200):
        rig.step(0.05, Phase.PAUSE)
    np.testing.assert_allclose(rig.data.qpos[1:], angles, atol=1e-3)


def test_the_robot_stands_still_whatever_is_pressed(robot):
    model = compiled(robot)
    before = mujoco.MjData(model)
    mujoco.mj_forward(model, before)
    _, _, after = forces(model)
    of_robot = geoms_of_robot(model)
    assert len(of_robot) == model.ngeom - 2
    np.testing.assert_array_equal(after.geom_xpos[of_robot], before.geom_xpos[of_robot])
    np.testing.assert_array_equal(after.geom_xmat[of_robot], before.geom_xmat[of_robot])
    assert (model.nq, model.nv, model.nu, model.nkey, model.nlight) == (1, 1, 1, 0, 0)


def test_the_options_of_the_press_stay_as_they_are(robot):
    before, after = compiled(None).opt, compiled(robot).opt
    for name in dir(before):
        if not name.startswith("_") and not callable(getattr(before, name)):
            np.testing.assert_array_equal(getattr(after, name), getattr(before, name), err_msg=name)


def test_pad_guide_and_object_are_found_by_their_names(robot):
    before, after = compiled(None), compiled(robot)
    for name in ("guide", "object"):
        assert after.body(name).id == before.body(name).id
    assert (after.joint("guide").qposadr, after.joint("guide").dofadr, after.actuator("guide").id) == (0, 0, 0)
    for name in ("pad", "object"):
        np.testing.assert_array_equal(after.geom(name).size, before.geom(name).size)


def foremost(model: mujoco.MjModel) -> float:
    """The largest x of the robot [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ends = []
    for geom in geoms_of_robot(model):
        turn = data.geom_xmat[geom].reshape(3, 3)
        corners = model.geom_aabb[geom, :3] + model.geom_aabb[geom, 3:] * np.array(np.meshgrid(*[[-1, 1]] * 3)).T
        ends.append((data.geom_xpos[geom] + corners @ turn.T)[..., 0].max())
    return max(ends)


def test_all_of_the_robot_is_just_behind_the_pad(robot):
    assert PAD_BACK - 0.005 < foremost(compiled(robot)) < PAD_BACK


def test_a_finger_that_carries_the_pad_moves_the_robot_back(small):
    spec = press_spec()
    spec.worldbody.add_geom(type=BOX, size=[0.02, 0.02, 0.02], pos=[-0.034, 0.0, 0.0])
    attach_robot(spec, small, (0.0, 0.0, 0.0))
    assert foremost(spec.compile()) == pytest.approx(foremost(compiled(small)) - 0.04)


def test_the_tip_is_behind_the_middle_of_the_pad(robot):
    spec = press_spec()
    attach_robot(spec, robot, (0.0, 0.01, 0.07))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start, back, met = np.array([PAD_BACK - 1e-4, 0.01, 0.07]), np.array([-1.0, 0.0, 0.0]), np.zeros(1, np.int32)
    assert 0.0 < mujoco.mj_ray(model, data, start, back, None, True, -1, met) < 0.005
    assert "mf_tip" in model.geom(met[0]).name


def jointed(robot: Robot) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The same robot with its joints, in its pose."""
    arm, hand = (mujoco.MjSpec.from_file(str(robot.find(model))) for model in (robot.arm, robot.hand))
    for key in arm.keys:
        arm.delete(key)
    for option in ("cone", "impratio"):
        setattr(hand.option, option, getattr(arm.option, option))
    palm = hand.worldbody.first_body()
    palm.pos, palm.quat = robot.mount, [1.0, 0.0, 0.0, 0.0]
    arm.attach(hand, prefix="hand_", site=arm.site("attachment_site"))
    model = arm.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = robot.arm_angles + robot.hand_angles
    mujoco.mj_kinematics(model, data)
    return model, data


def test_the_pose_is_that_of_the_joints_at_their_angles(robot):
    robot = replace(robot, hand_angles=tuple(0.3 + 0.01 * np.arange(len(robot.hand_angles))), visuals=True)
    free, wanted = jointed(robot)
    spec = press_spec()
    attach_robot(spec, robot, (0.0, 0.0, 0.0))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    of_robot = geoms_of_robot(model)
    assert len(of_robot) == free.ngeom
    base = data.geom_xpos[of_robot[0]] - wanted.geom_xpos[0]
    np.testing.assert_allclose(data.geom_xpos[of_robot], wanted.geom_xpos + base, atol=1e-9)
    np.testing.assert_allclose(data.geom_xmat[of_robot], wanted.geom_xmat, atol=1e-9)


def test_the_pose_is_within_the_range_of_the_joints(real):
    free, pose = jointed(real)
    low, high = free.jnt_range.T
    assert ((low <= pose.qpos) & (pose.qpos <= high)).all()


BESIDE = 0.0546  # of the approach axis [m], past the pad: there is the real hand's first finger, the small one's palm


def test_an_object_that_misses_the_pad_is_stopped_by_the_robot(robot):
    pushes, met, _ = forces(compiled(robot, BESIDE), end=-0.12)
    assert "pad" not in met
    assert any(name.startswith("robot_hand_") for name in met)
    assert max(pushes) > 1.0


def test_without_collisions_an_object_passes_through_the_robot(robot):
    pushes, met, _ = forces(compiled(replace(robot, collisions=False), BESIDE), end=-0.12)
    assert met == set()
    assert max(np.abs(pushes)) == 0.0


def test_the_looks_are_left_out_unless_wanted(real):
    lean, full = compiled(real), compiled(replace(real, visuals=True))
    assert lean.nmat == 0
    assert full.nmat > 0
    assert mujoco.mj_sizeModel(lean) < 1e6 < 20e6 < mujoco.mj_sizeModel(full)
    assert (lean.geom_contype == 1).all()


@pytest.mark.parametrize("wrong", [{"arm_angles": (0.0,)}, {"hand_angles": ()}])
def test_a_wrong_number_of_angles_is_refused(small, wrong):
    with pytest.raises(ValueError, match=r"has \d joints, got \d angles"):
        attach_robot(press_spec(), replace(small, **wrong), (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="two" axis="1 0 0"', 'name="two" axis="1 0 0" pos="0 0 0.1"', "two of arm is not a hinge"),
        ('name="two"', 'name="two" type="slide"', "two of arm is not a hinge"),
        ('quat="1 0 0 1"', 'euler="0 0 90"', "arm does not orient"),
    ],
)
def test_a_model_whose_pose_cannot_be_worked_in_is_refused(small, old, new, message):
    (small.root / "arm.xml").write_text(ARM.replace(old, new))
    with pytest.raises(ValueError, match=message):
        attach_robot(press_spec(), small, (0.0, 0.0, 0.0))


def test_a_missing_checkout_is_an_error_that_says_how_to_get_one(monkeypatch):
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    with pytest.raises(MissingRobot, match=r"no franka_emika_panda/panda_nohand.xml .*`git clone .*mujoco_menagerie"):
        attach_robot(press_spec(), Robot(), (0.0, 0.0, 0.0))


def test_a_checkout_without_the_model_is_an_error_that_says_where_it_was_looked_for(monkeypatch, tmp_path):
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    with pytest.raises(FileNotFoundError, match=f"no wonik_allegro/right_hand.xml in {tmp_path}") as caught:
        Robot().find("wonik_allegro/right_hand.xml")
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_the_checkout_that_is_passed_goes_before_the_environment(monkeypatch, tmp_path, small):
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path / "elsewhere"))
    assert small.find("arm.xml") == tmp_path / "arm.xml"


def test_a_robot_can_be_a_key_and_be_pickled(small):
    assert {small: 1}[pickle.loads(pickle.dumps(small))] == 1


def test_describing_a_robot_does_not_load_mujoco():
    code = "import sys, activetouch.pressing.robot as r; r.Robot(); assert 'mujoco' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[3])
