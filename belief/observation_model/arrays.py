"""Observation models from arrays: what a classifier of your own said of objects that you know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.metrics.calibration_at_stop import CalibrationAtStop, calibration_at_stop, stops
from belief.observation_model.calibration_data import numbered_objects
from belief.observation_model.model import ArrayModel
from belief.observation_model.registry import Fit, fits
from belief.observation_model.selection import (
    NUM_FOLDS,
    ModelChoice,
    choose_observation_model,
    grouped,
    log_posteriors_by_touch,
)
from belief.statistics.stop_thresholds import CandidateStops, CertifiedThresholds, certified_thresholds
from belief.touch_batch import TouchBatch
from belief.validation import Floats, labelled_logits, pose_count, require_fraction, unmasked, warn_of_probs


def fit_observation_model(
    logits: ArrayLike,
    labels: ArrayLike,
    groups: ArrayLike,
    poses: ArrayLike | None = None,
    *,
    shape_labels: Sequence[str] | None = None,
    num_poses: int | None = None,
    candidates: Mapping[str, Fit] | None = None,
    num_folds: int = NUM_FOLDS,
) -> ModelChoice:
    """Fit the observation models to touches of known objects, and choose the one with the least cross-validated loss.

    The objects must be others than those with which the classifier was trained. Where they were touched several times
    in a pose, the models learn how far such touches repeat each other.

    Args:
        logits: ``(n, K)``; :func:`~belief.calibration.logits_from_probs` makes them from probabilities.
        labels: true shape of each touch, ``(n,)``, in [0, K).
        groups: object of each touch, ``(n,)``, any labels that can be sorted.
        poses: pose, view or sensor of each touch, ``(n,)``, integers from 0; one and the same by default.
        shape_labels: names of the K shapes; "0", "1", … by default.
        num_poses: P; by default one more than the largest pose.
        candidates: functions that fit a model, by name; by default all that read logits.
        num_folds: folds of whole objects, at most the number of objects.

    Returns:
        The choice, which prints as a table; its ``model`` is ready for a :class:`~belief.BeliefTracker`.

    Raises:
        ValueError: arrays that do not fit, NaN or infinite logits, labels or poses out of range, an object with two
            labels, or fewer objects than folds.

    Example:
        >>> from belief.synthetic import random_model
        >>> rng, groups = np.random.default_rng(0), np.arange(400) // 4
        >>> source = random_model(rng, num_shapes=2, num_poses=1)
        >>> logits = [touch.logits for i in range(100) for touch in source.sample(i % 2, [0] * 4, rng)]
        >>> choice = fit_observation_model(logits, groups % 2, groups, shape_labels=("mug", "ball"))
        >>> choice.name == min(choice.losses, key=choice.losses.get), choice.model.shape_labels
        (True, ('mug', 'ball'))
    """
    batch, y = _batch(logits, labels, groups, poses)
    return choose_observation_model(
        batch.sequence(0),
        y,
        groups,
        shape_labels=tuple(map(str, range(batch.num_shapes))) if shape_labels is None else shape_labels,
        num_poses=pose_count(batch.poses[0], num_poses),
        candidates=fits() if candidates is None else candidates,
        num_folds=num_folds,
    )


def calibration_of_stops(
    model: ArrayModel,
    logits: ArrayLike,
    labels: ArrayLike,
    groups: ArrayLike,
    threshold: float = 0.95,
    poses: ArrayLike | None = None,
) -> CalibrationAtStop:
    """Touch each object until a shape has a given posterior; compare what is stated then with what is right.

    The prior is uniform, and the ``threshold`` of the posterior is in (1/K, 1). The arrays are as of
    :func:`fit_observation_model`, of objects other than those to which the model was fitted; the touches of an object
    are in the order of the rows.

    Returns:
        Stated confidence and accuracy by number of touches; objects for which no shape becomes so probable are counted
        in ``never``.

    Raises:
        ValueError: as :func:`fit_observation_model`; a threshold out of range, or one that no object reaches.

    Example:
        >>> from belief.synthetic import random_model
        >>> rng, groups = np.random.default_rng(0), np.arange(400) // 4
        >>> model = random_model(rng, num_shapes=2, num_poses=1)
        >>> logits = [touch.logits for i in range(100) for touch in model.sample(i % 2, [0] * 4, rng)]
        >>> print(calibration_of_stops(model, logits, groups % 2, groups))
        touches  count  stated  right           95 %
        ────────────────────────────────────────────
        2           73   0.971  1.000  0.951 … 1.000
        4           18   0.992  1.000  0.815 … 1.000
        all         91   0.975  1.000  0.960 … 1.000
        9 more never reach the threshold.
    """
    require_fraction("threshold", threshold)
    num_shapes = len(model.shape_labels)
    if threshold * num_shapes <= 1.0:
        raise ValueError(f"threshold must be above 1/K = {1 / num_shapes:.3g}, got {threshold}")
    every = _posteriors(model, logits, labels, groups, poses)
    found = [stops(log_probs, shapes, threshold) for log_probs, shapes in every]
    stated, correct, touches = (
        np.concatenate([getattr(part, name) for part in found]) for name in ("claims", "correct", "num_touches")
    )
    if not len(stated):
        raise ValueError(f"no object reaches a posterior of {threshold} with its touches; lower the threshold")
    never = sum(len(shapes) for _, shapes in every) - len(stated)
    return replace(calibration_at_stop(np.minimum(stated, 1.0), correct, touches), never=never)


def certified_stops(
    model: ArrayModel,
    logits: ArrayLike,
    labels: ArrayLike,
    groups: ArrayLike,
    risk: float = 0.05,
    confidence: float = 0.9,
    poses: ArrayLike | None = None,
) -> CertifiedThresholds:
    """Posteriors at which to stop, so that at every number of touches at most a given fraction of stops is wrong.

    The thresholds belong together: for each object, stop at the first touch k at which some shape has a posterior of at
    least ``thresholds[k - 1]``, of the last one for more touches. Numbers of touches after which few objects stop are
    pooled in this last one: the promise is for their stops together. :mod:`belief.statistics.stop_thresholds` has the
    theorem and its proof. The promise is for objects drawn as these, touched in the same way.

    The arrays are as of :func:`calibration_of_stops`, of independent objects; stated posteriors need not be right. The
    fraction ``risk``, and the ``confidence`` with which the promise holds, are in (0, 1).

    Returns:
        The thresholds; infinite where nothing is promised. All are if there are too few objects: fewer than
        :func:`~belief.statistics.stop_thresholds.least_searches`, or some times as many where some stops are wrong. It
        prints as a table, with the reason if nothing is promised.

    Raises:
        ValueError: as :func:`fit_observation_model`; a number out of its range, or fewer than two objects.

    Example:
        >>> from belief.synthetic import random_model
        >>> rng, groups = np.random.default_rng(0), np.arange(1600) // 4
        >>> model = random_model(rng, num_shapes=2, num_poses=1)
        >>> logits = [touch.logits for i in range(400) for touch in model.sample(i % 2, [0] * 4, rng)]
        >>> print(certified_stops(model, logits, groups % 2, groups, risk=0.1))
        touches  stop from  stops  wrong
        ────────────────────────────────
        1            never      0      0
        ≥ 2           0.65    200     12
    """
    every = _posteriors(model, logits, labels, groups, poses)
    objects = sum(len(shapes) for _, shapes in every)
    place = np.random.default_rng(0).permutation(objects)  # an order that says nothing about them
    parts, before = [], 0
    for log_probs, shapes in every:
        number, length, _ = log_probs.shape
        index = np.repeat(place[before : before + number], length)
        earlier = np.tile(np.arange(length), number)  # touches before it: entry k - 1 is of touch k
        stated = np.exp(np.minimum(log_probs.max(axis=2), 0.0)).ravel()
        parts.append((index, earlier, stated, (log_probs.argmax(axis=2) != shapes[:, None]).ravel()))
        before += number
    index, earlier, stated, is_wrong = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.argsort(index, kind="stable")
    candidates = CandidateStops(index[order], earlier[order], stated[order], is_wrong[order], objects)
    return replace(certified_thresholds(candidates, risk, confidence), first=1)


def _posteriors(
    model: ArrayModel, logits: ArrayLike, labels: ArrayLike, groups: ArrayLike, poses: ArrayLike | None
) -> list[tuple[Floats, NDArray[np.int64]]]:
    """Log posteriors after each touch, ``(S, n, K)``, and true shapes, ``(S,)``, of the objects with n touches."""
    batch, y = _batch(logits, labels, groups, poses)
    return [(log_posteriors_by_touch(model, some), y[rows[:, 0]]) for some, rows in grouped(batch, groups)]


def _batch(
    logits: ArrayLike, labels: ArrayLike, groups: ArrayLike, poses: ArrayLike | None
) -> tuple[TouchBatch, NDArray[np.int64]]:
    """All touches as one sequence, and their labels."""
    z, y = labelled_logits(logits, labels)
    warn_of_probs(z, "logits", "give belief.calibration.logits_from_probs of them")
    ids = unmasked(groups, "groups")
    p = np.zeros(len(y), np.int64) if poses is None else unmasked(poses, "poses")
    for name, values in (("groups", ids), ("poses", p)):
        if values.shape != y.shape:
            raise ValueError(f"need one of {name} for each of {len(y)} touches, got shape {values.shape}")
    numbered_objects(y, ids)  # raises for an object with two labels
    return TouchBatch(p[None], z[None]), y
