"""What sessions of all kinds of searches share, and the answers and lines of a log of searches among objects.

A session numbers its questions and keeps all answers, so that :meth:`AskAndTell.undo` and a log (docs/session_log.md)
lead to the same state again, by the same sums in the same order.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from belief.composition import AtMostOne, Composition, Counts
from belief.constraints import NOT_NEGATIVE, NotNegative, check, require_rule
from belief.errors import CorruptFile, InvalidArgument
from belief.naming import index_of
from belief.observation_model.model import ObservationModel
from belief.problem import Action, Elsewhere, Probe, SearchProblem, Touch
from belief.search_progress import Outcome
from belief.seeding import checked_key, deciding_rng
from belief.validation import are_finite, require_index
from planners.decider import Decision
from planners.episode import ACTION_NAMES, ACTIONS

if TYPE_CHECKING:
    from belief.journal import Journal

SCHEMA = "activetouch session 1"
"""First field of the first line; the number grows when a reader of older logs could be misled."""

_NOT_OF_THE_SEARCH = {"schema", "time", "arrangement", "decider", "stop_rule", "model_sha256", "reader_sha256"}


class OtherModel(InvalidArgument):
    """A log was made with another observation model, reader or decider; the search would not be the same."""


class AlreadyTold(InvalidArgument):
    """A question was answered twice, or an answer came late; nothing has changed."""


class Answer(Protocol):
    """What was told in answer to one question."""

    @property
    def asked(self) -> Any:
        """The decision that was answered; None where nothing was asked."""

    @property
    def rng(self) -> Mapping[str, Any]:
        """State of the decider's generator after that decision."""

    @property
    def kind(self) -> str:
        """Kind of the answer: touch, miss or done."""


AnswerT = TypeVar("AnswerT", bound=Answer)


