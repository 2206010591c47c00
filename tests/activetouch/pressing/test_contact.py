"""Contacts at a given depth, and contacts that borrow the force and depth of others."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from activetouch.placement import Placement
from activetouch.poses import random_orientation
from activetouch.pressing.contact import contact_at_depth, elastic_contact, surface_gap, with_numbers_of
from activetouch.pressing.pad import Pad
from activetouch.pressing.trace import Phase, Trace
from activetouch.rendering import RENDERERS, ForcePatchRenderer, PressureRenderer
from activetouch.shapes import EXTENDED_SHAPES, SHAPES

PAD = Pad(num_taxels=32)


def random_gap(seed, name):
    return surface_gap(PAD, Placement(EXTENDED_SHAPES[name], 1.0, random_orientation(np.random.default_rng(seed))))


def held(force, point=(0.001, -0.002), steps=30):
    """A trace that holds a force vector at a point."""
    return Trace(
        time=0.002 * np.arange(steps),
        position=np.zeros((steps, 3)),
        force=np.tile(np.asarray(force, float), (steps, 1)),
        point=np.tile(point, (steps, 1)),
        phase=[Phase.PAUSE] * steps,
    )


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


@given(seeds, names, names, st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_what_is_touched_at_a_lent_depth_follows_from_the_geometry_alone(seed, name, lender_name, force, lender_force):
    contact = elastic_contact(PAD, random_gap(seed, name), force)
    lender = elastic_contact(PAD, random_gap(seed + 1, lender_name), lender_force)
    shown = with_numbers_of(lender, contact)
    np.testing.assert_array_equal(shown.pressure > 0.0, contact.gap < lender.depth)
    assert (shown.depth, shown.force) == (lender.depth, lender.force)


@pytest.mark.parametrize("renderer", RENDERERS.values(), ids=RENDERERS)
def test_a_contact_that_borrows_from_itself_looks_the_same(renderer):
    for trace in (None, held([2.0, 0.3, 0.0])):
        contact = elastic_contact(PAD, random_gap(0, "cone"), 2.0, trace=trace)
        np.testing.assert_array_equal(renderer(with_numbers_of(contact, contact)), renderer(contact))


@pytest.mark.parametrize("renderer", RENDERERS.values(), ids=RENDERERS)
def test_a_contact_that_borrows_from_the_same_object_pressed_harder_looks_like_that(renderer):
    gap = random_gap(1, "wedge")
    for traces in ((None, None), (held([0.5, 0.0, 0.0]), held([2.0, 0.0, 0.0]))):
        gentle, hard = (elastic_contact(PAD, gap, f, trace=t) for f, t in zip((0.5, 2.0), traces, strict=True))
        assert (renderer(gentle) != renderer(hard)).any()
        np.testing.assert_allclose(renderer(with_numbers_of(hard, gentle)), renderer(hard), atol=1e-12)


def test_a_force_patch_with_a_lent_force_stays_at_its_own_point():
    gap, patch = random_gap(2, "cube"), ForcePatchRenderer()
    contact = elastic_contact(PAD, gap, 1.0, trace=held([1.0, 0.4, 0.0], point=(0.004, 0.0)))
    lender = elastic_contact(PAD, gap, 3.0, trace=held([3.0, 0.0, 0.0], point=(-0.006, 0.002)))
    expected = elastic_contact(PAD, gap, 3.0, trace=held([3.0, 0.0, 0.0], point=(0.004, 0.0)))
    np.testing.assert_array_equal(patch(with_numbers_of(lender, contact)), patch(expected))


def test_a_miss_stays_blank_whoever_lends_and_lends_nothing_itself():
    miss = elastic_contact(PAD, np.full((32, 32), np.inf), 2.0, trace=held([0.0, 0.0, 0.0]))
    sphere = elastic_contact(PAD, surface_gap(PAD, Placement(SHAPES["sphere"], 1.0, np.array([1.0, 0, 0, 0]))), 2.0)
    assert not with_numbers_of(sphere, miss).pressure.any()
    assert not with_numbers_of(miss, sphere).pressure.any()
    assert not with_numbers_of(miss, elastic_contact(PAD, sphere.gap, 1.0, trace=held([1.0, 0, 0]))).trace.force.any()
