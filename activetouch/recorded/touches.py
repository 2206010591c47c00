"""Recorded touches of real objects: features, what was touched, with which action, and when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from belief.frozen import FrozenArrays
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.kernel_fit import numbered_sessions
from belief.problem import Touch
from belief.validation import Floats

TASKS = ("objects", "categories", "shapes")
"""What a search can be about."""
LARGEST = 1e100
"""Size of a feature, so that squares and their sums are finite."""

_FEWEST_LABELS = 2
_SHARED = 0.9  # of the sessions have all actions, if actions are recorded in sessions


@dataclass(frozen=True, eq=False)
class RecordedTouches(FrozenArrays):
    """n touches of recorded objects, each with one known action.

    Attributes:
        features: of each touch, ``(n, F)``, finite and of a size up to 1e100.
        actions: index of each touch's action, ``(n,)``.
        objects: index of each touch's object, ``(n,)``.
        sessions: order of recording of each touch among those of its object and action, ``(n,)``; touches of one object
            with equal numbers belong together, such as the behaviours of one trial.
        action_names: of the P actions.
        object_names: of the objects.
        labels: name of each object's category or shape by task, for the tasks that the set has besides ``objects``; an
            empty name leaves the object out of the task.
        provenance: where the set comes from.
        licence: its licence.
        feature_names: F names, or none.

    Raises:
        BadRecording: the arrays do not fit each other, hold values that are not finite or too large, or indices and
            sessions that are not whole numbers; the message names the touch.

    >>> touches = RecordedTouches(np.zeros((2, 3)), [0, 0], [0, 1], [0, 0], ("press",), ("mug", "ball"))
    >>> touches.num_touches, touches.tasks
    (2, ('objects',))
    """

    features: Floats
    actions: NDArray[np.int64]
    objects: NDArray[np.int64]
    sessions: NDArray[np.int64]
    action_names: tuple[str, ...]
    object_names: tuple[str, ...]
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    provenance: str = "the user"
    licence: str = "not stated"
    feature_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("actions", "objects", "sessions"):
            given = np.asarray(getattr(self, name))
            with np.errstate(invalid="ignore"):  # NaN equals no number
                numbers = given.astype(np.int64)
            if np.any(numbers != given):
                raise BadRecording(f"{name} must be whole numbers, got {given[numbers != given].tolist()[0]!r}")
            object.__setattr__(self, name, numbers)
        object.__setattr__(self, "features", np.asarray(self.features, np.float64))
        n = len(self.features)
        if self.features.ndim != 2 or self.features.size == 0:
            raise BadRecording(
                f"features must be (n, F) with at least one touch and feature, got {self.features.shape}"
            )
        if self.feature_names and len(self.feature_names) != self.features.shape[1]:
            raise BadRecording(f"feature_names must be none or {self.features.shape[1]}, got {len(self.feature_names)}")
        for name, size in (
            ("actions", len(self.action_names)),
            ("objects", len(self.object_names)),
            ("sessions", None),
        ):
            values = getattr(self, name)
            if values.shape != (n,):
                raise BadRecording(f"{name} must be ({n},) as there are {n} rows of features, got {values.shape}")
            if size is not None and not ((values >= 0) & (values < size)).all():
                raise BadRecording(f"{name} must be in [0, {size}), got {values.min()} to {values.max()}")
        fits = np.abs(self.features) <= LARGEST  # not where it is NaN
        if not fits.all():
            row = int(np.argmin(fits.all(axis=1)))
            raise BadRecording(
                f"features of {self.describe(row)} hold {self.features[row][~fits[row]][0]}; they must be finite and "
                f"of a size up to {LARGEST:g}: use another unit, or leave the touch out"
            )
        for task, names in self.labels.items():
            if task not in TASKS[1:] or len(names) != len(self.object_names):
                raise BadRecording(f"labels must give {len(self.object_names)} names for {TASKS[1:]}, got {task!r}")
        self.freeze()

    def describe(self, row: int) -> str:
        """A touch in words, for messages."""
        return (
            f"touch {row} (object {self.object_names[self.objects[row]]}, action "
            f"{self.action_names[self.actions[row]]}, session {self.sessions[row]})"
        )

    @property
    def num_touches(self) -> int:
        """N."""
        return len(self.features)

    @property
    def num_actions(self) -> int:
        """P."""
        return len(self.action_names)

    @property
    def tasks(self) -> tuple[str, ...]:
        """Tasks that the set has labels for."""
        return ("objects", *(task for task in TASKS[1:] if task in self.labels))

    def for_task(self, task: str) -> TaskTouches:
        """The touches of the objects that have a label in a task.

        Raises:
            BadRecording: the set has no such labels, or fewer than two.
        """
        if task not in self.tasks:
            raise BadRecording(f"these touches have no labels for {task!r}; they have {', '.join(self.tasks)}")
        names = self.object_names if task == "objects" else self.labels[task]
        used = sorted({names[index] for index in np.unique(self.objects).tolist()} - {""})
        if len(used) < _FEWEST_LABELS:
            raise BadRecording(f"{task} need at least two different labels, there is {used}")
        label_of = np.array([used.index(name) if name in used else -1 for name in names])
        rows = np.flatnonzero(label_of[self.objects] >= 0)
        return TaskTouches(self, task, tuple(used), rows, label_of[self.objects[rows]])


@dataclass(frozen=True, eq=False)
class TaskTouches(FrozenArrays):
    """The touches of a task, with the label of each.

    Attributes:
        source: all touches.
        task: what the labels are.
        label_names: of the K labels.
        rows: of the source, ``(n,)``.
        labels: of each row, ``(n,)``.
    """

    source: RecordedTouches
    task: str
    label_names: tuple[str, ...]
    rows: NDArray[np.int64]
    labels: NDArray[np.int64]

    @property
    def objects(self) -> NDArray[np.int64]:
        """Object of each row, ``(n,)``."""
        return self.source.objects[self.rows]

    @property
    def actions(self) -> NDArray[np.int64]:
        """Action of each row, ``(n,)``."""
        return self.source.actions[self.rows]

    @property
    def sessions(self) -> NDArray[np.int64]:
        """Session of each row, ``(n,)``."""
        return self.source.sessions[self.rows]

    def sessions_of(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Sessions of some rows, ``(r,)``; touches of single sessions are numbered anew if no two actions share one."""
        objects, actions, sessions = self.objects[rows], self.actions[rows], self.sessions[rows]
        pairs = np.unique(np.stack([objects, sessions, actions]), axis=1)
        _, counts = np.unique(pairs[:2], axis=1, return_counts=True)
        is_shared = (counts == self.source.num_actions).mean() > _SHARED
        return sessions if is_shared else numbered_sessions(objects, actions)

    def labelled(self, rows: NDArray[np.int64], ratios: Floats) -> LabelledTouches:
        """Some rows ``(r,)`` as a reader sees them, with log likelihood ratios ``(r, K)``, and their labels."""
        listed = [Touch(int(action), row) for action, row in zip(self.actions[rows], ratios, strict=True)]
        size = self.source.num_actions
        return LabelledTouches.of(listed, self.labels[rows], self.objects[rows], self.label_names, size)

    @property
    def features(self) -> Floats:
        """Features of each row, ``(n, F)``."""
        return self.source.features[self.rows]
