"""Contacts at a given depth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from activetouch.placement import Placement
from activetouch.poses import random_orientation
from activetouch.pressing.contact import elastic_contact, surface_gap
from activetouch.pressing.pad import Pad
from activetouch.rendering import PressureRenderer
from activetouch.shapes import EXTENDED_SHAPES
from benchmarks.leak import contact_at_depth

PAD = Pad(num_taxels=32)


def random_gap(seed, name):
    return surface_gap(PAD, Placement(EXTENDED_SHAPES[name], 1.0, random_orientation(np.random.default_rng(seed))))


seeds, names = st.integers(0, 2**32 - 1), st.sampled_from(list(EXTENDED_SHAPES))


@given(seeds, names, st.floats(1e-3, 20.0), st.floats(0.5, 2.0))
def test_the_depth_of_a_contact_gives_the_contact_back(seed, name, force, stiffness):
    contact = elastic_contact(PAD, random_gap(seed, name), force, stiffness)
    again = contact_at_depth(PAD, contact.gap, contact.depth, stiffness)
    np.testing.assert_array_equal(again.pressure, contact.pressure)
    if contact.is_bottomed_out:  # the layer carries less than the force that was asked of it
        assert again.force <= force * (1 + 1e-9)
    else:
        assert again.force == pytest.approx(force, rel=1e-9)


@given(seeds, names, st.floats(1e-5, 0.00299))
def test_the_force_of_a_depth_gives_the_depth_back(seed, name, depth):
    contact = contact_at_depth(PAD, random_gap(seed, name), depth)
    again = elastic_contact(PAD, contact.gap, contact.force)
    assert again.depth == pytest.approx(depth, rel=1e-9)
    np.testing.assert_allclose(PressureRenderer()(again), PressureRenderer()(contact), atol=1e-9)


@pytest.mark.parametrize("depth", [-1e-6, 0.0031, np.nan, np.inf])
def test_a_depth_the_layer_does_not_have_is_refused(depth):
    with pytest.raises(ValueError, match="depth must be in"):
        contact_at_depth(PAD, np.zeros((32, 32)), depth)
