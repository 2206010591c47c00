"""Sensors: readers of touches, the observation models of the readings, and the searches that sensors carry out.

:class:`Sensor` says what every sensor does. :class:`TactileSensor` presses and reads in a scene,
:class:`RecordedSensor` learned from recorded touches.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from activetouch.own_packages import require_own_packages

require_own_packages("planners")

from belief.naming import later

if TYPE_CHECKING:
    from activetouch.sensor.protocol import Sensor
    from activetouch.sensor.recorded import RecordedSensor
    from activetouch.sensor.tactile import TactileSensor

__all__ = ["RecordedSensor", "Sensor", "TactileSensor"]

__getattr__, __dir__ = later(__name__)
