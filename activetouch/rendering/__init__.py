"""Renderers, which map contacts to tactile images, and faults of the sensor.

To add a renderer, write a class with the members of :class:`TactileRenderer` in a file here and one line in
:data:`RENDERERS`; to add a fault, write a class with the members of :class:`Fault`.
"""

from collections.abc import Mapping
from types import MappingProxyType

from activetouch.rendering.faults import (
    Blur,
    DeadTaxels,
    Fault,
    Gain,
    Hysteresis,
    Noise,
    Quantisation,
    Shift,
    StuckTaxels,
    read_out,
)
from activetouch.rendering.renderer import (
    ForcePatchRenderer,
    GelSightRenderer,
    PressureRenderer,
    TactileRenderer,
    check_renderer,
)

RENDERERS: Mapping[str, TactileRenderer] = MappingProxyType(
    {"force_patch": ForcePatchRenderer(), "pressure": PressureRenderer(), "gelsight": GelSightRenderer()}
)
"""The renderers by name, with default settings."""

__all__ = [
    "RENDERERS",
    "Blur",
    "DeadTaxels",
    "Fault",
    "ForcePatchRenderer",
    "Gain",
    "GelSightRenderer",
    "Hysteresis",
    "Noise",
    "PressureRenderer",
    "Quantisation",
    "Shift",
    "StuckTaxels",
    "TactileRenderer",
    "check_renderer",
    "read_out",
]
