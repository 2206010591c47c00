import mujoco

from activetouch.pressing.rig import Rig
from activetouch.pressing.setup import Setup
from activetouch.shapes import SHAPES


def test_steps_measure_no_time():
    rig = Rig(Setup(), SHAPES["cube"], 0.002)
    mujoco.mj_step(rig.model, rig.data)
    assert rig.data.timer[mujoco.mjtTimer.mjTIMER_STEP].number == 1
    assert rig.data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration == 0.0
