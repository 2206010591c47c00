"""What sessions of all kinds of searches share, and the set-up of searches among objects in a log.

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
from dataclasses import dataclass
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from belief.composition import AtMostOne, Composition, Counts
from belief.errors import CorruptFile, InvalidArgument
from belief.observation_model.model import ObservationModel
from belief.problem import Elsewhere, SearchProblem, Touch
from belief.search_progress import Outcome
from belief.seeding import checked_key, deciding_rng
from belief.validation import are_finite

if TYPE_CHECKING:
    from belief.journal import Journal

_NOT_OF_THE_SEARCH = {"schema", "time", "arrangement", "decider", "stop_rule", "model_sha256", "reader_sha256"}


class OtherModel(InvalidArgument):
    """A log was made with another observation model, reader or decider; the search would not be the same."""


class AlreadyTold(InvalidArgument):
    """A question was answered twice, or an answer came late; nothing has changed."""


@dataclass(frozen=True, eq=False)
class Told:
    """The answer of a robot to one question.

    ``rng`` is the state of the decider's generator after the decision ``asked``, which is None where a press in a tray
    came unasked. ``touch`` is None for a miss without evidence, and for an action that is no touch; in a tray it is a
    :class:`belief.tray.PlaceTouch` at ``place`` (x, y) [m]. ``image`` is what it was read from, or None. ``force`` [N]
    and ``area`` [m²] are of the contact, if known; ``time`` is in s since 1970.
    """

    asked: Any
    rng: Mapping[str, Any]
    object_index: int = 0
    touch: Any = None
    is_miss: bool = False
    image: NDArray[Any] | None = None
    force: float | None = None
    area: float | None = None
    time: float = 0.0
    place: tuple[float, float] | None = None

    @property
    def kind(self) -> str:
        """Kind of the answer: touch, miss or done."""
        return "miss" if self.is_miss else "done" if self.touch is None else "touch"


def standing_of(events: Sequence[Told | None]) -> tuple[list[Told], Told | None]:
    """The answers that were not taken back, and the one that the last event took back, if it did."""
    standing: list[Told] = []
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


class AskAndTell(ABC):
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
        self._events: list[Told | None] = []  # None: the last one that stands is taken back
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
    def _apply(self, told: Told) -> None:
        """Count an answer; after an error, nothing has changed."""

    @abstractmethod
    def _fields(self, told: Told) -> dict[str, Any]:
        """The line of an answer in the log."""

    @abstractmethod
    def _answer_from(self, line: Mapping[str, Any]) -> Told:
        """The answer in a line of the log."""

    @abstractmethod
    def _learn(self, truth: Mapping[str, Any]) -> None:
        """Take over the truth that a line of the log reveals."""

    @abstractmethod
    def _learn_first(self, header: Mapping[str, Any]) -> None:
        """Take over the truth of the first line of a log that no later line reveals."""

    @property
    @abstractmethod
    def _truth(self) -> dict[str, Any]:
        """What is known to be true and is not in :attr:`set_up`, as JSON types; empty for nothing."""

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
        truth = [self._revealed(self._truth)] if self._truth else []
        journal = Journal.create(Path(path).resolve(), [header, *map(self._line, self._events), *truth])
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
                self._learn_first(header)
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
            from belief.files import cannot_write

            try:
                is_there = Path(log).exists()
            except OSError as error:  # such as of a name that is too long
                raise cannot_write(Path(log), error) from error
            (self.resume if is_there else self.save)(log)
        return self

    def close(self) -> None:
        """Let go of the log, which another process can then load; the session goes on without one."""
        if self._journal is not None:
            self._journal.close()
        self._journal = None

    def _take(self, told: Told) -> str:
        """Count an answer, write it, and say its kind; after an error, nothing has changed."""
        self._apply(told)
        if self._journal is not None:
            try:
                self._journal.append(self._line(told))
            except BaseException:
                self._restore(self._events)
                raise
        self._events.append(told)
        return told.kind

    def _reveal(self, **truth: Any) -> None:
        """Write what is true, which is no evidence."""
        if self._journal is not None:
            self._journal.append(self._revealed(truth))

    @staticmethod
    def _revealed(truth: Mapping[str, Any]) -> dict[str, Any]:
        return {"told": "truth", **truth, "time": time.time()}

    def _line(self, told: Told | None) -> dict[str, Any]:
        return {"told": "undo", "time": time.time()} if told is None else self._fields(told)

    def _restore(self, events: list[Told | None]) -> None:
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
        is_whole = isinstance(step, Integral) and not isinstance(step, bool)
        if step is not None and not (is_whole and 0 <= step <= self.step):
            raise InvalidArgument(f"step must be the integer {self.step}, which was asked, got {step!r}")
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
    truths = [fields.get("arrangement", ()) for fields in (header, now)]
    if all(any(shape is not None for shape in truth) for truth in truths):  # it may be unknown in one of them
        of_search["arrangement"] = header["arrangement"]
    if other := differences(of_search, now):
        return other
    if other := differences({"decider": header.get("decider", now["decider"])}, now):
        raise OtherModel(f"the session began with another decider: {'; '.join(other)}; give the same again")
    return []
