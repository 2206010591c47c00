"""A press that skips its free approach ends as the press that simulates it from the start."""

import numpy as np
import pytest

from activetouch import SHAPES, Dynamic
from activetouch.poses import Placement, random_orientation, turn
from activetouch.pressing.contact import Pad, Phase, first_touch
from activetouch.pressing.dynamic import GuardedMove
from activetouch.pressing.rig import Rig
from activetouch.shapes import EXTENDED_SHAPES, Sphere
from activetouch.solids.primitives import Torus

pytestmark = pytest.mark.mujoco
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
PRESSES = {"dynamic": Dynamic(), "guarded_move": GuardedMove()}
every_press = pytest.mark.parametrize("press", PRESSES.values(), ids=PRESSES)


def agree(press, placement, force=2.0, pad=None):
    pad = Pad() if pad is None else pad
    short = press.press(pad, placement, force)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Rig, "skip_approach", lambda *given: 0)
        complete = press.press(pad, placement, force)
    assert short.force == pytest.approx(complete.force, rel=0.01, abs=1e-9)
    np.testing.assert_allclose(short.indentation, complete.indentation, atol=2e-5)
    return short, complete


@every_press
@pytest.mark.parametrize("name", EXTENDED_SHAPES)
def test_force_and_imprint_are_those_of_the_press_from_the_start(press, name, rng):
    offset = rng.uniform(-0.002, 0.002, 2)
    agree(press, Placement(EXTENDED_SHAPES[name], rng.uniform(0.8, 1.2), random_orientation(rng), offset))


@every_press
def test_the_approach_is_skipped(press, rng):
    for shape in SHAPES.values():
        placement = Placement(shape, 1.0, random_orientation(rng))
        rig, start, *_ = press._begin(Pad(), placement, 2.0)
        touching = first_touch(Pad(), placement)[1]
        num_skipped = rig.skip_approach(start, press.speed, touching)
        assert num_skipped * press.speed * press.timestep > 0.008
        force, num_steps = 0.0, 0
        while force == 0.0:
            num_steps += 1
            force = rig.step(start - (num_skipped + num_steps) * press.speed * press.timestep, Phase.APPROACH)
        assert 2 <= num_steps <= 2 + 0.001 / (press.speed * press.timestep)


@every_press
def test_what_the_rays_do_not_see_is_met_all_the_same(press):
    # The convex hull of a ring is flat over its hole, into which all rays of a small pad go.
    small = Pad(half_width=0.004, num_taxels=16)
    placement = Placement(Torus(0.012, 0.009), 1.013, turn("y", np.pi / 2))
    short, _ = agree(press, placement, pad=small)
    assert short.force > 0.0
    # The tip of a cone between the four taxels of a coarse pad.
    agree(press, Placement(SHAPES["cone"], 1.013, turn("y", -np.pi / 2)), pad=Pad(num_taxels=2))
    # An object that touches beside all taxels.
    beside = Placement(Sphere(0.002), 1.013, UPRIGHT)
    assert np.isnan(first_touch(Pad(num_taxels=2), beside)[1])
    agree(press, beside, pad=Pad(num_taxels=2))


@every_press
def test_misses_glances_and_large_objects_end_as_from_the_start(press):
    for shape, scale, offset in (
        (Sphere(0.02), 1.013, 0.05),
        (Sphere(0.02), 1.013, 0.0345),
        (Sphere(0.02), 1.013, 0.0351),
        (SHAPES["cube"], 1.987, 0.0),
    ):
        short, complete = agree(press, Placement(shape, scale, UPRIGHT, np.array([offset, 0.0])))
        assert (short.force > 0.0) == (complete.force > 0.0)
