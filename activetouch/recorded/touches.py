"""Recorded touches of real objects, and splits of them: to learn from, to calibrate on, and to test on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from belief.frozen import FrozenArrays
from belief.observation_model.action_kernel import numbered_sessions
from belief.observation_model.calibration_data import LabelledTouches, object_folds
from belief.problem import Touch
from belief.validation import Floats

TASKS = "objects", "categories", "shapes"
"""Tasks: labels of touches are their objects, or kinds of objects."""
LARGEST = 1e100
"""Largest size of a feature, so that squares and their sums are finite."""

_SHARED = 0.9  # share of the sessions with all actions, if actions are recorded in sessions
_SESSIONS = 4  # least number of sessions: three leave none to calibrate on
_LEARNED, _CALIBRATED = 0.6, 0.8  # ends of the shares of an object's sessions
_INNER = 4  # folds


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
        provenance: where the set comes from.
        licence: its licence.
        feature_names: F names, or none.
        kinds: category or shape of each object by task, ``categories`` or ``shapes``; an empty name leaves the object
            out of the task.
        controls: what should not tell the label, ``(n, C)`` by name. ``untouched`` is what was measured where nothing
            was touched; where it has F columns, each is of the feature of the same place.
        task: whether a reader learns to tell apart ``objects``, ``categories`` or ``shapes``, see :meth:`for_task`.

    Raises:
        BadRecording: the arrays do not fit each other, hold values that are not finite or too large, or indices and
            sessions that are not whole numbers; the message names the touch.

    >>> touches = RecordedTouches(np.zeros((2, 3)), [0, 0], [0, 1], [0, 0], ("press",), ("mug", "ball"))
    >>> touches.num_touches, touches.num_actions
    (2, 1)
    """

    features: Floats
    actions: NDArray[np.int64]
    objects: NDArray[np.int64]
    sessions: NDArray[np.int64]
    action_names: tuple[str, ...]
    object_names: tuple[str, ...]
    provenance: str = "the user"
    licence: str = "not stated"
    feature_names: tuple[str, ...] = ()
    kinds: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    controls: Mapping[str, Floats] = field(default_factory=dict)
    task: str = TASKS[0]

    def __post_init__(self) -> None:
        object.__setattr__(self, "features", np.asarray(self.features, np.float64))
        n = len(self.features)
        if self.features.ndim != 2 or self.features.size == 0:
            raise BadRecording(
                f"features must be (n, F) with at least one touch and feature, got {self.features.shape}"
            )
        if self.feature_names and len(self.feature_names) != self.features.shape[1]:
            raise BadRecording(f"feature_names must be none or {self.features.shape[1]}, got {len(self.feature_names)}")
        for name, size in (("actions", self.num_actions), ("objects", len(self.object_names)), ("sessions", None)):
            given = np.asarray(getattr(self, name))
            with np.errstate(invalid="ignore"):  # NaN equals no number
                values = given.astype(np.int64)
            if np.any(values != given):
                raise BadRecording(f"{name} must be whole numbers, got {given[values != given].tolist()[0]!r}")
            if values.shape != (n,):
                raise BadRecording(f"{name} must be ({n},) as there are {n} rows of features, got {values.shape}")
            if size is not None and not ((values >= 0) & (values < size)).all():
                raise BadRecording(f"{name} must be in [0, {size}), got {values.min()} to {values.max()}")
            object.__setattr__(self, name, values)
        fits = np.abs(self.features) <= LARGEST  # not where it is NaN
        if not fits.all():
            row = int(np.argmin(fits.all(axis=1)))
            raise BadRecording(
                f"features of touch {row} (object {self.object_names[self.objects[row]]}, action "
                f"{self.action_names[self.actions[row]]}, session {self.sessions[row]}) hold "
                f"{self.features[row][~fits[row]][0]}; they must be finite and of a size up to {LARGEST:g}: use "
                "another unit, or leave the touch out"
            )
        for name, columns in self.controls.items():
            if np.ndim(columns) != 2 or len(columns) != n or not (np.abs(columns) <= LARGEST).all():
                raise BadRecording(f"the control {name!r} must be ({n}, C) finite numbers, got {np.shape(columns)}")
        for task, names in self.kinds.items():
            if task not in TASKS[1:] or len(names) != len(self.object_names):
                raise BadRecording(f"kinds must give {len(self.object_names)} names for {TASKS[1:]}, got {task!r}")
        if self.task not in (TASKS[0], *self.kinds):
            raise BadRecording(f"these touches have no labels for {self.task!r}; they have {(TASKS[0], *self.kinds)}")
        self.freeze()

    def for_task(self, task: str) -> RecordedTouches:
        """The touches of the objects that have a label in a task; raises BadRecording if there are none.

        >>> kinds = {"shapes": ("", "cone")}
        >>> touches = RecordedTouches(np.eye(2), [0, 0], [0, 1], [0, 0], ("press",), ("mug", "hat"), kinds=kinds)
        >>> touches.for_task("shapes").label_names, touches.for_task("shapes").labels.tolist()
        (('cone',), [0])
        """
        found = replace(self, task=task)
        if task == TASKS[0] or (kept := found.labels >= 0).all():
            return found
        if not kept.any():
            raise BadRecording(f"no object has a label for {task!r}")
        return found.only(kept)

    def only(self, kept: NDArray[np.bool_]) -> RecordedTouches:
        """Some of the touches, ``kept (n,)``."""
        arrays = {name: getattr(self, name)[kept] for name in ("features", "actions", "objects", "sessions")}
        return replace(self, **arrays, controls={name: columns[kept] for name, columns in self.controls.items()})

    def without(self, objects: NDArray[np.int64]) -> RecordedTouches:
        """The set without some objects, ``objects (m,)``."""
        left = np.setdiff1d(np.arange(len(self.object_names)), objects)
        found = self.only(np.isin(self.objects, left))
        kinds = {task: tuple(names[i] for i in left) for task, names in self.kinds.items()}
        names = tuple(self.object_names[i] for i in left)
        return replace(found, objects=np.searchsorted(left, found.objects), object_names=names, kinds=kinds)

    def in_random_order(self, seed: int) -> RecordedTouches:
        """The set with the sessions of each object in a random order, as if nothing were known of their time."""
        sessions, rng = self.sessions.copy(), np.random.default_rng(seed)
        for index in np.unique(self.objects).tolist():
            here = self.objects == index
            known, number = np.unique(sessions[here], return_inverse=True)
            sessions[here] = rng.permutation(len(known))[number]
        return replace(self, sessions=sessions)

    def session_counts(self) -> NDArray[np.int64]:
        """Number of sessions of each object with each action, ``(objects, P)``; labels that the task lacks have 0."""
        counts = np.zeros((len(self.object_names), self.num_actions), np.int64)
        np.add.at(counts, tuple(np.unique([self.objects, self.actions, self.sessions], axis=1)[:2]), 1)
        return counts

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the K labels of the task."""
        return self.object_names if self.task == TASKS[0] else tuple(sorted({*self.kinds[self.task]} - {""}))

    @property
    def labels(self) -> NDArray[np.int64]:
        """Label of each touch, ``(n,)``, in [0, K), or -1 for an object without one."""
        if self.task == TASKS[0]:
            return self.objects
        places = {name: place for place, name in enumerate(self.label_names)}
        return np.array([places.get(name, -1) for name in self.kinds[self.task]])[self.objects]

    @property
    def num_touches(self) -> int:
        """Number of touches, n."""
        return len(self.features)

    @property
    def num_actions(self) -> int:
        """Number of actions, P."""
        return len(self.action_names)

    def sessions_of(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Sessions of some rows, ``(r,)``; touches of single sessions are numbered anew if no two actions share one."""
        objects, actions, sessions = self.objects[rows], self.actions[rows], self.sessions[rows]
        pairs = np.unique(np.stack([objects, sessions, actions]), axis=1)
        _, counts = np.unique(pairs[:2], axis=1, return_counts=True)
        is_shared = (counts == self.num_actions).mean() > _SHARED
        return sessions if is_shared else numbered_sessions(objects, actions)

    def labelled(self, rows: NDArray[np.int64], ratios: Floats, novelties: Floats | None = None) -> LabelledTouches:
        """Some rows ``(r,)`` as a reader sees them, with log likelihood ratios ``(r, K)``, and their labels."""
        seen = [None] * len(rows) if novelties is None else novelties[:, None]
        actions = self.actions[rows].tolist()
        listed = [Touch(action, row, new) for action, row, new in zip(actions, ratios, seen, strict=True)]
        return LabelledTouches.of(listed, self.labels[rows], self.objects[rows], self.label_names, self.num_actions)


