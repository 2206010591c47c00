"""Recorded touches of real objects as a world: formats, a reader, splits, and searches among recorded objects.

``read_recorded`` reads a set, ``check_recorded`` says whether searches can be played on it, ``without_incomplete``
leaves out objects that lack touches.
"""

from activetouch.recorded.checking import check_recorded, without_incomplete
from activetouch.recorded.formats import FORMATS, read_recorded
from activetouch.recorded.touches import RecordedTouches, TaskTouches
from activetouch.recorded.world import RecordedBank, RecordedWorld

__all__ = [
    "FORMATS",
    "RecordedBank",
    "RecordedTouches",
    "RecordedWorld",
    "TaskTouches",
    "check_recorded",
    "read_recorded",
    "without_incomplete",
]
