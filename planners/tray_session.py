"""Ask and tell for a search in a tray, and the record of one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from belief.errors import InvalidArgument
from belief.problem import Reject, Unsure
from belief.seeding import checked_key
from belief.tray import PlaceTouch, TrayBelief
from belief.validation import are_finite
from planners.tray import ConfirmAt, Press, Standing, TrayDecider, TrayDecision, TrayRules, standing_of, stop

Reads = Callable[[NDArray[np.uint8]], tuple[NDArray[np.floating], float | None]]
"""Reads an image: its embedding, and its level, see :class:`belief.tray.PlaceTouch`."""
_PARKED = (0.0, 0.0)
"""Where the pad is at first [m]."""


class TrayStep(NamedTuple):
    """One press of a search: place [m], height of the contact [m], None for a miss, and probabilities after it.

    ``target`` is the largest probability of a found object to be the target, ``absent`` that of its absence.
    """

    place: tuple[float, float]
    height: float | None
    target: float
    absent: float


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


class Presses(Protocol):
    """A tray that can be touched."""

    def press(self, x: float, y: float, rng: np.random.Generator) -> Met:
        """What the pad meets at a place [m]."""


class TraySession:
    """A search in a tray whose touches somebody else makes, such as a robot.

    Args:
        belief: before the first touch.
        decider: chooses where to press.
        rules: when to stop, and what travel costs.
        seed: of the decider.
        read: reads an image; needed by :meth:`tell` with ``image=``.

    Attributes:
        belief: after all touches.
        steps: presses so far.
        standing: where the target may be, by the belief.
    """

    def __init__(
        self,
        belief: TrayBelief,
        decider: TrayDecider,
        rules: TrayRules,
        seed: int | Sequence[int] = 0,
        read: Reads | None = None,
    ) -> None:
        self.belief, self.decider, self.rules, self.read = belief, decider, rules, read
        self.steps: list[TrayStep] = []
        self.standing: Standing = standing_of(belief)
        self._rng = np.random.default_rng(checked_key(seed))
        self._asked: TrayDecision | None = None
        self._start = belief
        self._told: list[tuple[PlaceTouch, Any]] = []  # touches, with the state of the generator before each

    @property
    def at(self) -> tuple[float, float]:
        """Where the pad is (x, y) [m]."""
        return self.steps[-1].place if self.steps else _PARKED

    def ask(self) -> TrayDecision:
        """The next action, the same until :meth:`tell`; its ``action`` is a press, or the answer that ends the search.

        A press has the cell of the tray; :meth:`place` has where that is.
        """
        if self._asked is None:
            self._asked = self.stopped() or self.decider.choose(self.belief, self.at, self._rng)
        return self._asked

    def stopped(self) -> TrayDecision | None:
        """The answer that ends the search; None as long as none is probable enough."""
        return stop(self.standing, self.belief.num_touches, self.rules)

    def place(self) -> tuple[float, float]:
        """Where the press that is asked for is (x, y) [m].

        Raises:
            InvalidArgument: no press is asked for, because the search has ended.
        """
        action = self.ask().action
        if not isinstance(action, Press):
            raise InvalidArgument(f"the search has ended with {action}; no press is asked for")
        return self.belief.centre(action.cell)

    def tell(
        self,
        image: NDArray[np.uint8] | None = None,
        height: float | None = None,
        *,
        missed: bool = False,
        place: tuple[float, float] | None = None,
    ) -> None:
        """What was met at the place that was asked for, or at another place.

        Args:
            image: of the contact.
            height: of the pad's face above the floor when it met the object [m].
            missed: whether it met the floor.
            place: where the press was (x, y) [m], if not where it was asked for.

        Raises:
            InvalidArgument: image and height, or ``missed``, are missing; the place is outside the tray.
            ImpossibleObservation: no arrangement of objects explains it; nothing has changed.
        """
        x, y = self.place() if place is None else place
        size = self.belief.size
        if not (are_finite(x, y) and 0.0 <= x <= size[0] and 0.0 <= y <= size[1]):
            raise InvalidArgument(f"the place must be in the tray of {size[0]} x {size[1]} m, got {(x, y)}")
        if missed != (image is None) or missed != (height is None):
            raise InvalidArgument("say missed=True, or what was met: an image and the height of the contact")
        embedding = level = None
        if image is not None and height is not None:
            if not (are_finite(height) and height > 0.0):
                raise InvalidArgument(f"the height of a contact is above the floor [m], got {height}")
            if self.read is None:
                raise InvalidArgument("this session has no reader of images; begin it with sensor.session")
            embedding, level = self.read(image)
        touch = PlaceTouch(self.belief.cell_at(x, y), height or 0.0, embedding, level)
        self.belief, self._asked = self.belief.update(touch), None
        self._told.append((touch, self._rng.bit_generator.state))
        self.standing = standing_of(self.belief)
        self.steps.append(TrayStep((float(x), float(y)), height, self.standing.target, self.standing.absent))

    def tell_met(self, met: Met, place: tuple[float, float] | None = None) -> None:
        """:meth:`tell` what a simulated pad met, a miss as well."""
        is_miss = met.image is None
        self.tell(met.image, None if is_miss else met.height, missed=is_miss, place=place)

    def undo(self) -> None:
        """Take back what was told last; all touches before it are weighed once more, as beliefs are large.

        Raises:
            InvalidArgument: nothing was told.
        """
        if not self._told:
            raise InvalidArgument("nothing was told yet that undo() could take back")
        _, self._rng.bit_generator.state = self._told.pop()
        self.belief = self._start
        for touch, _ in self._told:
            self.belief = self.belief.update(touch)
        self.steps.pop()
        self.standing, self._asked = standing_of(self.belief), None


class Met(Protocol):
    """What a pad met: the height of the contact [m], and its image; None for a miss."""

    @property
    def height(self) -> float:
        """Above the floor [m]."""

    @property
    def image(self) -> NDArray[np.uint8] | None:
        """Of the contact."""


def search_tray(session: TraySession, world: Presses, rng: np.random.Generator) -> TrayDecision:
    """Play a session in a world to its end; returns the decision that ended it."""
    while isinstance((decision := session.ask()).action, Press):
        x, y = session.place()
        session.tell_met(world.press(x, y, rng))
    return decision


class LiesAt(Protocol):
    """An object in a tray: index of its shape, and its place (x, y, z) [m]."""

    @property
    def shape(self) -> int:
        """Index of its shape."""

    @property
    def place(self) -> NDArray[np.float64]:
        """Its place [m]."""


def is_right(answer: str, place: tuple[float, float] | None, objects: Sequence[LiesAt], target: int) -> bool:
    """Whether an answer is right: the object nearest to the place has the target's shape, or no object has it."""
    if place is None:
        return answer == "absent" and all(one.shape != target for one in objects)
    nearest = min(objects, key=lambda one: float(np.hypot(one.place[0] - place[0], one.place[1] - place[1])))
    return nearest.shape == target


def ended(decision: TrayDecision) -> tuple[str, tuple[float, float] | None, float]:
    """The answer of a decision that ends a search in words, its place, and its stated probability."""
    words = {ConfirmAt: "here", Reject: "absent", Unsure: "unsure"}
    action = decision.action
    place = action.place if isinstance(action, ConfirmAt) else None
    return words[type(action)], place, float(decision.scores["stated"])
