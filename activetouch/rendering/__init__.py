"""From contacts to tactile images: renderers, and the sensor's imperfections.

To add a renderer, write a class with the call of :class:`TactileRenderer` in a file here and name it below.
"""

from activetouch.rendering.imperfection import Imperfection
from activetouch.rendering.pressure import PressureRenderer
from activetouch.rendering.renderer import TactileRenderer

__all__ = ["Imperfection", "PressureRenderer", "TactileRenderer"]
