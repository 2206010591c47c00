"""The pad and its surroundings, which do not change touches and are therefore optional (decision 0010).

The paper's scene has a finger behind the pad, a height of the pad, and a parking area (paper §5.1, §5.2).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from activetouch.pressing.pad import Pad
from activetouch.solids.solid import Shape


@dataclass(frozen=True)
class Setup:
    """The pad and its surroundings.

    Attributes:
        pad: the tactile pad, its face in the plane x = 0.
        height: of the pad's centre above the floor [m]; the paper's is 0.07.
        finger: whether to model the two box segments that carry the pad.
        loaded: shapes in the model, all but the pressed one parked; if empty, the model has only the pressed one.
    """

    pad: Pad = field(default_factory=Pad)
    height: float = 0.0
    finger: bool = False
    loaded: tuple[Shape, ...] = ()
