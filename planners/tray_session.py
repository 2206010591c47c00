"""Ask and tell for a search in a tray, and the record of one."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from belief.errors import InvalidArgument
from belief.naming import NONE_OF_THESE, index_of, shown
from belief.problem import Reject, Unsure
from belief.search_progress import Outcome
from belief.statistics.stop_thresholds import CandidateStops
from belief.tray import PlaceTouch, TrayBelief
from belief.validation import are_finite, checked_values
from planners.decider import require_decider
from planners.session_log import AskAndTell, Told, decider_fields
from planners.tray import (
    ConfirmAt,
    Press,
    TrayDecider,
    TrayDecision,
    TrayRules,
    checked_decision,
    standing_of,
    stated,
    stop,
)

TrayAction: TypeAlias = Press | ConfirmAt | Reject | Unsure
Lies: TypeAlias = tuple[str, float, float]
"""Shape and place (x, y) of an object [m]."""
_HIGHEST = 1.0  # contact [m]: the largest objects are 0.6 m high
_PARKED = (0.0, 0.0)
"""Where the pad is at first [m]."""
PLACELESS: Mapping[str, Reject | Unsure] = {"reject": Reject(), "unsure": Unsure()}
"""Answers that have no place, by their words."""
_WORDS: Mapping[type, str] = {Press: "touch", ConfirmAt: "confirm", Reject: "reject", Unsure: "unsure"}
OUTCOMES = {ConfirmAt: Outcome.CONFIRMED, Reject: Outcome.EXHAUSTED, Unsure: Outcome.UNSURE}
"""How an answer ends a search."""


class TrayStep(NamedTuple):
    """One press of a search: place [m], height of the contact [m], None for a miss, and probabilities after it.

    ``target`` is the largest probability of a found object to be the target, ``where`` the place of that object [m],
    and ``absent`` the probability that the target is absent.
    """

    place: tuple[float, float]
    height: float | None
    target: float
    absent: float
    where: tuple[float, float] | None = None


@dataclass(frozen=True)
class TrayEpisode:
    """The record of one search in a tray.

    Attributes:
        target: label of the shape sought.
        seed: of the search.
        steps: its presses.
        answer: ``"here"``, ``"absent"`` or ``"unsure"``.
        place: where the target is said to be [m]; None without one.
        stated: probability of the answer.
        is_there: whether the target was in the tray; None if nobody knows.
        success: whether the answer is right; None if nobody knows.
        objects: shape and place (x, y) of each object [m], as they were at the start.
    """

    target: str
    seed: tuple[int, ...]
    steps: tuple[TrayStep, ...]
    answer: str
    place: tuple[float, float] | None
    stated: float
    is_there: bool | None = None
    success: bool | None = None
    objects: tuple[tuple[str, float, float], ...] = ()

    @property
    def num_touches(self) -> int:
        """Presses, those that missed as well."""
        return len(self.steps)

    @property
    def travel(self) -> float:
        """Length of the pad's way from the corner (0, 0), above the tray [m]."""
        way = np.array([_PARKED, *(step.place for step in self.steps)])
        return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


class TrayReader(Protocol):
    """Reads the images that a session is given; a sensor for trays is one."""

    @property
    def identity(self) -> str:
        """Digest of everything that determines its readings and the beliefs."""

    def read(self, image: Any) -> tuple[NDArray[np.floating], float | None]:
        """The embedding of an image, and its level, see :class:`belief.tray.PlaceTouch`."""


