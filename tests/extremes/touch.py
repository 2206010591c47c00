"""Extremes of touches: presses of every kind, objects, and scenes."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from activetouch import Dynamic, Quasistatic, Scene, TactileSensor, TouchWorld
from activetouch.distributions import Constant
from activetouch.poses import Placement
from activetouch.pressing.contact import Contact, Pad, Press
from activetouch.pressing.dynamic import GuardedMove
from activetouch.scene import Variation, WorldObject
from activetouch.shapes import SHAPES, Box, Shape, Sphere
from belief.errors import UnknownName
from tests.extremes.cases import Case, Expectation, answers, refuses, such_that

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
_MOVING: dict[str, Press] = {"dynamic": Dynamic(), "guarded_move": GuardedMove()}
_PRESSES: dict[str, Press] = {"quasistatic": Quasistatic(), **_MOVING}
_NAN, _INF = math.nan, math.inf


def press_once(
    press: Press,
    shape: Shape | None = None,
    force: float = 2.0,
    offset: tuple[float, float] = (0.0, 0.0),
    pad: Pad | None = None,
    scale: float = 1.0,
    friction: float = 1.0,
) -> Contact:
    """Press one object upright; a sphere by default."""
    placement = Placement(shape or SHAPES["sphere"], scale, UPRIGHT, np.array(offset), friction)
    return press.press(pad or Pad(num_taxels=32), placement, force)


def is_sound(contact: Contact) -> bool:
    """Whether forces, depths and pressures are finite, not negative, and add up."""
    pressed = float(contact.pressure.sum() * contact.pad.taxel_area)
    adds_up = contact.is_bottomed_out or math.isclose(pressed, contact.force, rel_tol=1e-6, abs_tol=1e-9)
    finite = np.isfinite(contact.pressure).all() and np.isfinite([contact.force, contact.depth]).all()
    return bool(finite and contact.pressure.min() >= 0.0 and contact.depth <= contact.pad.max_depth and adds_up)


SOUND = such_that("finite, and the pressures add up to the force", is_sound)
MISS = such_that("no force and a blank pad", lambda c: c.force == 0.0 and not c.pressure.any())


def _of_presses() -> list[Case]:
    cases = []
    for name, press in _PRESSES.items():

        def case(given: str, expected: Expectation, press: Press = press, name: str = name, **how: object) -> Case:
            return answers(f"{name} press", given, lambda: press_once(press, **how), expected)

        cases += [
            case("an object beside the pad", MISS, offset=(0.2, 0.0)),
            case("an object that glances off the rim", SOUND, offset=(0.0149 + 0.019, 0.0)),
            case("an object over the corner", SOUND, offset=(0.015, 0.015)),
            case("an object of 1 mm", SOUND, shape=Sphere(0.0005)),
            case("an object of 50 mm", SOUND, shape=Sphere(0.025), scale=2.0),
            case("a sharp edge", SOUND, shape=Box((0.016, 0.0001, 0.016))),
            case("a frictionless object", SOUND, friction=0.0),
            case("a pad of one taxel", SOUND, pad=Pad(num_taxels=1)),
            case("a pad of 1 mm", SOUND, pad=Pad(num_taxels=8, half_width=0.0005)),
            case("a target force of 1 mN", SOUND, force=1e-3),
        ]
    return cases


def _after_the_last() -> None:
    TouchWorld.sample(TactileSensor.shipped("coarse"), (0,), np.random.default_rng(0)).advance()


def _no_images() -> None:
    TactileSensor.shipped("coarse").read(np.zeros((0, 4, 4), np.uint8), [])


def _pressed(scene: Scene, thing: WorldObject, pose: int) -> Callable[[], object]:
    return lambda: scene.press(thing, pose, np.random.default_rng(0))


def _of_scenes() -> list[Case]:
    static, large = Scene(press_model=Quasistatic()), Scene(variation=Variation(size=Constant(5.0)))
    upright, no_size = WorldObject(0, 1.0, UPRIGHT), WorldObject(0, 0.0, UPRIGHT)
    return [
        refuses("Scene", "no shapes", lambda: Scene(shapes={}), ValueError, "at least one shape"),
        refuses("Scene", "no poses", lambda: Scene(poses={}), ValueError, "at least one"),
        refuses(
            "Scene.sample_object",
            "a shape that does not exist",
            lambda: static.sample_object(4, np.random.default_rng(0)),
            ValueError,
            r"\[0, 4\), got 4",
        ),
        refuses("Scene.press", "a pose that does not exist", _pressed(static, upright, 6), ValueError, "pose"),
        refuses("Scene.press", "a size of zero", _pressed(static, no_size, 0), ValueError, "(?i)size|scale"),
        refuses(
            "Scene.press",
            "an object larger than the rig allows",
            _pressed(large, WorldObject(0, 5.0, UPRIGHT), 0),
            ValueError,
            "(?i)scale|size",
        ),
        refuses("TactileSensor", "a misspelt scene", lambda: TactileSensor.shipped("gell"), UnknownName, "mean 'gel'"),
        refuses("TactileSensor.read", "no images", _no_images, ValueError, "nothing to read"),
        refuses("TouchWorld.advance", "after the last object", _after_the_last, IndexError, "no object after the last"),
    ]


CASES: tuple[Case, ...] = (*_of_presses(), *_of_scenes())
"""Cases of touches."""
