"""Splits of recorded touches into what a reader learns from, what it is calibrated on, and what it is tested on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.recorded.touches import TaskTouches
from belief.cross_validation import object_folds
from belief.frozen import FrozenArrays

_LEARNED, _CALIBRATED = 0.6, 0.8  # ends of the shares of an object's sessions
_INNER = 4


@dataclass(frozen=True, eq=False)
class Split(FrozenArrays):
    """Indices into the rows of a task.

    Attributes:
        train: to learn from.
        calibration: to calibrate on; empty where calibration is by cross-validation within ``train``.
        test: to test on.
        inner: fold of each row of ``train``, for that cross-validation and for the choice of a classifier.
        folds: fold of each row of ``calibrated``; the calibration of a row is of other folds where correlations are
            fitted.
    """

    train: NDArray[np.int64]
    calibration: NDArray[np.int64]
    test: NDArray[np.int64]
    inner: NDArray[np.int64]
    folds: NDArray[np.int64]

    @property
    def calibrated(self) -> NDArray[np.int64]:
        """The rows that the calibration is fitted to."""
        return self.calibration if len(self.calibration) else self.train


def for_use(touches: TaskTouches) -> Split:
    """All touches to learn from and calibrate on, in the same way as for a test, and none to test on."""
    if touches.task == "objects":
        return by_session(touches, is_tested=False)
    return _held_out(touches, np.zeros(len(touches.rows), np.bool_))


def by_session(touches: TaskTouches, is_tested: bool = True) -> Split:
    """Each object's first sessions to learn from, later ones to calibrate on, the last ones to test on (3 : 1 : 1).

    Args:
        touches: of a task whose labels are objects.
        is_tested: False to learn from and calibrate on all sessions (3 : 1).
    """
    learned, calibrated = (_LEARNED, _CALIBRATED) if is_tested else (_LEARNED / _CALIBRATED, 1.0)
    place = np.empty(len(touches.rows))
    rank = np.empty(len(touches.rows), np.int64)
    for index in np.unique(touches.objects).tolist():
        own = np.flatnonzero(touches.objects == index)
        for action in np.unique(touches.actions[own]).tolist():
            here = own[touches.actions[own] == action]
            ranks = np.unique(touches.sessions[here], return_inverse=True)[1]
            rank[here] = ranks
            place[here] = (ranks + 0.5) / (ranks.max() + 1)
    train = np.flatnonzero(place < learned)
    calibration = np.flatnonzero((place >= learned) & (place < calibrated))
    blocks = np.minimum((place[train] / learned * 3).astype(np.int64), 2)
    folds = _calibration_folds(touches, calibration if len(calibration) else train, rank)
    return Split(train, calibration, np.flatnonzero(place >= calibrated), blocks, folds)


def by_object(touches: TaskTouches, num_folds: int) -> list[Split]:
    """Whole objects held out, in folds in which every object is tested once."""
    folds = object_folds(touches.labels, touches.objects, num_folds)
    return [_held_out(touches, folds == fold) for fold in range(num_folds)]


def _held_out(touches: TaskTouches, held: NDArray[np.bool_]) -> Split:
    """Some objects to test on, and the others to learn from; ``held (n,)``."""
    train = np.flatnonzero(~held)
    inner = object_folds(touches.labels[train], touches.objects[train], _inner_folds(touches, train)).astype(np.int64)
    return Split(train, np.empty(0, np.int64), np.flatnonzero(held), inner, inner)


def _calibration_folds(touches: TaskTouches, rows: NDArray[np.int64], rank: NDArray[np.int64]) -> NDArray[np.int64]:
    """Folds of sessions where every object has several to calibrate on, of objects where one has a single session."""
    sessions = [
        len(np.unique(rank[rows][touches.objects[rows] == index])) for index in np.unique(touches.objects[rows])
    ]
    if min(sessions) > 1:
        return np.unique(rank[rows], return_inverse=True)[1] % _INNER
    folds = object_folds(touches.labels[rows], touches.objects[rows], min(_INNER, len(sessions)))
    return folds.astype(np.int64)


def _inner_folds(touches: TaskTouches, train: NDArray[np.int64]) -> int:
    """As many folds as the label with the fewest objects has, but at least 2 and at most 4."""
    fewest = min(
        len(np.unique(touches.objects[train][touches.labels[train] == label]))
        for label in np.unique(touches.labels[train]).tolist()
    )
    return int(np.clip(fewest, 2, _INNER))
