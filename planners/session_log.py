"""The lines of a session's log (docs/session_log.md), from what they mean and back."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping, Sequence
from typing import Any

from belief.composition import Counts
from belief.errors import InvalidArgument
from belief.journal import array_field, array_from
from belief.naming import index_of
from belief.observation_model.model import ObservationModel
from belief.problem import Probe, SearchProblem, Touch
from planners.decider import Decision
from planners.episode import ACTION_NAMES, ACTIONS
from planners.told import ImageReader, Told

SCHEMA = "activetouch session 1"
"""First field of the first line; the number grows when a reader of older logs could be misled."""


class OtherModel(InvalidArgument):
    """A log was made with another observation model or reader; its beliefs would not be the same."""


def event_fields(told: Told | None, problem: SearchProblem) -> dict[str, Any]:
    """A line of the log; None takes back the last that stands."""
    if told is None:
        return {"told": "undo", "time": time.time()}
    action, touch, poses = told.asked.action, told.touch, problem.pose_labels
    line: dict[str, Any] = {
        "told": told.kind,
        "object": told.object_index,
        "time": told.time,
        "asked": {"pose": poses[action.pose]} if isinstance(action, Probe) else ACTION_NAMES[type(action)],
        "scores": dict(told.asked.scores),
        "rng": told.rng,
    }
    if touch is not None:
        line["pose"] = poses[touch.pose]
        line |= {} if touch.elsewhere is None else {"place": list(touch.elsewhere.place)}
        line |= {name: array_field(row) for name in ("logits", "features") if (row := getattr(touch, name)) is not None}
    if told.image is not None:
        line["image"] = array_field(told.image)
    return line | {name: value for name in ("force", "area") if (value := getattr(told, name)) is not None}


def told_from(line: Mapping[str, Any], problem: SearchProblem, reader: ImageReader | None = None) -> Told:
    """What a line of the log says.

    Raises:
        KeyError, TypeError, ValueError: it is no such line.
    """
    asked, arrays = line["asked"], {}
    for name in ("logits", "features", "image"):
        arrays[name] = array_from(line[name]) if name in line else None
    action = ACTIONS[asked] if isinstance(asked, str) else Probe(index_of("pose", problem.pose_labels, asked["pose"]))
    scores = {str(name): float(value) for name, value in line["scores"].items()}
    if (kind := line["told"]) not in ("touch", "miss", "done"):
        raise ValueError(f"nothing known was told: {kind!r}")
    touch = None
    if "pose" in line:
        pose = index_of("pose", problem.pose_labels, line["pose"])
        if "place" in line and reader is None:
            raise ValueError("a touch was made at a place that is no pose; give the reader that the session began with")
        elsewhere = reader.at({"place": line["place"]})[1] if "place" in line and reader is not None else None
        touch = Touch(pose, arrays["logits"], arrays["features"], elsewhere)
    if kind != "miss" and (touch is None) == (kind == "touch"):
        raise ValueError("a touch needs a pose, and an action that is no touch has none")
    numbers = {name: float(line[name]) for name in ("force", "area") if name in line}
    decision = Decision(action, scores)
    at = int(line["object"])
    return Told(decision, line["rng"], at, touch, kind == "miss", arrays["image"], time=float(line["time"]), **numbers)


def events_from(
    lines: Sequence[Mapping[str, Any]], problem: SearchProblem, reader: ImageReader | None = None
) -> tuple[list[Told | None], list[str | None] | None]:
    """All events of a session, and the true shapes if they were revealed.

    Raises:
        LookupError, TypeError, ValueError: they are no such lines.
    """
    events: list[Told | None] = []
    truth = None
    for line in lines:
        if line["told"] == "truth":
            truth = line["arrangement"]
        else:
            events.append(None if line["told"] == "undo" else told_from(line, problem, reader))
    return events, truth


def problem_fields(problem: SearchProblem) -> dict[str, Any]:
    """A problem as JSON types."""
    bag = problem.composition
    return {
        "shapes": list(problem.shape_labels),
        "poses": list(problem.pose_labels),
        "num_objects": int(problem.num_objects),
        "composition": dict(bag.items) if isinstance(bag, Counts) else str(bag),
        "touch_cost": problem.touch_cost,
        "touch_limit": int(problem.touch_limit),
        "unsure_reward": problem.unsure_reward,
    }


def problem_from(fields: Mapping[str, Any]) -> SearchProblem:
    """The problem of :func:`problem_fields`."""
    bag = fields["composition"]
    return SearchProblem(
        tuple(fields["shapes"]),
        tuple(fields["poses"]),
        fields["num_objects"],
        Counts(bag) if isinstance(bag, dict) else bag,
        fields["touch_cost"],
        fields["touch_limit"],
        fields["unsure_reward"],
    )


def digests(model: ObservationModel, reader: ImageReader | None) -> dict[str, str | None]:
    """SHA-256 of an observation model, None for one that cannot be written; and of a reader of images."""
    to_json = getattr(model, "to_json", None)
    digest = None if to_json is None else hashlib.sha256(to_json().encode()).hexdigest()
    return {"model_sha256": digest, "reader_sha256": None if reader is None else reader.identity}


def require_same(header: Mapping[str, Any], model: ObservationModel, reader: ImageReader | None) -> None:
    """Check that a log can be gone on with.

    Raises:
        ValueError: it has another schema.
        OtherModel: it was made with another observation model or reader.
    """
    if (schema := header.get("schema")) != SCHEMA:
        raise ValueError(f"its schema is {schema!r:.60}, not {SCHEMA!r}")
    for what, digest in digests(model, reader).items():
        if header[what] is not None and header[what] != digest:
            raise OtherModel(
                f"the session began with another {what.removesuffix('_sha256')} than this one; give its own sensor"
            )
