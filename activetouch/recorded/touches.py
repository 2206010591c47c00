"""Recorded touches of real objects, and splits of them: to learn from, to calibrate on, and to test on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from belief.frozen import FrozenArrays
from belief.naming import few
from belief.observation_model.action_kernel import numbered_sessions
from belief.observation_model.calibration_data import LabelledTouches, object_folds
from belief.problem import Touch
from belief.validation import Floats

TASKS = "objects", "categories", "shapes"
"""What the labels of touches are: their objects, or kinds of objects."""
LARGEST = 1e100
"""Size of a feature, so that squares and their sums are finite."""

_SHARED = 0.9  # of the sessions have all actions, if actions are recorded in sessions
_SESSIONS, _OBJECTS = 4, 3  # of three sessions none is left to calibrate on; objects of a category or shape
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
        arrays = {name: getattr(self, name)[kept] for name in ("features", "actions", "objects", "sessions")}
        return replace(found, **arrays)

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
        """N."""
        return len(self.features)

    @property
    def num_actions(self) -> int:
        """P."""
        return len(self.action_names)

    def sessions_of(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Sessions of some rows, ``(r,)``; touches of single sessions are numbered anew if no two actions share one."""
        objects, actions, sessions = self.objects[rows], self.actions[rows], self.sessions[rows]
        pairs = np.unique(np.stack([objects, sessions, actions]), axis=1)
        _, counts = np.unique(pairs[:2], axis=1, return_counts=True)
        is_shared = (counts == self.num_actions).mean() > _SHARED
        return sessions if is_shared else numbered_sessions(objects, actions)

    def labelled(self, rows: NDArray[np.int64], ratios: Floats) -> LabelledTouches:
        """Some rows ``(r,)`` as a reader sees them, with log likelihood ratios ``(r, K)``, and their labels."""
        listed = [Touch(int(action), row) for action, row in zip(self.actions[rows], ratios, strict=True)]
        return LabelledTouches.of(listed, self.labels[rows], self.objects[rows], self.label_names, self.num_actions)


def check_recorded(touches: RecordedTouches) -> tuple[str, ...]:
    """Check that a set can be split, read and searched in, and return remarks about what weakens its results.

    Raises:
        BadRecording: there are fewer than two labels, one has too few objects, or an object has too few sessions of an
            action; the message says which and what is needed.

    >>> rows = np.arange(12.0).reshape(12, 1) % 5
    >>> mugs = RecordedTouches(rows, [0] * 12, [0, 1] * 6, np.arange(12) // 2, ("press",), ("mug", "ball"))
    >>> check_recorded(mugs)
    ('7 touches have exactly the features of an earlier touch; copies leak from training into tests',)
    """
    names = touches.object_names
    if len(touches.label_names) < 2:
        raise BadRecording(
            f"a search needs at least two different {touches.task}, there is {list(touches.label_names)}"
        )
    counts = np.zeros((len(names), touches.num_actions), np.int64)
    np.add.at(counts, tuple(np.unique([touches.objects, touches.actions, touches.sessions], axis=1)[:2]), 1)
    needed = _SESSIONS if touches.task == TASKS[0] else 1
    short = counts < needed
    if touches.task != TASKS[0]:
        kinds = touches.kinds[touches.task]
        short &= np.array(kinds)[:, None] != ""
        if scarce := {kind: kinds.count(kind) for kind in touches.label_names if kinds.count(kind) < _OBJECTS}:
            raise BadRecording(
                f"{touches.task} need at least {_OBJECTS} objects of each, to learn from, to calibrate on and to test "
                f"on; there are {scarce}"
            )
    if lacking := np.flatnonzero(short.any(axis=1)).tolist():
        missing = [[f"{counts[i, a]} of {touches.action_names[a]}" for a in np.flatnonzero(short[i])] for i in lacking]
        listed = "; ".join(f"{names[i]} ({', '.join(parts)})" for i, parts in zip(lacking, missing, strict=True))
        raise BadRecording(
            f"{len(lacking)} of {len(names)} objects have too few sessions: {listed}; {touches.task} need at least "
            f"{needed} of each action, to learn from, to calibrate on and to test on; leave these out"
        )
    copies = len(touches.features) - len(np.unique(np.column_stack([touches.features, touches.actions]), axis=0))
    said = "touches have exactly the features of an earlier touch; copies leak from training into tests"
    return (*([f"{copies} {said}"] if copies else []), *suspicious_features(touches))