@dataclass(frozen=True, eq=False)
class Split(FrozenArrays):
    """Indices of touches to learn from, to calibrate on and to test on, and folds of the first two.

    ``calibration`` is empty if calibration is by cross-validation within ``train``. ``inner`` is the fold of each row
    of ``train``; without folds, classifiers are chosen by the calibration touches, and do not learn from these.
    ``folds`` are of the calibration rows: correlations are fitted to ratios calibrated on the other folds.
    """

    train: NDArray[np.int64]
    calibration: NDArray[np.int64]
    test: NDArray[np.int64]
    inner: NDArray[np.int64]
    folds: NDArray[np.int64]


def splits_of(touches: RecordedTouches, num_folds: int) -> list[Split]:
    """Splits by order of recording for objects; for categories and shapes, each object is held out in one split.

    Where an object has fewer than four sessions of an action, calibration is across objects: each half of the objects
    is tested once, and the other half calibrated on.
    """
    if touches.task == TASKS[0]:
        if not _has_few_sessions(touches):
            return [by_session(touches)]
        halves = object_folds(touches.objects, touches.objects, 2)
        return [by_session(touches, halves == half) for half in (0, 1)]
    folds = object_folds(touches.labels, touches.objects, min(num_folds, len(np.unique(touches.objects))))
    return [_held_out(touches, folds == fold) for fold in range(int(folds.max()) + 1)]


