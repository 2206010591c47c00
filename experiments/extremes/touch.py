"""Extremes of the world: presses of every kind, pads, objects, images, scenes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from activetouch import Dynamic, Quasistatic, Scene, TactileSensor, TouchWorld
from activetouch.distributions import Constant, LogUniform, Normal, Uniform
from activetouch.errors import UnstablePress
from activetouch.placement import Placement
from activetouch.pressing.contact import Contact, contact_at_depth, surface_gap
from activetouch.pressing.deformable import Deformable
from activetouch.pressing.guarded_move import GuardedMove
from activetouch.pressing.pad import Pad
from activetouch.pressing.press import Press
from activetouch.pressing.setup import Setup
from activetouch.rendering import (
    DeadTaxels,
    ForcePatchRenderer,
    Gain,
    GelSightRenderer,
    Hysteresis,
    Noise,
    PressureRenderer,
    Quantisation,
    read_out,
)
from activetouch.scene import Variation, WorldObject
from activetouch.shapes import EXTENDED_SHAPES, SHAPES, Box, Cylinder, Shape, Sphere
from belief.errors import UnknownName
from experiments.extremes.cases import Case, Expectation, answers, equal_to, refuses, such_that

_UPRIGHT = (1.0, 0.0, 0.0, 0.0)
_MOVING: dict[str, Press] = {"dynamic": Dynamic(), "guarded_move": GuardedMove()}
_PRESSES: dict[str, Press] = {"quasistatic": Quasistatic(), **_MOVING}
_NAN, _INF = math.nan, math.inf


def _press(
    press: Press,
    shape: Shape | None = None,
    force: float = 2.0,
    offset: tuple[float, float] = (0.0, 0.0),
    pad: Pad | None = None,
    scale: float = 1.0,
    friction: float = 1.0,
) -> Contact:
    placement = Placement(shape or SHAPES["sphere"], scale, _UPRIGHT, np.array(offset), friction)
    return press.press(Setup(pad or Pad(num_taxels=32)), placement, force)


def _is_sound(contact: Contact) -> bool:
    """Whether forces, depths and pressures are finite, not negative, and add up."""
    pressed = float(contact.pressure.sum() * contact.pad.taxel_area)
    adds_up = contact.is_bottomed_out or math.isclose(pressed, contact.force, rel_tol=1e-6, abs_tol=1e-9)
    finite = np.isfinite(contact.pressure).all() and np.isfinite([contact.force, contact.depth]).all()
    return bool(finite and contact.pressure.min() >= 0.0 and contact.depth <= contact.pad.max_depth and adds_up)


_SOUND = such_that("finite, and the pressures add up to the force", _is_sound)
_MISS = such_that("no force and a blank pad", lambda c: c.force == 0.0 and not c.pressure.any())


def _near(force: float, tolerance: float) -> Expectation:
    words = f"sound, {force:g} N within {100 * tolerance:g} %"
    return such_that(words, lambda c: _is_sound(c) and abs(c.force - force) <= tolerance * force)


def _of_presses() -> list[Case]:
    cases = []
    for name, press in _PRESSES.items():

        def case(given: str, expected: Expectation, press: Press = press, name: str = name, **how: object) -> Case:
            return answers(f"{name} press", given, lambda: _press(press, **how), expected)  # type: ignore[arg-type]

        cases += [
            case("an object beside the pad", _MISS, offset=(0.2, 0.0)),
            case("an object that glances off the rim", _SOUND, offset=(0.0149 + 0.019, 0.0)),
            case("an object over the corner", _SOUND, offset=(0.015, 0.015)),
            case("an object of 1 mm", _SOUND, shape=Sphere(0.0005)),
            case("an object of 50 mm", _SOUND, shape=Sphere(0.025), scale=2.0),
            case("a sharp edge", _SOUND, shape=Box((0.016, 0.0001, 0.016))),
            case("a frictionless object", _SOUND, friction=0.0),
            case("a pad of one taxel", _SOUND, pad=Pad(num_taxels=1)),
            case("a pad of 1 mm", _SOUND, pad=Pad(num_taxels=8, half_width=0.0005)),
            case("a target force of 1 mN", _SOUND, force=1e-3),
        ]
    return cases


def _of_physics() -> list[Case]:
    cases = [
        answers(
            f"{name} press",
            f"a time step of {1e3 * dt:g} ms",
            lambda p=press, dt=dt: _press(replace(p, timestep=dt, speed=0.02)),
            expected,
        )
        for name, press, expected in (
            ("dynamic", _MOVING["dynamic"], _near(2.0, 0.1)),
            ("guarded_move", _MOVING["guarded_move"], _SOUND),
        )
        for dt in (5e-4, 2e-3, 5e-3)
    ]
    stiff, bouncy = Pad(num_taxels=32, contact_time=0.004), Pad(num_taxels=32, damping_ratio=0.05)
    absurd = Pad(num_taxels=32, contact_time=1e-6)
    unstable = "did not settle|MuJoCo warnings|N in the pause"
    return [
        *cases,
        answers(
            "dynamic press",
            "a stiff pad",
            lambda: _press(Dynamic(timestep=5e-4, speed=0.02, admittance=0.002), pad=stiff),
            _near(2.0, 0.1),
        ),
        answers(
            "dynamic press",
            "a bouncy pad",
            lambda: _or_unstable(Dynamic(), pad=bouncy),
            such_that("2 N within 10 %, or UnstablePress", bool),
        ),
        answers(
            "dynamic press",
            "an absurdly stiff pad",
            lambda: _or_unstable(Dynamic(), pad=absurd),
            such_that("2 N within 10 %, or UnstablePress", bool),
        ),
        refuses(
            "dynamic press", "a target force of 1e6 N", lambda: _press(Dynamic(), force=1e6), UnstablePress, unstable
        ),
        refuses(
            "dynamic press",
            "a tolerance that no force can keep",
            lambda: _press(Dynamic(tolerance=0.0)),
            UnstablePress,
            "Try a smaller timestep",
        ),
        answers(
            "guarded_move press",
            "a threshold that is never reached",
            lambda: _or_unstable(GuardedMove(), force=1e6),
            such_that("sound, or UnstablePress", bool),
        ),
        answers(
            "quasistatic press",
            "a target force of 1e6 N",
            lambda: _press(Quasistatic(), force=1e6),
            such_that("bottoms out", lambda c: c.is_bottomed_out and np.isfinite(c.pressure).all()),
        ),
        answers("quasistatic press", "no force at all", lambda: _press(Quasistatic(), force=0.0), _MISS),
        refuses("quasistatic press", "a force of NaN", lambda: _press(Quasistatic(), force=_NAN), ValueError, "force"),
        refuses("quasistatic press", "a force of -1 N", lambda: _press(Quasistatic(), force=-1.0), ValueError, "force"),
        refuses("dynamic press", "a force of NaN", lambda: _press(Dynamic(), force=_NAN), ValueError, "force"),
        refuses("dynamic press", "a force of -1 N", lambda: _press(Dynamic(), force=-1.0), ValueError, "force"),
        refuses("guarded_move press", "a force of NaN", lambda: _press(GuardedMove(), force=_NAN), ValueError, "force"),
        answers(
            "deformable press",
            "a soft block",
            lambda: _press(Deformable(nodes=9, layers=2)),
            such_that("2 N within 5 %", lambda c: abs(c.force - 2.0) < 0.1),
            slow=True,
        ),
        answers(
            "deformable press",
            "an object beside the pad",
            lambda: _press(Deformable(nodes=9, layers=2), offset=(0.2, 0.0)),
            _MISS,
            slow=True,
        ),
        refuses(
            "Dynamic",
            "a step longer than the pad is thick",
            lambda: Dynamic(timestep=0.02, speed=1.0),
            ValueError,
            "pass through the pad",
        ),
        refuses("Dynamic", "a time step of zero", lambda: Dynamic(timestep=0.0), ValueError, "timestep"),
        refuses("Dynamic", "a time step of NaN", lambda: Dynamic(timestep=_NAN), ValueError, "timestep"),
        refuses("GuardedMove", "no pause", lambda: GuardedMove(pause=0.0), ValueError, "pause"),
        refuses("Deformable", "one node", lambda: Deformable(nodes=1), ValueError, "nodes"),
    ]


def _or_unstable(press: Press, **how: object) -> bool:
    """Whether a press came out sound, or was refused because it was not."""
    try:
        return _is_sound(_press(press, **how))  # type: ignore[arg-type]
    except UnstablePress:
        return True


def _smallest_depth(shape: Shape) -> bool:
    """Whether a shape of the table, pressed in 20 random orientations, is felt soundly at both ends of its sizes."""
    scene = Scene(shapes={"it": shape}, press_model=Quasistatic(), pad=Pad(num_taxels=32))
    rng = np.random.default_rng(0)
    found = [scene.press(scene.sample_object(0, rng), 0, rng)[0] for _ in range(20)]
    return all(_is_sound(contact) and contact.force > 0.0 for contact in found)


def _pads_and_shapes() -> list[Case]:
    gap = surface_gap(Pad(num_taxels=32), Placement(SHAPES["sphere"], 1.0, _UPRIGHT))
    pad = Pad(num_taxels=32)
    return [
        *(
            answers(
                f"SHAPES[{name!r}]",
                "20 random orientations",
                lambda shape=shape: _smallest_depth(shape),
                such_that("each felt soundly", bool),
            )
            for name, shape in EXTENDED_SHAPES.items()
        ),
        refuses("Pad", "no taxels", lambda: Pad(num_taxels=0), ValueError, "num_taxels"),
        refuses("Pad", "a width of NaN", lambda: Pad(half_width=_NAN), ValueError, "positive"),
        refuses("Pad", "a stiffness of zero", lambda: Pad(stiffness=0.0), ValueError, "positive"),
        refuses("Pad", "an infinite depth", lambda: Pad(max_depth=_INF), ValueError, "positive"),
        refuses("Sphere", "a radius of zero", lambda: Sphere(0.0), ValueError, "above zero, got Sphere.radius=0"),
        refuses("Sphere", "a radius of NaN", lambda: Sphere(_NAN), ValueError, "radius"),
        refuses("Box", "a negative edge", lambda: Box((0.01, -0.01, 0.01)), ValueError, "half_extents"),
        refuses("Cylinder", "an infinite length", lambda: Cylinder(0.01, _INF), ValueError, "half_length"),
        refuses(
            "contact_at_depth",
            "deeper than the layer",
            lambda: contact_at_depth(pad, gap, 1.0),
            ValueError,
            "where the layer ends",
        ),
        answers("contact_at_depth", "no depth", lambda: contact_at_depth(pad, gap, 0.0), _MISS),
        refuses("Uniform", "low above high", lambda: Uniform(2.0, 1.0), ValueError, "low must not exceed high"),
        refuses("Constant", "NaN", lambda: Constant(_NAN), ValueError, "finite"),
        refuses("LogUniform", "a low end of zero", lambda: LogUniform(0.0, 1.0), ValueError, "0 < low"),
        refuses("Normal", "a negative deviation", lambda: Normal(0.0, -1.0), ValueError, "std"),
        answers("Normal", "no deviation", lambda: Normal(2.0, 0.0).sample(np.random.default_rng(0)), equal_to(2.0)),
    ]


def _image(contact: Contact, renderer: Callable[[Contact], np.ndarray]) -> bool:
    image = renderer(contact)
    return bool(np.isfinite(image).all() and image.min() >= 0.0 and image.max() <= 1.0)


def _of_images() -> list[Case]:
    rng, grey = np.random.default_rng(0), np.full((4, 4), 0.5)
    cases = []
    for renderer in (PressureRenderer(), GelSightRenderer()):
        for given, contact in (
            ("a miss", lambda: _press(Quasistatic(), offset=(0.2, 0.0))),
            ("a press of 1e6 N", lambda: _press(Quasistatic(), force=1e6)),
            ("four taxels", lambda: _press(Quasistatic(), pad=Pad(num_taxels=2))),
        ):
            cases.append(
                answers(
                    type(renderer).__name__,
                    given,
                    lambda c=contact, r=renderer: _image(c(), r),
                    such_that("an image in [0, 1]", bool),
                )
            )
    return [
        *cases,
        refuses(
            "GelSightRenderer",
            "one taxel",
            lambda: _image(_press(Quasistatic(), pad=Pad(num_taxels=1)), GelSightRenderer()),
            ValueError,
            "at least 2 × 2",
        ),
        answers(
            "ForcePatchRenderer",
            "a miss",
            lambda: _image(_press(GuardedMove(), offset=(0.2, 0.0)), ForcePatchRenderer()),
            such_that("an image in [0, 1]", bool),
        ),
        refuses(
            "PressureRenderer",
            "bins that do not divide the taxels",
            lambda: _image(_press(Quasistatic()), PressureRenderer(binning=7)),
            ValueError,
            "7",
        ),
        refuses("PressureRenderer", "bins of zero", lambda: PressureRenderer(binning=0), ValueError, "binning"),
        answers(
            "read_out", "an image of 1e308", lambda: int(read_out(np.full((2, 2), 1e308), (), rng).max()), equal_to(255)
        ),
        answers(
            "read_out", "every taxel dead", lambda: int(read_out(grey, (DeadTaxels(1.0),), rng).max()), equal_to(0)
        ),
        answers("read_out", "one bit", lambda: int(read_out(grey + 0.1, (Quantisation(1),), rng).max()), equal_to(255)),
        answers(
            "read_out",
            "hysteresis wider than the scale",
            lambda: int(read_out(grey, (Hysteresis(2.0),), rng).max()),
            equal_to(0),
        ),
        answers(
            "read_out",
            "noise a thousand times full scale",
            lambda: read_out(grey, (Noise(1e3),), rng).dtype.name,
            such_that("8 bits", lambda d: d == "uint8"),
        ),
        refuses("read_out", "an image of NaN", lambda: read_out(np.full((2, 2), _NAN), (), rng), ValueError, "NaN"),
        refuses("DeadTaxels", "a share of 1.5", lambda: DeadTaxels(1.5), ValueError, "1.5"),
        refuses("Quantisation", "no bits", lambda: Quantisation(0), ValueError, "bits"),
        refuses("Noise", "a deviation of NaN", lambda: Noise(_NAN), ValueError, "std"),
        refuses("Gain", "half a range of -0.1", lambda: Gain(-0.1), ValueError, "half_range"),
        refuses("Hysteresis", "a width of NaN", lambda: Hysteresis(_NAN), ValueError, "width"),
    ]


def _after_the_last() -> None:
    sensor = TactileSensor.shipped("coarse")
    world = TouchWorld.sample(sensor, (0,), np.random.default_rng(0))
    world.advance()


def _misread() -> None:
    TactileSensor.shipped("coarse").read(np.zeros((0, 4, 4), np.uint8), [])


def _of_scenes() -> list[Case]:
    rng = np.random.default_rng(0)
    upright = WorldObject(0, 1.0, _UPRIGHT)
    return [
        refuses("Scene", "no shapes", lambda: Scene(shapes={}), ValueError, "at least one shape"),
        refuses("Scene", "no poses", lambda: Scene(poses={}), ValueError, "at least one"),
        refuses("Scene", "a robot that is not known", lambda: Scene(robot="panda"), UnknownName, "panda_allegro"),
        refuses(
            "Scene.sample_object",
            "a shape that is not there",
            lambda: Scene().sample_object(4, rng),
            ValueError,
            r"\[0, 4\), got 4",
        ),
        refuses(
            "Scene.press",
            "a pose that is not there",
            lambda: Scene(press_model=Quasistatic()).press(upright, 6, rng),
            ValueError,
            "pose",
        ),
        refuses(
            "Scene",
            "a size of zero",
            lambda: Scene(variation=Variation(size=Constant(0.0)), press_model=Quasistatic()).press(
                Scene(variation=Variation(size=Constant(0.0))).sample_object(0, rng), 0, rng
            ),
            ValueError,
            "(?i)size|scale",
        ),
        refuses(
            "Scene.press",
            "an object larger than the rig was made for",
            lambda: Scene(variation=Variation(size=Constant(5.0))).press(WorldObject(0, 5.0, _UPRIGHT), 0, rng),
            ValueError,
            "(?i)scale|size",
        ),
        refuses(
            "TactileSensor.shipped",
            "a scene without one",
            lambda: TactileSensor.shipped("gell"),
            UnknownName,
            "Did you mean 'gel'",
        ),
        refuses("TactileSensor.read", "no images", _misread, ValueError, "nothing to read"),
        refuses(
            "TouchWorld.advance", "after the last object", _after_the_last, IndexError, "no object after the last of 1"
        ),
    ]


CASES: tuple[Case, ...] = (*_of_presses(), *_of_physics(), *_pads_and_shapes(), *_of_images(), *_of_scenes())
"""Of :mod:`activetouch`, but for its files."""
