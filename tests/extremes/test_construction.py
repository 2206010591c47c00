"""Settings that mean nothing are refused at construction, and the message names the setting."""

import math

import pytest

from activetouch import Dynamic
from activetouch.distributions import Constant, LogUniform, Uniform
from activetouch.pressing.contact import Pad
from activetouch.pressing.dynamic import GuardedMove
from activetouch.rendering import DeadTaxels, Gain, Hysteresis, Noise, PressureRenderer, Quantisation
from activetouch.shapes import Box, Cylinder, Sphere

_NAN, _INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("make", "pattern"),
    [
        pytest.param(
            lambda: Dynamic(timestep=0.02, speed=1.0),
            "pass through the pad",
            id="Dynamic: a step longer than the pad is thick",
        ),
        pytest.param(lambda: Dynamic(timestep=0.0), "timestep", id="Dynamic: a time step of zero"),
        pytest.param(lambda: Dynamic(timestep=_NAN), "timestep", id="Dynamic: a time step of NaN"),
        pytest.param(lambda: GuardedMove(pause=0.0), "pause", id="GuardedMove: no pause"),
        pytest.param(lambda: Pad(num_taxels=0), "num_taxels", id="Pad: no taxels"),
        pytest.param(lambda: Pad(half_width=_NAN), "half_width", id="Pad: a width of NaN"),
        pytest.param(lambda: Pad(stiffness=0.0), "stiffness", id="Pad: a stiffness of zero"),
        pytest.param(lambda: Pad(max_depth=_INF), "max_depth", id="Pad: an infinite depth"),
        pytest.param(lambda: Sphere(0.0), "above zero, got Sphere.radius=0", id="Sphere: a radius of zero"),
        pytest.param(lambda: Sphere(_NAN), "radius", id="Sphere: a radius of NaN"),
        pytest.param(lambda: Box((0.01, -0.01, 0.01)), "half_extents", id="Box: a negative edge"),
        pytest.param(lambda: Cylinder(0.01, _INF), "half_length", id="Cylinder: an infinite length"),
        pytest.param(lambda: Uniform(2.0, 1.0), "low must not exceed high", id="Uniform: low above high"),
        pytest.param(lambda: Constant(_NAN), "finite", id="Constant: NaN"),
        pytest.param(lambda: LogUniform(0.0, 1.0), "low must be a finite number", id="LogUniform: a low end of zero"),
        pytest.param(lambda: PressureRenderer(binning=0), "binning", id="PressureRenderer: bins of zero"),
        pytest.param(lambda: DeadTaxels(1.5), "1.5", id="DeadTaxels: a share of 1.5"),
        pytest.param(lambda: Quantisation(0), "bits", id="Quantisation: no bits"),
        pytest.param(lambda: Noise(_NAN), "std", id="Noise: a deviation of NaN"),
        pytest.param(lambda: Gain(-0.1), "half_range", id="Gain: half a range of -0.1"),
        pytest.param(lambda: Hysteresis(_NAN), "width", id="Hysteresis: a width of NaN"),
    ],
)
def test_a_setting_out_of_its_range_is_refused_by_name(make, pattern):
    with pytest.raises(ValueError, match=pattern):
        make()
