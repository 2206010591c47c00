"""Splits of recorded touches into what a reader learns from, what it is calibrated on, and what it is tested on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.recorded.touches import TASKS, RecordedTouches
from belief.frozen import FrozenArrays
from belief.observation_model.calibration_data import object_folds

_LEARNED, _CALIBRATED = 0.6, 0.8  # ends of the shares of an object's sessions
_INNER = 4


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
