"""What explain says of touches: bottoming out and the force that avoids it, reach, and the surface that is pressed."""

import re
from dataclasses import replace

import numpy as np
import pytest

from activetouch import SCENES
from activetouch.distributions import Uniform
from activetouch.pressing.press import Quasistatic
from activetouch.shapes import EXTENDED_SHAPES, Box, Cone, Sphere, Union
from experiments.press.alike import Alike, Likeness
from experiments.press.felt_tables import alike_table, bearing_forces, felt_table
from experiments.press.inventory import inventory

SCENE = replace(SCENES["coarse"].scene, press_model=Quasistatic())


def test_a_layer_bottoms_out_from_the_bearing_force_on(rng):
    scene = replace(SCENE, shapes={"cone": Cone(0.018, 0.036)})
    for force in bearing_forces(scene, "cone", 5, np.random.default_rng(1)):
        for factor, is_out in ((0.99, False), (1.01, True)):
            given = replace(
                scene, variation=replace(scene.variation, force=Uniform(factor * force, factor * force + 1e-9))
            )
            again = np.random.default_rng(1)
            outs = [
                given.contact(given.place(given.sample_object("cone", again), number, again), rng).is_bottomed_out
                for number in range(5)
            ]
            assert is_out in outs
    assert len(bearing_forces(scene, "cone", 5, rng)) == 5


def test_forces_that_the_table_offers_bottom_out_rarely():
    table = felt_table("coarse", SCENE, None)
    shares = {row[0]: row[1] for row in table.rows}
    assert shares["sphere"] == 0.0 < 0.5 < shares["cone"]
    low, high = map(float, re.findall(r"Uniform\(([\d.]+), ([\d.]+)\)", table.note)[0])
    gentle = felt_table("coarse", replace(SCENE, variation=replace(SCENE.variation, force=Uniform(low, high))), None)
    assert np.mean([row[1] for row in gentle.rows]) == pytest.approx(0.05, abs=0.03)
    soft = felt_table("coarse", replace(SCENE, shapes={"ball": Sphere(0.02)}), None)
    assert "Uniform" not in soft.note


def test_what_no_touch_meets_is_a_reason_to_aim():
    known = Alike((), {label: (0.7 if label == "cone" else 1.0, 0.3) for label in SCENE.shape_labels}, 6)
    table = felt_table("coarse", SCENE, known)
    assert table.rows[3][2:] == (0.7, 0.3)
    assert "To meet all of cone, aim" in table.note
    assert "aim" not in felt_table("coarse", SCENE, None).note


def test_the_table_of_alike_shapes_names_those_that_are_hardly_told_apart():
    same = Likeness(("left", "right"), 0.5, (0.42, 0.5), 0.5, 0.49, (0.4, 0.5), 0.5, 0.0, 0.2)
    other = Likeness(("left", "ball"), 0.01, (0.0, 0.05), 0.02, 0.0, (0.0, 0.04), 0.0, 1.0)
    table = alike_table("mine", Alike((other, same), {}, 6))
    assert table.rows[0] == ("left", "right", (0.42, 0.5), (0.4, 0.5), 0.0, 0.2)
    assert table.rows[1] == ("left", "ball", (0.0, 0.05), (0.0, 0.04), 1.0, None)
    assert "Hardly told apart: left and right; try --poses directions26" in table.note
    assert "Hardly told apart: none." in alike_table("mine", Alike((other,), {}, 6)).note


CROSS = Union((Box((0.02, 0.006, 0.006)), Box((0.006, 0.006, 0.02))))


@pytest.mark.parametrize(
    ("shapes", "press", "words"),
    [
        ({"ball": Sphere(0.01)}, None, "it is what is pressed"),
        (
            {"cross": CROSS},
            None,
            "of cross, the convex hull of what lies in front of the pad, which has the same first",
        ),
        ({"torus": EXTENDED_SHAPES["torus"]}, None, "of torus, the convex hull, so force and image may disagree"),
        ({"cross": CROSS, "torus": EXTENDED_SHAPES["torus"]}, Quasistatic(), "it is what is pressed"),
    ],
)
def test_the_inventory_says_which_surface_is_pressed_and_which_is_shown(shapes, press, words):
    scene = replace(SCENES["coarse"].scene, shapes=shapes)
    scene = scene if press is None else replace(scene, press_model=press)
    (why,) = [item.why for item in inventory(scene) if item.part == "surfaces"]
    assert why.startswith("the image shows the true surface")
    assert why.endswith(words) or words in why
    assert ("first touch" in why) == ("same first" in words)
