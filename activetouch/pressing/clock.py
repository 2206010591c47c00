"""MuJoCo's clock, which costs a fifth of a press."""

from __future__ import annotations

import ctypes
from pathlib import Path

import mujoco


def stop_clock() -> None:
    """Let MuJoCo measure no times of its own, in this process: ``mjData.timer`` then reads 0.

    The Python package gives MuJoCo a clock, which every step reads some thirty times. It is taken away where the
    library is found beside the package; elsewhere nothing changes. ``mujoco.set_mjcb_time`` sets another.
    """
    for path in Path(mujoco.__file__).parent.glob("*mujoco.*"):
        try:
            clock = ctypes.c_void_p.in_dll(ctypes.CDLL(str(path)), "mjcb_time")
        except (OSError, ValueError):  # not the library, or one without this variable
            continue
        clock.value = None
