"""The elastic foundation: force balance, closed forms, limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from activetouch.poses import POSES, Placement, multiply, random_orientation
from activetouch.pressing.contact import Pad, elastic_contact, surface_gap
from activetouch.shapes import EXTENDED_SHAPES, SHAPES

PAD = Pad()
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@given(st.integers(0, 2**32 - 1), st.sampled_from(list(EXTENDED_SHAPES)), st.floats(1e-3, 50.0))
def test_the_integrated_pressure_is_the_force_or_the_layer_bottomed_out(seed, name, force):
    rng = np.random.default_rng(seed)
    contact = elastic_contact(
        PAD, surface_gap(PAD, Placement(EXTENDED_SHAPES[name], 1.0, random_orientation(rng))), force
    )
    carried = contact.pressure.sum() * PAD.taxel_area
    if contact.is_bottomed_out:
        assert carried <= force * (1 + 1e-9)
    else:
        assert carried == pytest.approx(force, rel=1e-9)


@given(
    st.lists(st.sampled_from([0.0, 1e-4, 1e-3, 0.00299, 0.003, 0.1, np.inf]), min_size=1, max_size=5),
    st.sampled_from([1e-9, 1e-3, 0.1, 1.0, 10.0]),
)
def test_any_gaps_are_pressed_as_deep_as_carries_the_force_or_to_the_bottom(gaps, force):
    gap = np.array(gaps)

    def carried(depth):
        return PAD.stiffness * PAD.taxel_area * sum(max(0.0, depth - g) for g in gaps)

    depth = PAD.indentation(gap, force)
    if min(gaps) >= PAD.max_depth:  # nothing within reach
        assert depth == 0.0
    elif carried(PAD.max_depth) <= force:
        assert depth == PAD.max_depth
    else:
        assert carried(depth) == pytest.approx(force, rel=1e-9)


def test_a_sphere_leaves_a_circle_of_the_radius_geometry_demands():
    for force in (0.5, 2.0, 3.0):
        contact = elastic_contact(PAD, surface_gap(PAD, Placement(SHAPES["sphere"], 1.0, UPRIGHT)), force)
        area = (contact.pressure > 0).sum() * PAD.taxel_area
        expected = np.sqrt(2 * 0.020 * contact.depth - contact.depth**2)
        taxel = 2 * PAD.half_width / PAD.num_taxels
        assert np.sqrt(area / np.pi) == pytest.approx(expected, abs=taxel)


def test_a_roll_about_the_approach_axis_rotates_the_image():
    quarter = np.array([np.cos(np.pi / 4), np.sin(np.pi / 4), 0.0, 0.0])
    rng = np.random.default_rng(0)
    for name, shape in SHAPES.items():
        orientation = random_orientation(rng)
        before = surface_gap(PAD, Placement(shape, 1.0, orientation))
        after = surface_gap(PAD, Placement(shape, 1.0, multiply(quarter, orientation)))
        # +90° about x carries y to z: rows of the image run along z, columns along y.
        np.testing.assert_allclose(after, np.rot90(before, -1), atol=1e-5, err_msg=name)


def test_an_object_beside_the_pad_leaves_a_blank_image():
    gap = surface_gap(PAD, Placement(SHAPES["sphere"], 1.0, UPRIGHT, np.array([0.05, 0.0])))
    contact = elastic_contact(PAD, gap, 2.0)
    assert np.isinf(gap).all()
    assert contact.depth == 0.0
    assert not contact.pressure.any()


@pytest.mark.parametrize("force", [-1.0, np.nan, np.inf])
def test_a_force_that_is_none_is_refused(force):
    with pytest.raises(ValueError, match="force must be a finite number ≥ 0"):
        PAD.indentation(np.zeros((2, 2)), force)


def test_the_poses_turn_six_different_sides_to_the_pad():
    # Pad normal in the object frame, up to sign: no two poses may share it.
    from activetouch.poses import to_matrix

    normals = np.array([to_matrix(pose)[0] for pose in POSES.values()])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    cosines = np.abs(normals @ normals.T) - np.eye(len(normals))
    assert cosines.max() < 0.82  # at least 35 degrees apart
