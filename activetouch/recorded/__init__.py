"""Recorded touches of real objects as a world: formats, a reader, splits, and searches among recorded objects.

``read_recorded`` reads a set, ``check_recorded`` says whether searches can be played on it.
"""

from activetouch.recorded.checking import check_recorded
from activetouch.recorded.formats import FORMATS, read_recorded
from activetouch.recorded.touches import RecordedTouches
from activetouch.recorded.world import RecordedBank, RecordedWorld

__all__ = ["FORMATS", "RecordedBank", "RecordedTouches", "RecordedWorld", "check_recorded", "read_recorded"]
