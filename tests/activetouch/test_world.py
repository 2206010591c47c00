"""A press that does not settle is no touch: it is made again and counted, and the seed still decides the touch."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from activetouch import SCENES, Quasistatic, TactileSensor, TouchWorld
from activetouch.errors import UnstablePress
from activetouch.poses import Placement
from activetouch.pressing.contact import Contact, Pad, Press
from activetouch.sensor_files import MODELS
from activetouch.world import TouchTime
from belief.errors import InvalidArgument

pytestmark = pytest.mark.torch


@dataclass(frozen=True)
class Bouncing(Press):
    """Presses like ``Quasistatic``, but does not settle at forces above ``limit`` [N]."""

    limit: float

    def press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        if target_force > self.limit:
            raise UnstablePress(f"bounces at {target_force} N")
        return Quasistatic().press(pad, placement, target_force)


def world(limit):
    scene = replace(SCENES["coarse"].scene, press_model=Bouncing(limit))
    sensor = TactileSensor.shipped("coarse", scene, anyway=True)
    return TouchWorld.sample(sensor, (0, 1), np.random.default_rng(0))


def test_a_press_that_does_not_settle_is_made_again_with_other_nuisances():
    bouncing, calm = world(limit=2.0), world(limit=3.0)  # of forces between 1.5 and 3 N, two in three
    same = []
    for seed in range(30):
        image, time = bouncing.press(0, np.random.default_rng(seed))
        settled_at_once = time.pressed_again == 0
        same.append(settled_at_once)
        assert np.array_equal(image, calm.press(0, np.random.default_rng(seed))[0]) == settled_at_once
        assert np.array_equal(image, bouncing.press(0, np.random.default_rng(seed))[0])  # the seed decides
    assert 0 < sum(same) < 30


def test_an_object_that_never_settles_is_an_error_that_says_so():
    hopeless = world(limit=1.0)
    with pytest.raises(UnstablePress, match=r"none of 10 presses for one touch settled; the last one: bounces at"):
        hopeless.touch(0, np.random.default_rng(0))


def test_a_sensor_comes_from_a_folder_named_by_a_string_and_needs_a_scene():
    coarse = SCENES["coarse"]
    assert TactileSensor.load(str(MODELS / "coarse"), coarse.scene).shift == ()
    with pytest.raises(InvalidArgument, match=r"must be a Scene, such as SCENES\['coarse'\]\.scene"):
        TactileSensor.load(MODELS / "coarse", coarse)


def test_objects_come_one_after_the_other_and_from_the_first_again():
    some = world(limit=3.0)
    assert some.arrangement == (0, 1)
    assert some.current.shape_index == 0
    some.advance()
    assert some.current.shape_index == 1
    with pytest.raises(IndexError, match="after the last of 2"):
        some.advance()
    some.reset()
    assert some.current.shape_index == 0
    assert TouchTime(1.0, 2.0, 3) + TouchTime(10.0, 20.0, 30) == TouchTime(11.0, 22.0, 33)
