"""Extremes of presses, pads, shapes, images and sensor faults."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from activetouch import Dynamic, Quasistatic, Scene
from activetouch.errors import UnstablePress
from activetouch.pressing.contact import Contact, Pad, Press
from activetouch.pressing.dynamic import GuardedMove
from activetouch.rendering import (
    DeadTaxels,
    ForcePatchRenderer,
    GelSightRenderer,
    Hysteresis,
    Noise,
    PressureRenderer,
    Quantisation,
    read_out,
)
from activetouch.shapes import EXTENDED_SHAPES, Shape
from tests.extremes.cases import (
    Case,
    Expectation,
    Verdict,
    answers,
    equal_to,
    judge,
    refusals,
    refuses,
    such_that,
)
from tests.extremes.touch import MISS, SOUND, is_sound, press_once

_MOVING: dict[str, Press] = {"dynamic": Dynamic(), "guarded_move": GuardedMove()}
_NAN = math.nan


def _near(force: float, tolerance: float) -> Expectation:
    words = f"sound, {force:g} N within {100 * tolerance:g} %"
    return such_that(words, lambda c: is_sound(c) and abs(c.force - force) <= tolerance * force)


def _of_physics() -> list[Case]:
    cases = [
        answers(
            f"{name} press",
            f"a time step of {1e3 * dt:g} ms",
            lambda p=press, dt=dt: press_once(replace(p, timestep=dt, speed=0.02)),
            expected,
        )
        for name, press, expected in (
            ("dynamic", _MOVING["dynamic"], _near(2.0, 0.1)),
            ("guarded_move", _MOVING["guarded_move"], SOUND),
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
            lambda: press_once(Dynamic(timestep=5e-4, speed=0.02, admittance=0.002), pad=stiff),
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
        *refusals(
            "dynamic press",
            UnstablePress,
            {
                "a target force of 1e6 N": (lambda: press_once(Dynamic(), force=1e6), unstable),
                "a tolerance that no force can keep": (
                    lambda: press_once(Dynamic(tolerance=0.0)),
                    "Try a smaller timestep",
                ),
            },
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
            lambda: press_once(Quasistatic(), force=1e6),
            such_that("bottoms out", lambda c: c.is_bottomed_out and np.isfinite(c.pressure).all()),
        ),
        answers("quasistatic press", "no force at all", lambda: press_once(Quasistatic(), force=0.0), MISS),
        *refusals(
            "quasistatic press",
            ValueError,
            {
                "a force of NaN": (lambda: press_once(Quasistatic(), force=_NAN), "force"),
                "a force of -1 N": (lambda: press_once(Quasistatic(), force=-1.0), "force"),
            },
        ),
        *refusals(
            "dynamic press",
            ValueError,
            {
                "a force of NaN": (lambda: press_once(Dynamic(), force=_NAN), "force"),
                "a force of -1 N": (lambda: press_once(Dynamic(), force=-1.0), "force"),
            },
        ),
        refuses(
            "guarded_move press", "a force of NaN", lambda: press_once(GuardedMove(), force=_NAN), ValueError, "force"
        ),
    ]


def _or_unstable(press: Press, **how: object) -> bool:
    """Whether a press came out sound, or was refused because it was not."""
    try:
        return is_sound(press_once(press, **how))  # type: ignore[arg-type]
    except UnstablePress:
        return True


def _smallest_depth(shape: Shape) -> bool:
    """Whether a shape of the table, pressed in 20 random orientations, is felt soundly at both ends of its sizes."""
    scene = Scene(shapes={"it": shape}, press_model=Quasistatic(), pad=Pad(num_taxels=32))
    rng = np.random.default_rng(0)
    found = [scene.press(scene.sample_object(0, rng), 0, rng)[0] for _ in range(20)]
    return all(is_sound(contact) and contact.force > 0.0 for contact in found)


def _pads_and_shapes() -> list[Case]:
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
    ]


def _image(contact: Contact, renderer: Callable[[Contact], np.ndarray]) -> bool:
    image = renderer(contact)
    return bool(np.isfinite(image).all() and image.min() >= 0.0 and image.max() <= 1.0)


def _of_images() -> list[Case]:
    rng, grey = np.random.default_rng(0), np.full((4, 4), 0.5)
    cases = []
    for renderer in (PressureRenderer(), GelSightRenderer()):
        for given, contact in (
            ("a miss", lambda: press_once(Quasistatic(), offset=(0.2, 0.0))),
            ("a press of 1e6 N", lambda: press_once(Quasistatic(), force=1e6)),
            ("four taxels", lambda: press_once(Quasistatic(), pad=Pad(num_taxels=2))),
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
            lambda: _image(press_once(Quasistatic(), pad=Pad(num_taxels=1)), GelSightRenderer()),
            ValueError,
            "at least 2 × 2",
        ),
        answers(
            "ForcePatchRenderer",
            "a miss",
            lambda: _image(press_once(GuardedMove(), offset=(0.2, 0.0)), ForcePatchRenderer()),
            such_that("an image in [0, 1]", bool),
        ),
        refuses(
            "PressureRenderer",
            "bins that do not divide the taxels",
            lambda: _image(press_once(Quasistatic()), PressureRenderer(binning=7)),
            ValueError,
            "7",
        ),
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
    ]


CASES = [*_of_physics(), *_pads_and_shapes(), *_of_images()]


@pytest.mark.mujoco
@pytest.mark.parametrize("case", CASES, ids=str)
def test_an_extreme_of_the_world_is_answered_rightly_or_refused_with_a_reason(case):
    finding = judge(case)
    assert finding.verdict is not Verdict.FAILED, f"expected {case.expected.words}; {finding.happened}"