def suspicious_features(touches: RecordedTouches) -> tuple[str, ...]:
    """Sentences about features that name the object of a touch, or number its session or row.

    >>> rows = [[0.1, 7.0], [0.3, 7.0], [0.2, 8.0], [0.4, 8.0]]
    >>> mugs = RecordedTouches(rows, [0] * 4, [0, 0, 1, 1], [0, 1] * 2, ("press",), ("mug", "cup"))
    >>> suspicious_features(mugs)  # doctest: +ELLIPSIS
    ('these features name the object: feature 1. They are equal in all touches of an object and differ between...',)
    """
    steps = np.diff(touches.features, axis=0)
    counts = (steps == steps[:1]).all(axis=0) & (steps[:1] != 0.0).any(axis=0) & (touches.num_touches > 2)
    by_object, by_session = (_tells(touches.features, groups) for groups in (touches.objects, touches.sessions))
    same = "are equal in all touches of"
    found = (
        ("name the object", by_object, f"{same} an object and differ between objects"),
        ("number the session", by_session, f"{same} a session and differ between sessions"),
        ("count the rows", counts, "grow by the same in every row"),
    )
    names = touches.feature_names or [f"feature {i}" for i in range(touches.features.shape[1])]
    return tuple(
        f"these features {what}: {few([names[i] for i in np.flatnonzero(which)], 12)}. They {why}; leave out what was "
        "not measured in the touch"
        for what, which, why in found
        if which.any()
    )


def _tells(features: Floats, groups: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each feature is equal within every group and differs between groups of two rows or more on average."""
    order = np.argsort(groups, kind="stable")
    starts = np.flatnonzero(np.diff(groups[order], prepend=groups.min() - 1))
    if 2 * len(starts) > len(groups):
        return np.zeros(features.shape[1], np.bool_)
    low, high = (bound.reduceat(features[order], starts) for bound in (np.minimum, np.maximum))
    return np.asarray((low == high).all(axis=0) & (np.ptp(low, axis=0) > 0.0))


@dataclass(frozen=True, eq=False)
class Split(FrozenArrays):
    """Indices of touches.

    Attributes:
        train: to learn from.
        calibration: to calibrate on; empty where calibration is by cross-validation within ``train``.
        test: to test on.
        inner: fold of each row of ``train``, for the choice of a classifier and for that cross-validation.
        folds: fold of each row that is calibrated on; the calibration of a row is of other folds where correlations are
            fitted.
    """

    train: NDArray[np.int64]
    calibration: NDArray[np.int64]
    test: NDArray[np.int64]
    inner: NDArray[np.int64]
    folds: NDArray[np.int64]


def splits_of(touches: RecordedTouches, num_folds: int) -> list[Split]:
    """Objects in order of recording; of categories and shapes whole objects held out, each in one of the splits."""
    if touches.task == TASKS[0]:
        return [by_session(touches)]
    folds = object_folds(touches.labels, touches.objects, min(num_folds, len(np.unique(touches.objects))))
    return [_held_out(touches, folds == fold) for fold in range(int(folds.max()) + 1)]


def for_use(touches: RecordedTouches) -> Split:
    """All touches to learn from and calibrate on, in the same way as for a test, and none to test on."""
    if touches.task == TASKS[0]:
        return by_session(touches, is_tested=False)
    return _held_out(touches, np.zeros(touches.num_touches, np.bool_))


def _held_out(touches: RecordedTouches, held: NDArray[np.bool_]) -> Split:
    """Some objects to test on, and the others to learn from, in folds of objects; ``held (n,)``."""
    train = np.flatnonzero(~held)
    pairs = np.unique(np.stack([touches.labels[train], touches.objects[train]]), axis=1)
    fewest = int(np.unique(pairs[0], return_counts=True)[1].min())  # objects of a label
    inner = object_folds(touches.labels[train], touches.objects[train], int(np.clip(fewest, 2, _INNER)))
    folds = inner.astype(np.int64)
    return Split(train, np.empty(0, np.int64), np.flatnonzero(held), folds, folds)


def by_session(touches: RecordedTouches, is_tested: bool = True) -> Split:
    """Each object's first sessions to learn from, later ones to calibrate on, the last ones to test on (3 : 1 : 1).

    Args:
        touches: the set.
        is_tested: False to learn from and calibrate on all sessions (3 : 1).
    """
    learned, calibrated = (_LEARNED, _CALIBRATED) if is_tested else (_LEARNED / _CALIBRATED, 1.0)
    place = np.empty(touches.num_touches)
    rank = np.empty(touches.num_touches, np.int64)
    for index, action in np.unique(np.stack([touches.objects, touches.actions]), axis=1).T.tolist():
        here = np.flatnonzero((touches.objects == index) & (touches.actions == action))
        rank[here] = np.unique(touches.sessions[here], return_inverse=True)[1]
        place[here] = (rank[here] + 0.5) / (rank[here].max() + 1)
    train = np.flatnonzero(place < learned)
    calibration = np.flatnonzero((place >= learned) & (place < calibrated))
    blocks = np.minimum((place[train] / learned * 3).astype(np.int64), 2)
    folds = _calibration_folds(touches, calibration, rank)
    return Split(train, calibration, np.flatnonzero(place >= calibrated), blocks, folds)


def _calibration_folds(touches: RecordedTouches, rows: NDArray[np.int64], rank: NDArray[np.int64]) -> NDArray[np.int64]:
    """Folds of sessions where every object has several to calibrate on, of objects where one has a single session."""
    owners = touches.objects[rows]
    sessions = [len(np.unique(rank[rows][owners == index])) for index in np.unique(owners)]
    if min(sessions) > 1:
        return np.unique(rank[rows], return_inverse=True)[1] % _INNER
    return object_folds(owners, owners, min(_INNER, len(sessions))).astype(np.int64)
