"""Answers of a robot to a session, their meaning, and the lines of the session's log (docs/session_log.md)."""

from __future__ import annotations

import dataclasses
import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, Protocol

from numpy.typing import NDArray

from belief.composition import AtMostOne, Composition, Counts
from belief.constraints import NOT_NEGATIVE, NotNegative, check, require_rule
from belief.errors import InvalidArgument
from belief.naming import index_of
from belief.observation_model.model import ObservationModel
from belief.problem import Action, Elsewhere, Probe, SearchProblem, Touch
from belief.validation import are_finite, require_index
from planners.decider import Decision
from planners.episode import ACTION_NAMES, ACTIONS

SCHEMA = "activetouch session 1"
"""First field of the first line; the number grows when a reader of older logs could be misled."""


class OtherModel(InvalidArgument):
    """A log was made with another observation model, reader or decider; the search would not be the same."""


class ImageReader(Protocol):
    """Reads the images that a session is given; a tactile sensor makes one."""

    @property
    def identity(self) -> str:
        """Digest of everything that determines its readings."""

    def read(self, image: Any, pose: int) -> tuple[NDArray[Any], Touch, float | None]:
        """The checked image, the touch that it shows, and the area of the contact [m²], None if it cannot be said."""

    def at(self, place: Any) -> tuple[int, Elsewhere | None]:
        """The pose of a place that is given by numbers; if it is none of the poses, the nearest, and where it is."""


@dataclass(frozen=True, eq=False)
class Told:
    """The answer of a robot to one question.

    ``rng`` is the state of the decider's generator after the decision ``asked``. ``touch`` is None for a miss without
    evidence, and for an action that is no touch; ``image`` is what it was read from, or None. ``force`` [N] and
    ``area`` [m²] are of the contact, if known; ``time`` is in s since 1970.
    """

    asked: Decision
    rng: Mapping[str, Any]
    object_index: int
    touch: Touch | None = None
    is_miss: bool = False
    image: NDArray[Any] | None = None
    force: float | None = None
    area: float | None = None
    time: float = 0.0

    @property
    def kind(self) -> str:
        """Kind of the answer: touch, miss or done."""
        return "miss" if self.is_miss else "done" if self.touch is None else "touch"


@dataclass(frozen=True)
class Listener:
    """Turns answers into :class:`Told`.

    A contact with a stated force of at most ``least_force`` [N], or an area of at most ``least_area`` [m²], is a miss;
    None for no limit. The method ``missed(pose)`` of the model, if it has one, gives the touch that a miss is.
    """

    problem: SearchProblem
    model: ObservationModel
    reader: ImageReader | None
    least_force: NotNegative | None
    least_area: NotNegative | None

    def __post_init__(self) -> None:
        check(self)

    def told(
        self,
        asked: Decision,
        rng: Mapping[str, Any],
        object_index: int,
        touch: Touch | None,
        image: Any,
        missed: bool,
        pose: Any,
        force: float | None,
        area: float | None,
    ) -> Told:
        """What an answer means; see :meth:`planners.session.Session.tell` for its arguments and errors."""
        action = asked.action
        wanted = action.pose if isinstance(action, Probe) else None
        if wanted is None and not missed and all(part is None for part in (touch, image, pose, force, area)):
            return Told(asked, rng, object_index, time=time.time())
        if (touch is not None) + (image is not None) + bool(missed) != 1:
            raise InvalidArgument(
                f"asked was {self._in_words(action)}; a touch is told by one of tell(touch), tell(image=…) and "
                "tell(missed=True), another action that was carried out by tell() without arguments"
            )
        if touch is not None and not isinstance(touch, Touch):
            raise InvalidArgument(f"a touch must be a Touch, such as Touch(pose, logits), got {touch!r:.60}")
        place = next((p for p in (pose, touch.pose if touch else None, wanted) if p is not None), None)
        if place is None:
            raise InvalidArgument(f"asked was {self._in_words(action)}, so say in which pose: tell(…, pose=…)")
        at, elsewhere = self._place(place)
        elsewhere = touch.elsewhere if touch is not None and pose is None else elsewhere
        force, area = _not_negative("force", force), _not_negative("area", area)
        if image is not None:
            if self.reader is None:
                raise InvalidArgument("this session has no reader of images; a sensor's has one: sensor.session(…)")
            image, touch, seen = self.reader.read(image, at)
            area = seen if area is None else area
        is_miss = bool(missed) or _is_within(force, self.least_force) or _is_within(area, self.least_area)
        if is_miss:
            of_miss = getattr(self.model, "missed", None)
            touch = None if of_miss is None else of_miss(at)
        elif touch is not None and (touch.pose != at or touch.elsewhere is not elsewhere):
            touch = replace(touch, pose=at, elsewhere=elsewhere)
        return Told(asked, rng, object_index, touch, is_miss, image, force, area, time.time())

    def _place(self, pose: Any) -> tuple[int, Elsewhere | None]:
        if not isinstance(pose, Mapping):
            return index_of("pose", self.problem.pose_labels, pose), None
        if self.reader is None:
            raise InvalidArgument(
                f"a place that is no pose, such as {pose!r:.80}, needs a session of a sensor: sensor.session(…)"
            )
        return self.reader.at(pose)

    def _in_words(self, action: Action) -> str:
        return f"a touch in pose {self.problem.pose_labels[action.pose]}" if isinstance(action, Probe) else f"{action}"


