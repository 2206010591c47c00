"""What a press takes place in: the pad, and only what else was asked for.

The default is the leanest stage in which a touch makes sense, a pad and one object. The paper's stage adds the finger
behind the pad, the pad's height, and the other objects in their parking area (paper §5.1, §5.2); a robot can stand
behind either. None of that changes a touch, so none of it is modelled unless a scene asks for it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from activetouch.pressing.pad import Pad
from activetouch.pressing.robot import Robot
from activetouch.shapes import Shape


@dataclass(frozen=True)
class Stage:
    """The surroundings of a press.

    Attributes:
        pad: the tactile pad, its face in the plane x = 0.
        height: of the pad's centre above the floor [m]; the paper's is 0.07.
        finger: whether the two box segments that carry the pad are there.
        loaded: shapes that are in the model together, all but the pressed one parked; empty to load the pressed one
            only.
        robot: that stands behind the pad; none by default.
    """

    pad: Pad = field(default_factory=Pad)
    height: float = 0.0
    finger: bool = False
    loaded: tuple[Shape, ...] = ()
    robot: Robot | None = None