class TraySession(AskAndTell):
    """A search in a tray whose touches somebody else makes, such as a robot.

    Args:
        belief: before the first touch.
        decider: chooses where to press.
        rules: when to stop, and what travel costs.
        seed: of the decider.
        reader: reads images; needed by :meth:`tell` with ``image=``.

    Attributes:
        belief: after all touches.
        standing: where the target may be, by the belief.
        objects: true shape and place of each object, for scoring only; empty where nobody knows (:meth:`reveal`).
    """

    schema = "activetouch tray session 1"

    def __init__(
        self,
        belief: TrayBelief,
        decider: TrayDecider,
        rules: TrayRules,
        seed: int | Sequence[int] = 0,
        reader: TrayReader | None = None,
    ) -> None:
        super().__init__(seed)
        require_decider(decider, "choose", "sensor.decider('information_per_cost')")
        self._start, self.decider, self.rules, self.reader = belief, decider, rules, reader
        self.objects: tuple[Lies, ...] = ()
        self._rewind()

    def _seeded(self) -> np.random.Generator:
        return np.random.default_rng(self.seed)

    def _rewind(self) -> None:
        self.belief, self.standing = self._start, standing_of(self._start)
        self._steps: list[TrayStep] = []
        self._answer: ConfirmAt | Reject | Unsure | None = None

    @property
    def steps(self) -> tuple[TrayStep, ...]:
        """Presses so far."""
        return tuple(self._steps)

    @property
    def at(self) -> tuple[float, float]:
        """Where the pad is (x, y) [m]."""
        return self._steps[-1].place if self._steps else _PARKED

    @property
    def outcome(self) -> Outcome | None:
        """How the search ended: confirmed, exhausted (the target is absent) or unsure; None while it goes on."""
        return None if self._answer is None else OUTCOMES[type(self._answer)]

    def ask(self) -> TrayAction | None:
        """The next action, the same until it is told that it was carried out; None when the search has ended.

        A press has the cell of the tray; :meth:`place` has where that is. Any other action ends the search.
        """
        return None if (decision := self.decision) is None else decision.action

    @property
    def decision(self) -> TrayDecision | None:
        """The action that :meth:`ask` returns, with the scores that explain it."""
        if self._asked is None and self._answer is None:
            answer = self.stopped()
            self._asked = TrayDecision(answer) if answer else self._chosen()
        asked: TrayDecision | None = self._asked
        return asked

    def _chosen(self) -> TrayDecision:
        found = self.decider.choose(self.belief, self.at, self._rng)
        return checked_decision(found, self.decider, self.belief)

    def stopped(self) -> ConfirmAt | Reject | Unsure | None:
        """The answer that ends the search; None as long as none is probable enough."""
        return stop(self.standing, self.belief.num_touches, self.rules)

    def place(self) -> tuple[float, float]:
        """Where the press that is asked for is (x, y) [m].

        Raises:
            InvalidArgument: no press is asked for, because the search has ended.
        """
        action = self.ask()
        if not isinstance(action, Press):
            raise InvalidArgument(f"the search has ended with {action or self.outcome}; no press is asked for")
        return self.belief.centre(action.cell)

    def tell(
        self,
        image: Any = None,
        height: float | None = None,
        *,
        missed: bool = False,
        place: tuple[float, float] | None = None,
        step: int | None = None,
    ) -> str:
        """What was met at the place that was asked for, or at another; or, without arguments, that an answer was given.

        With a log, what was told is on disk when this returns.

        Args:
            image: of the contact.
            height: of the pad's face above the floor when it met the object [m].
            missed: whether it met the floor.
            place: where the press was (x, y) [m], if not where it was asked for.
            step: which question is answered: :attr:`step` when it was asked. It protects from answers that come twice.

        Returns:
            What the answer counts as: touch, miss or done.

        Raises:
            AlreadyTold: the step was answered before.
            InvalidArgument: image and height, or ``missed``, are missing; the place is outside the tray; the search has
                ended.
            ImpossibleObservation: no arrangement of objects explains it.
            CannotWrite: the log cannot be written. After every error, nothing has changed.
        """
        self._require_step(step)
        if self._answer is not None:
            raise InvalidArgument(f"the search has ended: {self.outcome}. undo() takes back what was told last")
        if place is None and image is None and height is None and not missed and not isinstance(self.ask(), Press):
            return self._take(self._told(self._asked, self._rng.bit_generator.state, time.time()))
        x, y = self._within("the place", self.place() if place is None else place)
        if missed != (image is None) or missed != (height is None):
            raise InvalidArgument("say missed=True, or what was met: an image and the height of the contact")
        embedding = level = None
        if image is not None and height is not None:
            _require_height(height)
            if self.reader is None:
                raise InvalidArgument("this session has no reader of images; begin it with sensor.session")
            embedding, level = self.reader.read(image)
            checked_values("the embedding that the reader made", embedding)
            image = np.asarray(image).astype(np.uint8)
        rng, felt = self._rng.bit_generator.state, ((x, y), height or 0.0, level, embedding, image)
        return self._take(self._told(self._asked, rng, time.time(), *felt))

    def tell_met(self, met: Met, place: tuple[float, float] | None = None) -> str:
        """:meth:`tell` what a simulated pad met, a miss as well."""
        is_miss = met.image is None
        return self.tell(met.image, None if is_miss else met.height, missed=is_miss, place=place)

    def reveal(self, objects: Sequence[Lies]) -> None:
        """Say which objects there really were, and where, for scoring; it is no evidence.

        Args:
            objects: shape and place (x, y) [m] of each; "none of these" for another shape.

        Raises:
            UnknownName: there is no such shape.
            InvalidArgument: a place is outside the tray, or there is no object.
        """
        found = self._lies(objects)
        self._reveal(objects=[list(one) for one in found])
        self.objects = found

    @property
    def _truth(self) -> dict[str, Any]:
        return {"objects": [list(one) for one in self.objects]} if self.objects else {}

    @property
    def episode(self) -> TrayEpisode:
        """The record of the search; raises InvalidArgument before it has ended."""
        if self._answer is None:
            raise InvalidArgument("the search has not ended yet; its steps so far are session.steps")
        answer, place = ended(self._answer)
        prob = stated(self.standing, self._answer)
        target = self.belief.table.labels[self.belief.target]
        is_there = any(label == target for label, *_ in self.objects) if self.objects else None
        success = is_right(answer, place, self.objects, target) if self.objects else None
        return TrayEpisode(target, self.seed, self.steps, answer, place, prob, is_there, success, self.objects)

    @property
    def set_up(self) -> dict[str, Any]:
        """See :class:`planners.session_log.AskAndTell`."""
        belief = self._start
        tray = {"shapes": belief.table.labels, "size": belief.size, "num_objects": belief.num_objects}
        tray |= {"present": belief.present, "unlisted": belief.unlisted, "noise": dataclasses.asdict(belief.noise)}
        return {
            "tray": tray,
            "rules": dataclasses.asdict(self.rules),
            "target": belief.table.labels[belief.target],
            "seed": list(self.seed),
            "decider": decider_fields(self.decider),
            "stop_rule": None,
            "model_sha256": None,
            "reader_sha256": None if self.reader is None else self.reader.identity,
        }

    def _apply(self, told: Told) -> None:
        if told.touch is None or told.place is None:
            assert told.asked is not None, "an answer was asked for"
            assert not isinstance(told.asked.action, Press), "an answer was asked for"
            self._answer = told.asked.action
        else:
            self.belief = self.belief.update(told.touch)
            self.standing = standing_of(self.belief)
            height, now = told.touch.height if told.kind == "touch" else None, self.standing
            where = now.places[0][0] if now.places else None
            self._steps.append(TrayStep(told.place, height, now.target, now.absent, where))
        self._asked = None

    def _lies(self, objects: Sequence[Any]) -> tuple[Lies, ...]:
        """The objects that :meth:`reveal` is given, or that a log has, checked."""
        labels, found = self.belief.table.labels, list[Lies]()
        parts = objects if isinstance(objects, Iterable) else (objects,)
        if odd := [part for part in parts if isinstance(part, str) or not isinstance(part, Iterable)]:
            raise InvalidArgument(f"objects are a list such as [('cube', 0.1, 0.05)], got {shown(odd[0])} for one")
        for label, *place in objects:
            named = label if label == NONE_OF_THESE else labels[index_of("shape", labels, label)]
            found.append((named, *self._within(named, place)))
        if not found:
            raise InvalidArgument("at least one object is in the tray")
        return tuple(found)

    def _within(self, what: str, place: Any) -> tuple[float, float]:
        """A place (x, y) that is in the tray [m]."""
        size, found = self.belief.size, tuple(place) if isinstance(place, Iterable) else ()
        if not (len(found) == 2 and are_finite(*found) and 0.0 <= found[0] <= size[0] and 0.0 <= found[1] <= size[1]):
            raise InvalidArgument(f"{what} must be in the tray of {size[0]} x {size[1]} m, (x, y), got {shown(place)}")
        return float(found[0]), float(found[1])

    def _told(self, asked: TrayDecision | None, rng: Any, now: float, *felt: Any) -> Told:
        """An answer; ``felt`` are place, height, level, embedding and image of a press. Few beliefs keep the image."""
        if not felt:
            return Told(asked, rng, time=now)
        (x, y), height, level, embedding, image = felt
        place = float(x), float(y)
        touch = PlaceTouch(self.belief.cell_at(*place), float(height), embedding, level)
        touch = touch if self.belief.lookalikes is None else touch._replace(image=image, place=place)
        return Told(asked, rng, touch=touch, is_miss=embedding is None, image=image, time=now, place=place)

    def _fields(self, told: Told) -> dict[str, Any]:
        from belief.journal import array_field

        line: dict[str, Any] = {"told": told.kind, "time": told.time, "rng": told.rng}
        if told.asked is not None:
            line |= {"asked": action_fields(told.asked.action), "scores": dict(told.asked.scores)}
        if told.touch is not None:
            arrays = {"embedding": told.touch.embedding, "image": told.image}
            line |= {"place": told.place, "height": told.touch.height, "level": told.touch.level}
            line |= {name: array_field(array) for name, array in arrays.items() if array is not None}
        return line

    def _answer_from(self, line: Mapping[str, Any]) -> Told:
        from belief.journal import array_from

        asked: TrayDecision | None = None
        felt: tuple[Any, ...] = ()
        if "asked" in line:
            scores = {str(name): float(score) for name, score in line["scores"].items()}
            asked = TrayDecision(action_from(line["asked"]), scores)
        if "place" in line:
            level = None if line["level"] is None else float(line["level"])
            arrays = (array_from(line[name]) if name in line else None for name in ("embedding", "image"))
            height = line["height"] if "embedding" in line else 0.0
            if "embedding" in line:
                _require_height(height)
            felt = self._within("the place", line["place"]), float(height), level, *arrays
        found = self._told(asked, line["rng"], float(line["time"]), *felt)
        if found.kind != line["told"] or (not felt and (asked is None or isinstance(asked.action, Press))):
            raise ValueError(f"a line says {line['told']!r:.40}, and holds a {found.kind}")
        return found

    def _learn(self, truth: Mapping[str, Any]) -> None:
        self.objects = self._lies(truth["objects"])

    def _learn_first(self, header: Mapping[str, Any]) -> None:
        """Nothing: the first line of a log has no objects."""


