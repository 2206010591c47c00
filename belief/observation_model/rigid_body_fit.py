"""Fits of the joint observation model: its temperature, the correlation of its repeats, and its conflict test."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp

from belief.conflict import MOST_TOUCHES, ConflictTest
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.repeat_discount import (
    ASSUMED_CORRELATION,
    Repeats,
    effective_touches,
    fit_correlation,
    repeats,
)
from belief.problem import Floats
from belief.touch_batch import TouchBatch

if TYPE_CHECKING:
    from belief.observation_model.rigid_body import RigidBodyModel

ANYWHERE, NEARBY = 1.0, 0.2
"""Spread of the prior of the log temperature: in any world, and after another world."""

_FITTED_ON = 400  # objects, at most, for the temperature
_REPEATED = 400  # groups of repeats, at most, for their correlation
_MOST_NUMBERS = 1 << 25  # that are held for this fit
_TESTED_ON = 1200  # objects, at most, for the conflict test


def fitted_temperature(model: RigidBodyModel, data: LabelledTouches) -> float:
    """The temperature with the lowest mean NLL of the shape after one touch of an object, two, … up to P or 12.

    The touches of a sequence are in different poses, if the object was touched in all.
    """
    rng = np.random.default_rng(0)
    order = rng.permutation(len(data.objects))
    first_in_pose = np.zeros(len(order), np.int64)
    first_in_pose[np.unique((data.objects * data.num_poses + data.poses)[order], return_index=True)[1]] = 1
    order = order[np.argsort(1 - first_in_pose, kind="stable")]
    by_object = order[np.argsort(data.objects[order], kind="stable")]
    touches, shapes = _sequences(data, by_object, _FITTED_ON, min(model.num_poses, MOST_TOUCHES))
    return best_temperature(model, touches, shapes, ANYWHERE)


def best_temperature(model: RigidBodyModel, touches: TouchBatch, truth: NDArray[np.int64], spread: float) -> float:
    """The most probable temperature, by the NLL of the shape after each touch of sequences of S objects.

    Args:
        model: whose temperature the log-normal prior is about.
        touches: S sequences.
        truth: shape of each object, ``(S,)``.
        spread: of the prior of the log temperature.
    """
    expected, model = np.log(model.temperature), model.at(1.0)
    sums = [after.astype(np.float32) for _, _, after in model.steps(touches)]

    def loss(log_temperature: float) -> float:
        scale = np.float32(np.exp(-log_temperature))
        total = ((log_temperature - expected) / spread) ** 2 / (2 * len(truth))
        for some in sums:
            found = logsumexp(some * scale, axis=2)
            total += float((logsumexp(found, axis=1) - found[np.arange(len(truth)), truth]).mean())
        return float(total)

    best = minimize_scalar(loss, bounds=(-1.0, 2.0), method="bounded", options={"xatol": 1e-2})
    return float(np.exp(best.x))


def fitted_correlation(model: RigidBodyModel, data: LabelledTouches) -> float:
    """The correlation of repeats with the lowest NLL of the shape after several touches of an object in one pose.

    It is assumed where no object was touched twice in a pose.
    """
    found = repeats(data)
    if found is None:
        return ASSUMED_CORRELATION
    complete = np.flatnonzero((found.rows >= 0).sum(axis=1) == found.rows.shape[1])
    length = found.rows.shape[1]
    most = max(2, min(_REPEATED, _MOST_NUMBERS // (length * len(model.shape_labels) * model.num_hypotheses)))
    some = np.sort(np.random.default_rng(3).permutation(complete)[:most])
    found = Repeats(found.rows[some], found.shapes[some])
    touches = _touches(data, found.rows)
    sums = np.stack([after.astype(np.float32) for _, _, after in model.steps(touches)][1:], axis=1)  # (G, n - 1, K, N)
    numbers = np.arange(2, length + 1)

    def log_likelihoods(correlation: float) -> Floats:
        shares = (effective_touches(numbers, correlation) / numbers).astype(np.float32)
        return np.asarray(logsumexp(sums * shares[:, None, None], axis=3), np.float64)

    return fit_correlation(log_likelihoods, found)


def fitted_conflict_test(model: RigidBodyModel, data: LabelledTouches) -> ConflictTest | None:
    """The conflict test from one sequence of touches of each object, in random order."""
    order = np.random.default_rng(1).permutation(len(data.objects))
    by_object = order[np.argsort(data.objects[order], kind="stable")]
    return conflict_test(model, *_sequences(data, by_object, _TESTED_ON, MOST_TOUCHES))


def conflict_test(model: RigidBodyModel, touches: TouchBatch, shapes: ArrayLike) -> ConflictTest | None:
    """The conflict test from one sequence of touches of each object."""
    assert touches.features is not None, "checked by the caller"
    return ConflictTest.fit(touches.features.astype(np.float64), model.misfits(touches), shapes)


def _sequences(
    data: LabelledTouches, by_object: NDArray[np.int64], most_objects: int, longest: int
) -> tuple[TouchBatch, NDArray[np.int64]]:
    """The first touches of random objects, of each as many, and the shapes of the objects.

    Args:
        data: all touches.
        by_object: their rows, objects one after the other.
        most_objects: number of objects.
        longest: number of touches of each.
    """
    ids = np.arange(data.num_objects)
    if data.num_objects > most_objects:  # random ones, because shapes alternate in collections
        ids = np.sort(np.random.default_rng(2).permutation(ids)[:most_objects])
    ends = np.searchsorted(data.objects[by_object], np.arange(data.num_objects + 1))
    length = min(longest, int(np.diff(ends)[ids].min()))
    return _touches(data, by_object[ends[ids][:, None] + np.arange(length)]), data.shape_of_object[ids]


def _touches(data: LabelledTouches, rows: NDArray[np.int64]) -> TouchBatch:
    """The touches in these rows, ``(S, n)``, as sequences."""
    assert data.batch.features is not None, "checked by the caller"
    return TouchBatch(data.poses[rows], data.logits[rows], np.asarray(data.batch.features[0])[rows])
