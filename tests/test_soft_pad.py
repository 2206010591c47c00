"""Presses into a pad that deforms: what a soft block does that springs do not, and where both agree."""

import numpy as np
import pytest

from activetouch.poses import POSES, Placement
from activetouch.pressing.contact import Pad, Quasistatic
from activetouch.shapes import SHAPES
from examples.soft_pad import Deformable

pytestmark = pytest.mark.mujoco

PAD = Pad()
COARSE = Deformable(nodes=13, layers=3)  # an eighth of the default's time


def sphere(**placement):
    return Placement(SHAPES["sphere"], 1.0, np.array([1.0, 0.0, 0.0, 0.0]), **placement)


def bonded_layer_force(depth: float, radius: float, press: Deformable) -> float:
    """Force of a sphere on an elastic layer bonded to a rigid base (Dimitriadis et al. 2002, eq. 13)."""
    nu = press.poisson
    a = -(1.2876 - 1.4678 * nu + 1.3442 * nu**2) / (1 - nu)
    b = (0.6387 - 1.0277 * nu + 1.5164 * nu**2) / (1 - nu)
    x = np.sqrt(radius * depth) / (2 * PAD.half_thickness) / np.pi
    thin = 1 - 2 * a * x + 4 * (a * x) ** 2 - 8 * (a**3 + 4 * np.pi**2 / 15 * b) * x**3
    thin += 16 * a * (a**3 + 3 * np.pi**2 / 5 * b) * x**4
    return 4 / 3 * press.young / (1 - nu**2) * np.sqrt(radius) * depth**1.5 * thin


def test_a_sphere_sinks_as_far_as_contact_mechanics_and_the_elastic_foundation_say():
    press = Deformable(nodes=17)
    soft, springs = press.press(PAD, sphere(), 2.0), Quasistatic().press(PAD, sphere(), 2.0)
    # The formula's layer has no sides, so the block is a little softer.
    assert bonded_layer_force(soft.depth, 0.020, press) == pytest.approx(soft.force, rel=0.15)
    assert soft.depth == pytest.approx(springs.depth, rel=0.03)
    assert np.corrcoef(soft.indentation.ravel(), springs.indentation.ravel())[0, 1] > 0.95
    assert np.corrcoef(soft.pressure.ravel(), springs.pressure.ravel())[0, 1] > 0.95


def test_the_face_dips_beside_an_edge_where_springs_stay_flat():
    edge = Placement(SHAPES["cube"], 1.0, POSES["z45"])
    soft, springs = (press.press(PAD, edge, 2.0) for press in (COARSE, Quasistatic()))
    beside = springs.indentation == 0.0
    assert soft.indentation[beside].max() > 0.2 * soft.depth