def _require_height(height: Any) -> None:
    """Check the height of a contact."""
    if isinstance(height, bool) or not (are_finite(height) and 0.0 < height <= _HIGHEST):
        given = shown(height) + ": is it in mm?" * (are_finite(height) and height > 0.0)
        raise InvalidArgument(f"the height of a contact is above the floor, in (0, 1] m, got {given}")


def action_fields(action: TrayAction) -> dict[str, Any]:
    """An action as JSON types."""
    fields: dict[str, Any] = {"action": _WORDS[type(action)]}
    if isinstance(action, Press):
        fields["cell"] = list(action.cell)
    elif isinstance(action, ConfirmAt):
        fields["place"] = list(action.place)
    return fields


def action_from(fields: Mapping[str, Any]) -> TrayAction:
    """The action of :func:`action_fields`."""
    if fields["action"] == "touch":
        along, across = fields["cell"]
        return Press((int(along), int(across)))
    if fields["action"] == "confirm":
        x, y = fields["place"]
        return ConfirmAt((float(x), float(y)))
    return PLACELESS[fields["action"]]


class Met(Protocol):
    """What a pad met: the height of the contact [m], and its image; None for a miss."""

    @property
    def height(self) -> float:
        """Above the floor [m]."""

    @property
    def image(self) -> NDArray[np.uint8] | None:
        """Of the contact."""


