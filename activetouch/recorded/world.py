"""Recorded objects as a world: a touch with an action is one of the object's recordings with that action."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from belief.errors import InvalidArgument
from belief.frozen import FrozenArrays
from belief.problem import Touch
from belief.seeding import checked_key, keyed_rng
from belief.validation import Floats

_KEY = 0x7EC0


@dataclass(frozen=True, eq=False)
class RecordedBank(FrozenArrays):
    """n held-out touches of recorded objects, as a reader sees them.

    Attributes:
        label_names: of the K labels.
        action_names: of the P actions.
        ratios: log likelihood ratios of each touch, ``(n, K)``.
        labels, objects, actions, sessions: of each touch, ``(n,)``.

    An object may have no touch with some actions. Searches among objects then use :meth:`among` with what all have.

    Raises:
        BadRecording: there is no touch.

    >>> one = np.zeros(1, np.int64)
    >>> bank = RecordedBank(("mug", "can"), ("press",), np.zeros((1, 2)), one, one, one, one)
    >>> bank.repeats, bank.objects_of(0)
    (1, [0])
    """

    label_names: tuple[str, ...]
    action_names: tuple[str, ...]
    ratios: Floats
    labels: NDArray[np.int64]
    objects: NDArray[np.int64]
    actions: NDArray[np.int64]
    sessions: NDArray[np.int64]

    def __post_init__(self) -> None:
        if not len(self.objects):
            raise BadRecording("a bank needs at least one held-out touch")
        self.freeze()

    @property
    def repeats(self) -> int:
        """Number of different touches that every object has with each of its actions."""
        counts = self._counts()
        return int(counts[counts > 0].min())

    def actions_of(self, objects: Sequence[int]) -> list[int]:
        """The actions with which all of some objects have touches."""
        has = self._counts()[np.searchsorted(np.unique(self.objects), objects)] > 0
        return [int(action) for action in np.flatnonzero(has.all(axis=0))]

    def objects_of(self, label: int) -> list[int]:
        """The objects with a label."""
        return [int(index) for index in np.unique(self.objects[self.labels == label])]

    def among(self, labels: Sequence[str], actions: Sequence[int] | None = None) -> RecordedBank:
        """The touches of objects of some labels with some actions, which are numbered anew; ratios of these labels."""
        columns = [self.label_names.index(label) for label in labels]
        chosen = range(len(self.action_names)) if actions is None else actions
        rows = np.flatnonzero(np.isin(self.labels, columns) & np.isin(self.actions, chosen))
        new, used = (
            np.array([order.index(number) for number in given[rows].tolist()], np.int64)
            for order, given in ((columns, self.labels), (list(chosen), self.actions))
        )
        names, ratios = tuple(self.action_names[action] for action in chosen), self.ratios[rows][:, columns]
        return RecordedBank(tuple(labels), names, ratios, new, self.objects[rows], used, self.sessions[rows])

    def _counts(self) -> NDArray[np.int64]:
        """Touches of each object with each action."""
        objects, number = np.unique(self.objects, return_inverse=True)
        counts = np.zeros((len(objects), len(self.action_names)), np.int64)
        np.add.at(counts, (number, self.actions), 1)
        return counts


class RecordedWorld:
    """The objects of a search, which the seed alone decides how to replay.

    The n-th touch of an object with an action is from the n-th of its sessions in an order that the seed gives. First
    touches with different actions come from one session, as if the robot had stayed with one placement of the object.
    After the last session the world repeats the recordings; observation models that are told their number
    (``repeats``) count a repeated recording for nothing.

    Args:
        bank: held-out touches.
        objects: the objects, in order of visit.
        seed: of the order of sessions, one number or several.

    >>> zeros, ones = np.zeros(2, np.int64), np.arange(2)
    >>> bank = RecordedBank(("mug", "can"), ("press",), np.eye(2), ones, ones, zeros, zeros)
    >>> world = RecordedWorld(bank, objects=[1, 0], seed=[0])
    >>> world.arrangement, world.touch(0, np.random.default_rng(0)).logits.tolist()
    ((1, 0), [0.0, 1.0])
    """

    def __init__(self, bank: RecordedBank, objects: Sequence[int], seed: int | Sequence[int]) -> None:
        self._bank = bank
        self.objects = tuple(int(index) for index in objects)
        if unknown := [index for index in self.objects if index not in bank.objects]:
            raise InvalidArgument(f"the bank has no object {unknown[0]}, it has {np.unique(bank.objects).tolist()}")
        self.arrangement = tuple(int(bank.labels[bank.objects == index][0]) for index in self.objects)
        self._orders = []
        for number, index in enumerate(self.objects):
            sessions = np.unique(bank.sessions[bank.objects == index])
            turns = keyed_rng([*checked_key(seed), _KEY, number]).permutation(len(sessions))
            self._orders.append(dict(zip(sessions.tolist(), turns.tolist(), strict=True)))
        self.reset()

    def touch(self, pose: int, rng: np.random.Generator) -> Touch:
        """The next recording of the current object with an action, of which it must have one; ``rng`` is not used."""
        index, turn = self.objects[self._current], self._orders[self._current]
        rows = np.flatnonzero((self._bank.objects == index) & (self._bank.actions == pose))
        if not len(rows):
            raise InvalidArgument(f"object {index} has no recording with the action {self._bank.action_names[pose]}")
        ordered = rows[np.argsort([turn[session] for session in self._bank.sessions[rows].tolist()], kind="stable")]
        used = self._used.get((self._current, pose), 0)
        self._used[self._current, pose] = used + 1
        return Touch(pose, self._bank.ratios[ordered[used % len(ordered)]])

    def advance(self) -> None:
        """Go to the next object; raises InvalidArgument after the last."""
        if self._current + 1 >= len(self.objects):
            raise InvalidArgument(f"there is no object after the last of {len(self.objects)}")
        self._current += 1

    def reset(self) -> None:
        """Go to the first object, and forget which recordings were used."""
        self._current = 0
        self._used: dict[tuple[int, int], int] = {}
