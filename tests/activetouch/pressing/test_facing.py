"""Simulated presses of hollow objects touch the surface that the image shows, and others are as they were."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from activetouch.poses import Placement, facing, random_orientation, to_matrix
from activetouch.pressing.contact import Pad, first_touch
from activetouch.pressing.dynamic import Dynamic, GuardedMove, facing_geom
from activetouch.shapes import Box, Mesh, Union

PAD = Pad(num_taxels=48)
_CROSS = Union((Box((0.03, 0.008, 0.008)), Box((0.008, 0.008, 0.03))))


def _revolved(profile):
    mesh = trimesh.creation.revolve(np.array(profile), sections=48)
    return Mesh("revolved", mesh.vertices, mesh.faces)


def _bowl(radius=0.05, wall=0.004):
    angle = np.linspace(-np.pi / 2, 0.0, 25)
    outside = np.column_stack([np.cos(angle), np.sin(angle)]) * radius
    return _revolved([*outside, *(outside[::-1] * (radius - wall) / radius)])


BOWL = _bowl()
INTO_THE_BOWL = facing((0.0, 0.0, 1.0))


def first_force(press, placement):
    """Position of the object's centre when the pad first feels it in a press of 1 N, and at the first touch."""
    contact = press.press(PAD, placement, 1.0)
    felt = np.flatnonzero(np.abs(contact.trace.force).sum(axis=1))
    return contact.trace.position[felt[0], 0], first_touch(PAD, placement)[1]


@pytest.mark.parametrize("press", [Dynamic(speed=0.02, traced=True), GuardedMove()])
@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.004, -0.003)])
def test_the_force_in_a_bowl_begins_where_the_image_has_its_surface(press, offset):
    placement = Placement(BOWL, 1.1, INTO_THE_BOWL, np.array(offset))
    position, touching = first_force(press, placement)
    assert touching < -0.03  # deep in the bowl, whose centre of curvature is the origin
    assert position == pytest.approx(touching, abs=1e-4)


@pytest.mark.parametrize("shape", [BOWL, _CROSS], ids=["bowl", "cross"])
def test_hollow_shapes_are_met_at_their_surface_from_all_sides(shape, rng):
    for _ in range(5):
        placement = Placement(shape, rng.uniform(0.5, 1.5), random_orientation(rng), rng.uniform(-0.003, 0.003, 2))
        position, touching = first_force(GuardedMove(), placement)
        exact = first_touch(replace(PAD, num_taxels=512), placement)[1]  # a tip may be between two taxels
        assert touching - 1e-4 <= position <= max(touching, exact) + 1e-4


def test_what_the_pad_meets_lies_on_the_surface_and_reaches_the_first_touch():
    placement = Placement(BOWL, 1.2, facing((0.2, -0.1, 1.0)), np.array([0.002, 0.001]))
    gap, touching = first_touch(PAD, placement)
    found = (to_matrix(placement.orientation) @ facing_geom(PAD, placement, gap, touching).vertices.T) * 1.2
    assert found[0].min() == pytest.approx(-touching)
    beside = np.abs(found[1:] + placement.offset[:, None]).max()
    assert beside <= PAD.half_width + 1e-9
