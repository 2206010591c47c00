"""A session's touches in other people's layouts: LeRobot datasets and MCAP files. The extra ``formats`` brings both."""

from activetouch.formats.lerobot import read_lerobot, write_lerobot
from activetouch.formats.mcap_file import read_mcap, write_mcap
from activetouch.formats.session_touches import SessionTouches, TaxelLayout

__all__ = ["SessionTouches", "TaxelLayout", "read_lerobot", "read_mcap", "write_lerobot", "write_mcap"]
