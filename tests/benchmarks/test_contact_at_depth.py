"""Contacts at a given depth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from activetouch.placement import Placement
from activetouch.poses import random_orientation
from activetouch.pressing.contact import elastic_contact, surface_gap
from activetouch.pressing.pad import Pad
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
