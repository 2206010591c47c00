"""The surroundings of a press: the pad, and what else a scene asks for.

The default is a pad and one object. The paper adds the finger behind the pad, the pad's height, and the other objects
in their parking area (paper §5.1, §5.2); a robot can stand behind either. None of these changes a touch, so none is
modelled unless a scene asks for it (decision 0010).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from activetouch.pressing.pad import Pad
from activetouch.pressing.robot import Robot
from activetouch.shapes import Shape


@dataclass(frozen=True)
class Setup:
    """The surroundings of a press.

    Attributes:
        pad: the tactile pad, its face in the plane x = 0.
        height: of the pad's centre above the floor [m]; the paper's is 0.07.
        finger: whether the two box segments that carry the pad are modelled.
        loaded: shapes that are in the model together, all but the pressed one parked; empty to load only the pressed
            one.
        robot: the robot behind the pad; none by default.
    """

    pad: Pad = field(default_factory=Pad)
    height: float = 0.0
    finger: bool = False
    loaded: tuple[Shape, ...] = ()
    robot: Robot | None = None
