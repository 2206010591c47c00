"""Our height maps against MuJoCo's own tactile sensor, where both are defined."""

import numpy as np
import pytest

from activetouch.poses import Placement, random_orientation
from activetouch.pressing.contact import Pad, first_touch
from activetouch.shapes import EXTENDED_SHAPES, SHAPES
from benchmarks.mujoco_tactile import NativeSensor

pytestmark = pytest.mark.mujoco
PAD = Pad(num_taxels=64)
PRIMITIVES = [name for name, shape in EXTENDED_SHAPES.items() if shape.geom.vertices is None]
DEPTH = 0.002


def both(name, rng, number=12):
    """Native depth and our indentation, of random placements pressed 2 mm deep."""
    sensor = NativeSensor(PAD, EXTENDED_SHAPES[name])
    for _ in range(number):
        offset = rng.uniform(-0.002, 0.002, 2)
        placement = Placement(EXTENDED_SHAPES[name], rng.uniform(0.9, 1.1), random_orientation(rng), offset)
        gap, touching = first_touch(PAD, placement)
        yield sensor.depth(placement, touching - DEPTH), np.maximum(DEPTH - gap, 0.0).ravel()


@pytest.mark.parametrize("name", PRIMITIVES)
def test_both_feel_the_object_at_the_same_taxels(name, rng):
    differing = touched = 0
    for native, ours in both(name, rng):
        differing += ((native > 0.0) != (ours > 0.0)).sum()
        touched += (ours > 0.0).sum()
    assert touched > 1000
    assert differing <= 0.03 * touched  # of MuJoCo's distance to a box, along its edges


def test_on_a_sphere_the_two_depths_follow_from_each_other():
    sensor, radius = NativeSensor(PAD, SHAPES["sphere"]), 0.020
    placement = Placement(SHAPES["sphere"], 1.0, np.array([1.0, 0.0, 0.0, 0.0]))
    gap, touching = first_touch(PAD, placement)
    ours = np.maximum(DEPTH - gap, 0.0).ravel()
    inside = ours > 0.0
    # A taxel h below the surface along x is at the distance √((√(R² − r²) − h)² + r²) from the centre.
    r = np.linalg.norm(PAD.taxel_centres[1:], axis=0)[inside]
    expected = radius - np.hypot(np.sqrt(radius**2 - r**2) - ours[inside], r)
    np.testing.assert_allclose(sensor.depth(placement, touching - DEPTH)[inside], expected, rtol=0, atol=2e-5)  # facets