def standing_of(events: Sequence[Told | None]) -> tuple[list[Told], Told | None]:
    """The answers that were not taken back, and the one that the last event took back, if it did."""
    standing: list[Told] = []
    undone = None
    for event in events:
        undone = standing.pop() if event is None else None
        if event is not None:
            standing.append(event)
    return standing, undone


def _is_within(number: float | None, limit: float | None) -> bool:
    return number is not None and limit is not None and number <= limit


def _not_negative(name: str, value: float | None) -> float | None:
    if value is None:
        return None
    require_rule(name, value, NOT_NEGATIVE)
    return float(value)


def event_fields(told: Told | None, problem: SearchProblem) -> dict[str, Any]:
    """A line of the log; None takes back the last answer that stands."""
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
    from belief.journal import array_field

    if touch is not None:
        line["pose"] = poses[touch.pose]
        line |= {} if touch.elsewhere is None else {"place": list(touch.elsewhere.place)}
        line |= {name: array_field(row) for name in ("logits", "features") if (row := getattr(touch, name)) is not None}
    if told.image is not None:
        line["image"] = array_field(told.image)
    return line | {name: value for name in ("force", "area") if (value := getattr(told, name)) is not None}


def told_from(line: Mapping[str, Any], problem: SearchProblem, reader: ImageReader | None = None) -> Told:
    """The answer in a line of the log."""
    from belief.journal import array_from

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
    numbers = {name: _not_negative(name, line[name]) for name in ("force", "area") if name in line}
    decision = Decision(action, scores)
    at = line["object"]
    require_index("object", at, problem.num_objects)
    return Told(decision, line["rng"], at, touch, kind == "miss", arrays["image"], time=float(line["time"]), **numbers)


def events_from(
    lines: Sequence[Mapping[str, Any]], problem: SearchProblem, reader: ImageReader | None = None
) -> tuple[list[Told | None], list[str | None] | None]:
    """All events of a session, and the true shapes if they were revealed."""
    events: list[Told | None] = []
    truth = None
    for line in lines:
        if line["told"] == "truth":
            truth = line["arrangement"]
        else:
            events.append(None if line["told"] == "undo" else told_from(line, problem, reader))
    return events, truth


def problem_fields(problem: SearchProblem) -> dict[str, Any]:
    """A problem as JSON types; the target says which shape at most one object has."""
    bag = Composition.AT_MOST_ONE if isinstance(problem.composition, AtMostOne) else problem.composition
    return {
        "shapes": list(problem.shape_labels),
        "poses": list(problem.pose_labels),
        "num_objects": int(problem.num_objects),
        "composition": dict(bag.items) if isinstance(bag, Counts) else str(bag),
        "touch_cost": problem.touch_cost,
        "touch_limit": int(problem.touch_limit),
        "unsure_reward": problem.unsure_reward,
        "unlisted": problem.unlisted,
        **({} if problem.opinion is None else {"opinion": problem.opinion}),
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
        fields.get("unlisted", 0.0),
        fields.get("opinion"),
    )


def decider_fields(value: Any) -> Any:
    """Class and settings of a decider as JSON types; arrays and objects other than dataclasses by their class only."""
    if isinstance(value, str | bool | int | None):
        return value
    if isinstance(value, Real):
        return float(value) if are_finite(value) else str(value)
    if isinstance(value, list | tuple):
        return [decider_fields(one) for one in value]
    kind = value if hasattr(value, "__qualname__") else type(value)
    if kind is value or not dataclasses.is_dataclass(value):
        return kind.__qualname__
    settings = [field.name for field in dataclasses.fields(value) if field.init]
    return {"class": kind.__qualname__} | {name: decider_fields(getattr(value, name)) for name in settings}


def differences(begun: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """How the set-up that a session began with differs from another, in words; new fields of the other do not count."""
    found = []
    for name, value in begun.items():
        other = now.get(name)
        if isinstance(value, Mapping) and isinstance(other, Mapping) and value.get("class") == other.get("class"):
            found += differences(value, other)
        elif value != other:
            one, two = (some.get("class", some) if isinstance(some, Mapping) else some for some in (value, other))
            found.append(f"its {name} is {one!r:.200}, not {two!r:.200}")
    return found


def digests(model: ObservationModel, reader: ImageReader | None) -> dict[str, str | None]:
    """SHA-256 of an observation model, None for one that cannot be written; and of a reader of images."""
    to_json = getattr(model, "to_json", None)
    digest = None if to_json is None else hashlib.sha256(to_json().encode()).hexdigest()
    return {"model_sha256": digest, "reader_sha256": None if reader is None else reader.identity}


def require_same(header: Mapping[str, Any], model: ObservationModel, reader: ImageReader | None) -> None:
    """Check that a log can be continued with this model and reader."""
    if (schema := header.get("schema")) != SCHEMA:
        raise ValueError(f"its schema is {schema!r:.60}, not {SCHEMA!r}")
    for what, digest in digests(model, reader).items():
        if header[what] is not None and header[what] != digest:
            raise OtherModel(
                f"the session began with another {what.removesuffix('_sha256')} than this one; give its own sensor"
            )
