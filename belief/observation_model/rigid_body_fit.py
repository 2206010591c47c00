"""Fits of the joint observation model: temperature, correlation of repeats, drift, and conflict test."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray
from scipy.special import logsumexp

from belief.conflict import MOST_TOUCHES, ConflictTest
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.outcome_mixture import largest_posterior, log_means, misfit
from belief.observation_model.repeat_discount import (
    ASSUMED_CORRELATION,
    Repeats,
    drift_share,
    effective_touches,
    fit_correlation,
    repeats,
)
from belief.touch_batch import TouchBatch
from belief.validation import Floats

_AT_ONCE = 1 << 22  # numbers, of log weights of sequences that are worked on at a time
_SPREAD = 1.0  # of the prior of the log temperature
_COLDEST, _WIDTH, _NEAR = -1.0, 3.0, 1e-2  # of the log temperature: first window of the search, its width, its error
_FITTED_ON, _AT_LEAST = 1200, 400  # sequences for the temperature: at most, and at least where memory is short
_MOST_OF_DRIFT, _STEPS_OF_DRIFT = 40, 8  # touches of a sequence for the drift, and how many of its steps count
_REPEATED = 400  # groups of repeats, at most, for their correlation
_MOST_NUMBERS = 1 << 26  # log weights that are held for a fit
_TESTED_ON = 1200  # objects, at most, for the conflict test


JointModel: TypeAlias = Any
"""A :class:`~belief.observation_model.rigid_body.RigidBodyModel`, whose module imports this one."""


def fitted(model: JointModel, data: LabelledTouches) -> tuple[JointModel, ConflictTest | None]:
    """The model, given at temperature 1, with fitted temperature, correlation and drift, and its conflict test."""
    length = min(model.num_poses, MOST_TOUCHES)
    model = model.at(_best_temperature(model, *_in_different_poses(model, data, length, length, _AT_LEAST)))
    drift = 0.0
    if model.num_poses > MOST_TOUCHES:
        temperature, drift = _fitted_drift(model, data)
        model = model.at(temperature)
    model = model.at(model.temperature, _fitted_correlation(model, data), drift)
    return model, _fitted_conflict_test(model, data)


def _fitted_drift(model: JointModel, data: LabelledTouches) -> tuple[float, float]:
    """Temperature and drift with the lowest mean NLL of the shape after few touches of an object and after many."""
    length = min(model.num_poses, _MOST_OF_DRIFT)
    touches, truth = _in_different_poses(model, data, length, len(_some_numbers(length)))
    numbers = _some_numbers(touches.num_touches)  # objects may have been touched less often than there are poses
    if len(numbers) < 2:
        return model.temperature, 0.0
    sums = [
        after.astype(np.float32)
        for number, (_, _, after) in enumerate(model.at(1.0, 0.0, 0.0).steps(touches), 1)
        if number in numbers
    ]
    expected, rows = np.log(model.temperature), np.arange(len(truth))

    def loss(parameters: Floats) -> float:
        log_temperature, drift = float(parameters[0]), float(parameters[1])
        total = ((log_temperature - expected) / _SPREAD) ** 2 / (2 * len(truth))
        for number, some in zip(numbers, sums, strict=True):
            found = logsumexp(some * np.float32(np.exp(-log_temperature) * drift_share(number, drift)), axis=2)
            total += float((logsumexp(found, axis=1) - found[rows, truth]).mean())
        return float(total)

    bounds = [(expected - 1.0, expected + 1.0), (0.0, 1.0)]
    simplex = np.array([[expected, 0.0], [expected + 0.1, 0.0], [expected, 0.05]])
    options: Any = {"xatol": 2e-3, "fatol": 1e-4, "initial_simplex": simplex}
    best = scipy.optimize.minimize(loss, simplex[0], method="Nelder-Mead", bounds=bounds, options=options)
    return float(np.exp(best.x[0])), float(best.x[1])


def _some_numbers(length: int) -> NDArray[np.int64]:
    """The numbers of touches up to ``length`` that the fit of the drift uses."""
    return np.unique(np.geomspace(1, length, _STEPS_OF_DRIFT).round().astype(np.int64))


def _in_different_poses(
    model: JointModel, data: LabelledTouches, length: int, kept: int, least: int = 1
) -> tuple[TouchBatch, NDArray[np.int64]]:
    """Sequences of touches in different poses, of objects that were touched in enough, and their shapes."""
    rng, found = np.random.default_rng(0), []
    most = max(least, min(_FITTED_ON, _that_fit(model, kept)))
    for _ in range(min(model.num_poses, -(-most // data.num_objects))):
        order = rng.permutation(len(data.objects))
        poses = (data.objects * data.num_poses + data.poses)[order]
        again = np.ones(len(order), np.bool_)
        again[np.unique(poses, return_index=True)[1]] = False
        order = order[np.argsort(again, kind="stable")]
        by_object = order[np.argsort(data.objects[order], kind="stable")]
        found.append(_sequences(data, by_object, min(most, data.num_objects), length))
    rows = np.concatenate([some for some, _ in found])[:most]
    return data.batch.take((0, rows)), np.concatenate([some for _, some in found])[:most]


def _best_temperature(model: JointModel, touches: TouchBatch, truth: NDArray[np.int64]) -> float:
    """The most probable temperature, by the NLL of the shape after one touch of each of S objects, two, and so on."""
    expected, model = np.log(model.temperature), model.at(1.0)
    size = max(1, _that_fit(model, touches.num_touches))
    blocks = [slice(first, first + size) for first in range(0, len(truth), size)]

    def steps(block: slice) -> Iterator[NDArray[np.float32]]:
        return (after.astype(np.float32) for _, _, after in model.steps(touches.sequences(block)))

    held = list(steps(blocks[0])) if len(blocks) == 1 else None  # otherwise computed anew for every temperature

    def loss(log_temperature: float) -> float:
        scale = np.float32(np.exp(-log_temperature))
        total = ((log_temperature - expected) / _SPREAD) ** 2 / (2 * len(truth))
        for block in blocks:
            right = truth[block]
            for some in held or steps(block):
                found = logsumexp(some * scale, axis=2)
                nll = logsumexp(found, axis=1) - found[np.arange(len(right)), right]
                total += float(nll.sum()) / len(truth)
        return float(total)

    low, direction = _COLDEST, 0
    while True:  # the prior ends it, of a reader that is all noise or never wrong, too
        window = (low, low + _WIDTH)
        best = float(scipy.optimize.minimize_scalar(loss, bounds=window, method="bounded", options={"xatol": _NEAR}).x)
        beyond = int(window[1] - best < 2 * _NEAR) - int(best - window[0] < 2 * _NEAR)
        if beyond in (0, -direction):
            return float(np.exp(best))
        low, direction = low + beyond * _WIDTH / 2, beyond


def _fitted_correlation(model: JointModel, data: LabelledTouches) -> float:
    """The correlation of repeats with the lowest NLL of the shape after several touches of an object in one pose."""
    found = repeats(data)
    if found is None:
        return ASSUMED_CORRELATION
    length = found.rows.shape[1]
    most = max(2, min(_REPEATED, _that_fit(model, length)))
    some = np.sort(np.random.default_rng(3).permutation(len(found.rows))[:most])
    found = Repeats(found.rows[some], found.shapes[some])
    rows = np.where(found.rows >= 0, found.rows, found.rows[:, :1])  # padding does not count
    touches = data.batch.take((0, rows))
    sums = np.stack([after.astype(np.float32) for _, _, after in model.steps(touches)][1:], axis=1)  # (G, n - 1, K, N)
    numbers = np.arange(2, length + 1)

    def log_likelihoods(correlation: float) -> Floats:
        shares = (effective_touches(numbers, correlation) / numbers).astype(np.float32)
        return np.asarray(logsumexp(sums * shares[:, None, None], axis=3), np.float64)

    return fit_correlation(log_likelihoods, found)


def _fitted_conflict_test(model: JointModel, data: LabelledTouches) -> ConflictTest | None:
    """The conflict test from one sequence of touches of each object, in random order."""
    order = np.random.default_rng(1).permutation(len(data.objects))
    by_object = order[np.argsort(data.objects[order], kind="stable")]
    rows, shapes = _sequences(data, by_object, _TESTED_ON, MOST_TOUCHES)
    touches = data.batch.take((0, rows))
    assert touches.features is not None, "checked by the caller"
    found, certainties = _misfits(model, touches)
    return ConflictTest.fit(touches.features.astype(np.float64), found, shapes, certainties)


def _misfits(model: JointModel, batch: TouchBatch) -> tuple[Floats, Floats]:
    """How badly each touch fits the earlier ones of its sequence, and how certain the shape was before it."""
    found, certainties, length = np.empty(batch.poses.shape), np.empty(batch.poses.shape), max(1, batch.num_touches)
    size = max(1, _AT_ONCE // (len(model.shape_labels) * model.num_hypotheses * length))
    for first in range(0, len(batch), size):
        block = slice(first, first + size)
        for step, (before, scores, _) in enumerate(model.steps(batch.sequences(block))):
            log_likelihoods = log_means(before)
            found[block, step] = misfit(scores, log_likelihoods, log_means(before + scores))
            certainties[block, step] = largest_posterior(log_likelihoods)
    return found, certainties


def _that_fit(model: JointModel, kept: int) -> int:
    """Number of sequences that fit in memory with the log weights after ``kept`` steps."""
    return _MOST_NUMBERS // (kept * len(model.shape_labels) * model.num_hypotheses)


def _sequences(
    data: LabelledTouches, by_object: NDArray[np.int64], most_objects: int, longest: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows ``(S, n)`` of the first touches of random objects, of each as many, and the objects' shapes ``(S,)``."""
    ends = np.searchsorted(data.objects[by_object], np.arange(data.num_objects + 1))
    numbers, shapes = np.diff(ends), data.shape_of_object
    usual = [np.quantile(numbers[shapes == shape], 0.25, method="lower") for shape in np.unique(shapes)]
    length = min(longest, int(min(usual)))
    ids = np.flatnonzero(numbers >= length)
    if len(ids) > most_objects:  # random ones, because shapes alternate in collections
        ids = np.sort(np.random.default_rng(2).permutation(ids)[:most_objects])
    return by_object[ends[ids][:, None] + np.arange(length)], shapes[ids]