def is_right(answer: str, place: tuple[float, float] | None, objects: Sequence[Lies], target: str) -> bool:
    """Whether an answer is right: the object nearest to the place has the target's shape, or no object has it."""
    if place is None:
        return answer == "absent" and all(label != target for label, *_ in objects)
    nearest = min(objects, key=lambda one: float(np.hypot(one[1] - place[0], one[2] - place[1])))
    return nearest[0] == target


def ended(action: ConfirmAt | Reject | Unsure) -> tuple[str, tuple[float, float] | None]:
    """An answer in words, and its place."""
    words = {ConfirmAt: "here", Reject: "absent", Unsure: "unsure"}
    return words[type(action)], action.place if isinstance(action, ConfirmAt) else None


ANSWERS = ("here", "absent")
"""Answers that a certificate bounds the errors of."""
SUREST, LEAST = 1.0 - 1e-6, 0.5
"""Stated probabilities from which no certificate, and any certificate, lets a search end."""


def candidate_stops(episodes: Sequence[TrayEpisode]) -> CandidateStops:
    """All moments at which searches could have ended, by answer, for :func:`certified_thresholds` with ``ANSWERS``."""
    rows = []
    for number, one in enumerate(episodes):
        for step in one.steps:
            for answer, prob, place in ((0, step.target, step.where), (1, step.absent, None)):
                if prob >= LEAST:
                    right = is_right(ANSWERS[answer], place, one.objects, one.target)
                    rows.append((number, answer, min(prob, 1.0), not right))
    searches, answers, probs, is_wrong = np.reshape(rows, (-1, 4)).T
    return CandidateStops(searches, answers, probs, is_wrong, len(episodes))
