"""A session in the viewer of Rerun (the extra ``view``): what was felt, the belief, the likeliest body, each answer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from activetouch import RecordedSensor, TactileSensor
from activetouch.view import Bodies, coloured
from belief.files import require_writable_file
from belief.observation_model.rigid_body_evidence import innermost
from planners import Session


def viewer(sensor: TactileSensor | RecordedSensor, place: Path) -> Callable[[Session, bytes, Any], None]:
    """A function that shows a session after an answer, and the image that was told, if one was.

    It shows them in a window, if the place is "window", or else in a file. Time is the session's step.
    """
    import rerun

    bodies = Bodies.of(sensor) if isinstance(sensor, TactileSensor) else None
    stream = rerun.RecordingStream("activetouch live")
    if place == Path("window"):
        stream.spawn()
    else:
        require_writable_file(place)
        place.parent.mkdir(parents=True, exist_ok=True)
        stream.save(place)

    def show(session: Session, answer: bytes, felt: Any) -> None:
        at, belief = session.object_index, session.belief
        stream.set_time("step", sequence=session.step)
        stream.log("answer", rerun.TextLog(answer.decode().strip()))
        stream.log("belief/words", rerun.TextDocument(f"object {at + 1}: {belief}"))
        stream.log("belief/bars", rerun.BarChart(belief.probs))
        if felt is not None and np.ndim(felt) > 1:
            stream.log("felt", rerun.Image(np.asarray(felt, np.uint8)[::-1]))
        if felt is not None and bodies is not None:
            evidence: Any = session.scene.evidence(at)
            [(_, prob, picture)] = bodies.likeliest(innermost(evidence), belief.probs, 1)
            stream.log("body", rerun.Image(np.uint8(255 * coloured(picture, prob)[::-1])))

    return show
