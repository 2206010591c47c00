"""The time series of a press."""

import numpy as np
import pytest

from activetouch import SHAPES, Dynamic
from activetouch.poses import Placement, random_orientation
from activetouch.pressing.contact import Pad, Phase

pytestmark = pytest.mark.mujoco


def test_a_traced_press_is_the_press_itself(rng):
    placement = Placement(SHAPES["cylinder"], 1.0, random_orientation(rng))
    plain, traced = (Dynamic(traced=t).press(Pad(), placement, 2.0) for t in (False, True))
    assert plain.force == pytest.approx(traced.force, rel=1e-6)  # the plain one skips the free approach
    assert plain.trace is None
    end = traced.trace.end_of_pause
    assert traced.trace.force[end - 1, 0] == pytest.approx(traced.force, rel=1e-6)
    assert [traced.trace.phase[row] for row in (0, end - 1, -1)] == [Phase.APPROACH, Phase.PAUSE, Phase.WITHDRAW]


def test_the_contact_point_lies_under_the_imprint(rng):
    for shape in SHAPES.values():
        placement = Placement(shape, 1.0, random_orientation(rng))
        contact = Dynamic(traced=True).press(Pad(), placement, 2.0)
        point = contact.trace.point[contact.trace.end_of_pause - 1]
        assert np.linalg.norm(point - contact.centre_of_pressure) < 0.006