def standing_of(events: Sequence[AnswerT | None]) -> tuple[list[AnswerT], AnswerT | None]:
    """The answers that were not taken back, and the one that the last event took back, if it did."""
    standing: list[AnswerT] = []
    undone = None
    for event in events:
        undone = standing.pop() if event is None else None
        if event is not None:
            standing.append(event)
    return standing, undone


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Errors of what a log holds are CorruptFile, or OtherModel."""
    try:
        yield
    except OtherModel as error:
        raise OtherModel(f"{path}: {error}") from None
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise CorruptFile(f"{path} is no log of a session: {error}") from error


class AskAndTell(ABC, Generic[AnswerT]):
    """A search whose actions somebody else carries out: the part that knows nothing of what is searched.

    A copy of a session goes on by itself, from the same state and without the log.

    Attributes:
        seed: seed of the decider, as a tuple.
    """

    schema: ClassVar[str]
    """First field of a log; its number grows when a reader of older logs could be misled."""

    def __init__(self, seed: int | Sequence[int]) -> None:
        self.seed = checked_key(seed)
        self._journal: Journal | None = None
        self._rng = self._seeded()
        self._events: list[AnswerT | None] = []  # None: the last one that stands is taken back
        self._asked: Any = None  # the decision that waits for its answer

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_journal": None, "_rng": self._seeded()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._restore(list(self._events))

    @property
    @abstractmethod
    def outcome(self) -> Outcome | None:
        """How the search ended; None while it goes on."""

    @property
    @abstractmethod
    def set_up(self) -> dict[str, Any]:
        """What the session began with, as JSON types: the fields of the first line of its log.

        Among them are ``decider``, ``stop_rule``, ``model_sha256`` and ``reader_sha256``.
        """

    @abstractmethod
    def _rewind(self) -> None:
        """Go to the state before the first answer."""

    @abstractmethod
    def _apply(self, told: AnswerT) -> None:
        """Count an answer; after an error, nothing has changed."""

    @abstractmethod
    def _fields(self, told: AnswerT) -> dict[str, Any]:
        """The line of an answer in the log."""

    @abstractmethod
    def _answer_from(self, line: Mapping[str, Any]) -> AnswerT:
        """The answer in a line of the log."""

    @abstractmethod
    def _learn(self, truth: Mapping[str, Any]) -> None:
        """Take over the truth that a line of the log reveals."""

    def _seeded(self) -> np.random.Generator:
        """The decider's generator before the first question."""
        return deciding_rng(self.seed)

    @property
    def step(self) -> int:
        """Number of the question: how often something was told or taken back."""
        return len(self._events)

    @property
    def last_told(self) -> str | None:
        """Kind of the last answer that was not taken back: touch, miss or done; None before the first."""
        standing, _ = standing_of(self._events)
        return standing[-1].kind if standing else None

    def undo(self) -> str:
        """Take back what was told last: a touch that was a mistake, a miss, or that an action was carried out.

        :meth:`ask` then asks the same as before it.

        Returns:
            What was taken back: touch, miss or done.

        Raises:
            InvalidArgument: nothing was told.
            CannotWrite: the log cannot be written; nothing has changed.
        """
        if (kind := self.last_told) is None:
            raise InvalidArgument("nothing was told yet that undo() could take back")
        if self._journal is not None:
            self._journal.append(self._line(None))
        self._restore([*self._events, None])
        return kind

    def save(self, path: str | Path) -> None:
        """Write all that was told into a new file, which from now on is the session's log.

        Every :meth:`tell` is then on disk before the next action is asked for.

        Raises:
            CannotWrite: the file exists and is not this session's log, or it cannot be written.
        """
        if self._journal is not None and self._journal.path == Path(path).resolve():
            return
        from belief.journal import Journal

        header = {"schema": self.schema, "time": time.time(), **self.set_up}
        journal = Journal.create(Path(path).resolve(), [header, *map(self._line, self._events)])
        self.close()
        self._journal = journal

    def resume(self, path: str | Path) -> None:
        """Go on with the search of a log, in the same file; only before anything was told.

        Raises:
            CorruptFile: it is no log of a session, or was changed after it was written.
            OtherModel: it was made with another model, reader, decider or certificate.
            InvalidArgument: it is of another search, or something was told to this one.
            CannotWrite: it cannot be written, or another process has it open.
        """
        if self._events:
            raise InvalidArgument("a session that was told something cannot go on with a log")
        from belief.journal import Journal

        path = Path(path).resolve()
        journal, (header, *lines) = Journal.opened(path)
        try:
            with reading(path):
                if (schema := header.get("schema")) != self.schema:
                    raise ValueError(f"its schema is {schema!r:.60}, not {self.schema!r}")
                other = require_same(header, json.loads(json.dumps(self.set_up)))
            if other:
                raise InvalidArgument(f"{path} is the log of another search: {'; '.join(other)}")
            with reading(path):
                truths = [line for line in lines if line["told"] == "truth"]
                told = [line for line in lines if line["told"] != "truth"]
                self._restore([None if line["told"] == "undo" else self._answer_from(line) for line in told])
                if truths:
                    self._learn(truths[-1])
        except BaseException:
            journal.close()
            self._restore([])
            raise
        self.close()
        self._journal = journal

    def begun(self, log: str | Path | None) -> Self:
        """This session with a log: a new one, or one that it goes on with (:meth:`resume`)."""
        if log is not None:
            (self.resume if Path(log).exists() else self.save)(log)
        return self

    def close(self) -> None:
        """Let go of the log, which another process can then load; the session goes on without one."""
        if self._journal is not None:
            self._journal.close()
        self._journal = None

    def _take(self, told: AnswerT) -> None:
        """Count an answer and write it; after an error, nothing has changed."""
        self._apply(told)
        if self._journal is not None:
            try:
                self._journal.append(self._line(told))
            except BaseException:
                self._restore(self._events)
                raise
        self._events.append(told)

    def _reveal(self, **truth: Any) -> None:
        """Write what is true, which is no evidence."""
        if self._journal is not None:
            self._journal.append({"told": "truth", **truth, "time": time.time()})

    def _line(self, told: AnswerT | None) -> dict[str, Any]:
        return {"told": "undo", "time": time.time()} if told is None else self._fields(told)

    def _restore(self, events: list[AnswerT | None]) -> None:
        """Begin again and count all answers, with the same sums in the same order."""
        self._events, self._asked = events, None
        self._rewind()
        standing, undone = standing_of(events)
        for told in standing:
            self._apply(told)
        if undone is not None:
            self._asked = undone.asked
        if (last := undone or (standing[-1] if standing else None)) is not None:
            self._rng.bit_generator.state = last.rng
        else:
            self._rng = self._seeded()

    def _require_step(self, step: int | None) -> None:
        if step is not None and (type(step) is not int or not 0 <= step <= self.step):
            raise InvalidArgument(f"step must be {self.step}, which was asked, got {step!r}")
        if step is not None and step < self.step:
            raise AlreadyTold(f"step {step} was answered before, the session is at step {self.step}; nothing changed")


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


def _is_within(number: float | None, limit: float | None) -> bool:
    return number is not None and limit is not None and number <= limit


def _not_negative(name: str, value: float | None) -> float | None:
    if value is None:
        return None
    require_rule(name, value, NOT_NEGATIVE)
    return float(value)


def event_fields(told: Told, problem: SearchProblem) -> dict[str, Any]:
    """A line of the log."""
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


def require_digests(header: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """Check that a log can be continued with a model and a reader of these :func:`digests`."""
    for what in ("model", "reader"):
        digest = header[f"{what}_sha256"]
        if digest is not None and digest != now[f"{what}_sha256"]:
            raise OtherModel(f"the session began with another {what} than this one; give its own sensor")


def require_same(header: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Check that a log can be continued by a session with a set-up; returns how the search differs, in words."""
    require_digests(header, now)
    if header.get("stop_rule", now["stop_rule"]) != now["stop_rule"]:  # older logs have none, and no decider
        raise OtherModel("the session began with another certificate, or without one; give the same again")
    of_search = {name: value for name, value in header.items() if name not in _NOT_OF_THE_SEARCH}
    if other := differences(of_search, now):
        return other
    if other := differences({"decider": header.get("decider", now["decider"])}, now):
        raise OtherModel(f"the session began with another decider: {'; '.join(other)}; give the same again")
    return []