def for_use(touches: RecordedTouches) -> Split:
    """A split of all touches to learn from and calibrate on, in the same way as for a test, without test touches."""
    nothing = np.zeros(touches.num_touches, np.bool_)
    return by_session(touches, nothing) if touches.task == TASKS[0] else _held_out(touches, nothing)


def _held_out(touches: RecordedTouches, held: NDArray[np.bool_]) -> Split:
    """Some objects to test on, and the others to learn from, in folds of objects; ``held (n,)``."""
    train = np.flatnonzero(~held)
    pairs = np.unique(np.stack([touches.labels[train], touches.objects[train]]), axis=1)
    fewest = int(np.unique(pairs[0], return_counts=True)[1].min())  # objects of a label
    inner = object_folds(touches.labels[train], touches.objects[train], int(np.clip(fewest, 2, _INNER)))
    folds = inner.astype(np.int64)
    return Split(train, np.empty(0, np.int64), np.flatnonzero(held), folds, folds)


def by_session(touches: RecordedTouches, tested: NDArray[np.bool_] | None = None) -> Split:
    """Each object's first sessions to learn from, later ones to calibrate on, the last ones to test on (3 : 1 : 1).

    Where an object has fewer than four sessions of an action, the last ones are calibrated on or tested on, so that
    both are read after as much was learned. ``tested (n,)`` are the touches of tested objects, all by default; if none
    are tested, the shares are 3 : 1.
    """
    place = np.empty(touches.num_touches)
    rank = np.empty(touches.num_touches, np.int64)
    for index, action in np.unique(np.stack([touches.objects, touches.actions]), axis=1).T.tolist():
        here = np.flatnonzero((touches.objects == index) & (touches.actions == action))
        rank[here] = np.unique(touches.sessions[here], return_inverse=True)[1]
        place[here] = (rank[here] + 0.5) / (rank[here].max() + 1)
    learned, calibrated = (_LEARNED, _CALIBRATED) if tested is None or tested.any() else (_LEARNED / _CALIBRATED, 1.0)
    if not _has_few_sessions(touches):
        train = np.flatnonzero(place < learned)
        calibration = np.flatnonzero((place >= learned) & (place < calibrated))
        blocks = np.minimum((place[train] / learned * 3).astype(np.int64), 2)
        folds = _calibration_folds(touches, calibration, rank)
        return Split(train, calibration, np.flatnonzero(place >= calibrated), blocks, folds)
    counts = touches.session_counts()[touches.objects, touches.actions]
    last = (counts > 1) & ((place >= _CALIBRATED) | (rank == counts - 1))
    held = last if tested is None else last & tested
    calibration = np.flatnonzero(last & ~held)
    owners = touches.objects[calibration]
    folds = object_folds(owners, owners, min(_INNER, len(np.unique(owners)))) if len(owners) else owners
    train = np.flatnonzero(~last)
    return Split(train, calibration, np.flatnonzero(held), np.empty(0, np.int64), folds.astype(np.int64))


def _has_few_sessions(touches: RecordedTouches) -> bool:
    """Whether an object has too few sessions of an action to learn from, calibrate on and test on its own."""
    return bool(touches.session_counts()[touches.objects, touches.actions].min() < _SESSIONS)


def _calibration_folds(touches: RecordedTouches, rows: NDArray[np.int64], rank: NDArray[np.int64]) -> NDArray[np.int64]:
    """Folds of sessions where every object has several to calibrate on, of objects where one has a single session."""
    owners = touches.objects[rows]
    sessions = [len(np.unique(rank[rows][owners == index])) for index in np.unique(owners)]
    if min(sessions) > 1:
        return np.unique(rank[rows], return_inverse=True)[1] % _INNER
    return object_folds(owners, owners, min(_INNER, len(sessions))).astype(np.int64)
