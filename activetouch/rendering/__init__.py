"""From contacts to tactile images: renderers, and the sensor's imperfections.

A renderer is a callable ``(contact) -> TactileImage``. To add one, write it in a file here and name it below.
"""

from activetouch.rendering.imperfection import Imperfection
from activetouch.rendering.pressure import PressureRenderer

__all__ = ["Imperfection", "PressureRenderer"]
