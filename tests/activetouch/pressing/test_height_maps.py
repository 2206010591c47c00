"""Predicted contacts: the gaps of presses, in batches, of solids and meshes alike."""

import numpy as np
import pytest
import trimesh

from activetouch import Window, predicted_contacts
from activetouch.poses import Placement, multiply, random_orientation, turn
from activetouch.pressing.contact import Pad, first_touch
from activetouch.shapes import EXTENDED_SHAPES, Mesh
from belief.errors import InvalidArgument

PAD = Pad(num_taxels=24)
RING = trimesh.creation.torus(0.014, 0.006)
BODIES = {**EXTENDED_SHAPES, "mesh": Mesh("ring", RING.vertices, RING.faces)}


def draw(rng, num):
    rotations = np.array([random_orientation(rng) for _ in range(num)])
    return rotations, rng.uniform(-0.005, 0.005, (num, 2)), rng.uniform(0.8, 1.2, num)


@pytest.mark.parametrize("name", BODIES)
def test_the_gap_of_a_press_is_how_far_the_surface_lies_behind_its_highest_point(name, rng):
    rotations, offsets, scales = draw(rng, 10)
    maps = predicted_contacts(BODIES[name], rotations, offsets, Window.of(PAD), scales)
    for heights, *placed in zip(maps, scales, rotations, offsets, strict=True):
        gap, touching = first_touch(PAD, Placement(BODIES[name], *placed))
        expected = heights.max() - heights
        felt = expected <= PAD.max_depth
        np.testing.assert_allclose(gap[felt], expected[felt], rtol=0, atol=1e-5)
        assert (gap >= expected - 1e-12).all()  # farther down, a gap may be too large
        assert heights.max() == pytest.approx(touching, abs=1e-5)


@pytest.mark.parametrize("name", ["cone", "mesh"])
def test_a_wider_window_shows_the_same_in_its_middle(name, rng):
    rotations, offsets, scales = draw(rng, 5)
    wide = Window.of(PAD, margin=0.0021)
    assert wide.num_pixels == 24 + 2 * 2
    assert wide.edge == pytest.approx(28 * 2 * PAD.half_width / 24)
    inner = predicted_contacts(BODIES[name], rotations, offsets, wide, scales)[:, 2:-2, 2:-2]
    expected = predicted_contacts(BODIES[name], rotations, offsets, Window.of(PAD), scales)
    np.testing.assert_allclose(inner, expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("name", ["wedge", "mesh"])
def test_a_quarter_turn_about_the_approach_axis_turns_the_map(name, rng):
    rotation, quarter = random_orientation(rng), turn("x", np.pi / 2)
    upright, rolled = predicted_contacts(
        BODIES[name], [rotation, multiply(quarter, rotation)], [0.0, 0.0], Window(0.04, 30)
    )
    np.testing.assert_allclose(np.rot90(upright, -1), rolled, rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rotations": [1.0, 0, 0, 0]}, r"\(n, 4\).*\(4,\)"),
        ({"offsets": np.zeros((3, 2))}, r"offsets \(n, 2\).*\(3, 2\)"),
        ({"scales": [1.0, 2.0]}, r"scales \(n,\)"),
        ({"scales": 0.0}, "above zero"),
        ({"offsets": [np.nan, 0.0]}, "finite"),
        ({"offsets": [1e300, 0.0]}, "finite, up to"),
        ({"scales": 1e300}, "above zero, from"),
        ({"rotations": "no"}, "must be numbers"),
        ({"dtype": np.uint8}, "dtype must be of floats"),
        ({"rotations": [[1.0, 1, 0, 0]]}, "unit quaternion"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, said):
    given = {"rotations": [[1.0, 0, 0, 0]], "offsets": [0.0, 0.0], "scales": 1.0} | change
    with pytest.raises(InvalidArgument, match=said):
        predicted_contacts(EXTENDED_SHAPES["cube"], window=Window(0.03, 8), **given)
