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
from belief import AtMostOne
from belief.errors import InvalidArgument
from belief.naming import UNLISTED
from belief.seeding import sample_arrangement

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


def test_an_unlisted_object_is_of_a_random_body_and_the_seed_decides_which():
    sensor = TactileSensor.shipped("coarse")
    worlds = [TouchWorld.sample(sensor, (UNLISTED, 1), np.random.default_rng(seed)) for seed in (0, 0, 1)]
    assert [one.arrangement for one in worlds] == [(UNLISTED, 1)] * 3
    assert "none of these" in repr(worlds[0])
    images = [one.press(0, np.random.default_rng(7))[0] for one in worlds]
    assert (images[0] == images[1]).all()
    assert (images[0] != images[2]).any()


def test_the_rules_say_how_many_simulated_objects_are_unlisted():
    sensor = TactileSensor.shipped("coarse")
    for composition in ("distinct", "independent", AtMostOne("cone")):
        problem = sensor.problem(composition=composition, unlisted=0.25)
        drawn = [sample_arrangement(problem, np.random.default_rng(seed)) for seed in range(400)]
        share = np.mean([[shape == UNLISTED for shape in one] for one in drawn])
        assert 0.2 < share < 0.3
        listed = sample_arrangement(sensor.problem(composition=composition), np.random.default_rng(3))
        strangers = sample_arrangement(problem, np.random.default_rng(3))
        assert all(two in (one, UNLISTED) for one, two in zip(listed, strangers, strict=True))
