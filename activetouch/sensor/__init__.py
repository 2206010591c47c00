"""Sensors: what reads touches, the observation model of what it reads, and the searches that they carry out.

:class:`Sensor` says what every sensor does. :class:`TactileSensor` presses and reads in a scene,
:class:`RecordedSensor` learned from recorded touches.
"""

from activetouch.own_packages import require_own_packages

require_own_packages("planners")

from activetouch.sensor.protocol import Sensor
from activetouch.sensor.recorded import RecordedSensor
from activetouch.sensor.tactile import TactileSensor

__all__ = ["RecordedSensor", "Sensor", "TactileSensor"]
