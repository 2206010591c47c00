"""Fit of the correlations between poses to sequences of touches of known objects."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray
from scipy.special import log_softmax, softmax

from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.repeat_discount import ASSUMED_CORRELATION
from belief.validation import Floats

Integers: TypeAlias = NDArray[np.int64]

_ORDERS = 4  # random orders of the poses of an object
_LONGEST = 12  # touches of a sequence
_MOST_VALUES = 4_000_000  # logits of all sequences together


def numbered_sessions(objects: Integers, poses: Integers) -> Integers:
    """Running number of each touch among those of its object and pose, ``(n,)``."""
    numbers = np.zeros(len(objects), np.int64)
    seen: dict[tuple[int, int], int] = {}
    for row, key in enumerate(zip(objects.tolist(), poses.tolist(), strict=True)):
        numbers[row] = seen.get(key, 0)
        seen[key] = int(numbers[row]) + 1
    return numbers


def sequences(data: LabelledTouches, sessions: Integers | None, rng: np.random.Generator) -> Integers:
    """Rows of random sequences of the touches of each object, as a search makes them, ``(S, n)``; -1 for padding.

    The n-th touch in a pose comes from the n-th session of the object, with the sessions in random order.

    Args:
        data: touches of known objects.
        sessions: of each touch, ``(n,)``; by default the touches of an object and pose are numbered.
        rng: draws the orders.
    """
    of_touch = numbered_sessions(data.objects, data.poses) if sessions is None else sessions
    found: list[Integers] = []
    for number in range(data.num_objects):
        rows = np.flatnonzero(data.objects == number)
        for _ in range(_ORDERS):
            places = rng.permutation(np.unique(of_touch[rows]))
            turn = {int(session): place for place, session in enumerate(places.tolist())}
            turns = np.array([turn[int(session)] for session in of_touch[rows]])
            key = np.empty(len(rows))
            for pose in np.unique(data.poses[rows]).tolist():
                here = np.flatnonzero(data.poses[rows] == pose)
                here = here[np.argsort(turns[here], kind="stable")]
                key[here] = np.sort(rng.random(len(here)))
            found.append(rows[np.argsort(key)][:_LONGEST])
    keep = max(1, _MOST_VALUES // (_LONGEST * data.num_shapes))
    if len(found) > keep:
        found = [found[i] for i in np.sort(rng.choice(len(found), keep, replace=False))]
    padded = np.full((len(found), max(map(len, found))), -1)
    for place, row in enumerate(found):
        padded[place, : len(row)] = row
    return padded


def sequence_losses(logits: Floats, poses: Integers, shapes: Integers, rows: Integers, kernel: Floats) -> Floats:
    """Negative log posterior of the true shape after each touch of every sequence, ``(S, n)``; NaN for padding.

    Args:
        logits: log likelihood ratios of all touches, ``(n, K)``.
        poses: of all touches, ``(n,)``.
        shapes: true shape of each, ``(n,)``.
        rows: of the touches of each sequence, ``(S, n)``; -1 for padding.
        kernel: correlations between poses, ``(P, P)``.
    """
    inside = rows >= 0
    correlation = kernel[poses[rows][:, :, None], poses[rows][:, None, :]] * inside[:, :, None] * inside[:, None, :]
    steps = np.arange(rows.shape[1])
    correlation[:, steps, steps] = 1.0
    totals = correlation.cumsum(axis=2)  # (S, touch, number of touches so far)
    weights = np.tril((inside[:, :, None] / np.maximum(totals, 1.0)).swapaxes(1, 2))
    log_posterior = log_softmax(weights @ logits[rows], axis=2)
    truth = np.broadcast_to(shapes[rows[:, :1], None], (*rows.shape, 1))
    return np.where(inside, -np.take_along_axis(log_posterior, truth, axis=2)[:, :, 0], np.nan)


def fused_loss(data: LabelledTouches, kernel: Floats, sessions: Integers | None = None) -> float:
    """Mean negative log posterior of sequences of touches [nats], the loss of :func:`fit_kernel`.

    Args:
        data: touches with log likelihood ratios as logits.
        kernel: correlations between poses, ``(P, P)``.
        sessions: of each touch, ``(n,)``.
    """
    rows = sequences(data, sessions, np.random.default_rng(0))
    return float(np.nanmean(sequence_losses(data.logits, data.poses, data.shapes, rows, kernel)))


def likeness(data: LabelledTouches, sessions: Integers | None = None) -> Floats:
    """How alike the errors of two poses are, ``(P, P)``, in [0, 1].

    An error is the posterior minus the true shape. The likeness is the cosine of the errors of two touches of one
    object in one session, and 1 on the diagonal.
    """
    errors = softmax(data.logits, axis=1)
    errors[np.arange(len(errors)), data.shapes] -= 1.0
    of_touch = numbered_sessions(data.objects, data.poses) if sessions is None else sessions
    _, group = np.unique(np.stack([data.objects, of_touch]), axis=1, return_inverse=True)
    size = data.num_poses
    table = np.zeros((int(group.max()) + 1, size, data.num_shapes))
    table[group.ravel(), data.poses] = errors
    norms = (table**2).sum(axis=2)
    both = np.einsum("gpk,gqk->pq", table, table)
    is_there = (norms > 0.0).astype(np.float64)
    scale = np.sqrt((norms.T @ is_there) * (is_there.T @ norms))
    found = np.clip(both / np.maximum(scale, np.finfo(float).tiny), 0.0, 1.0)
    np.fill_diagonal(found, 1.0)
    return np.asarray((found + found.T) / 2)


def fit_kernel(data: LabelledTouches, law: str, sessions: Integers | None = None) -> Floats:
    """The kernel ``(P, P)`` of a law that minimises the mean negative log posterior of sequences.

    κ of two touches is c for touches in one pose (law ``repeats``), plus a for all pairs (``flat``), plus b times the
    likeness of their poses (``kernel``), with a, b, c ≥ 0. So a repeat is never less correlated than touches in two
    poses. Where no pose was repeated, c is as large as makes κ of repeats at least 0.5.

    Args:
        data: touches with log likelihood ratios as logits, of a calibration that was not fitted to them: otherwise the
            correlations come out too small.
        law: ``none``, ``repeats``, ``flat`` or ``kernel``.
        sessions: of each touch, ``(n,)``.
    """
    size = data.num_poses
    if law == "none":
        return np.zeros((size, size))
    found = sequences(data, sessions, np.random.default_rng(0))
    poses = np.where(found >= 0, data.poses[found], -1)
    has_repeats = any((np.bincount(row[row >= 0], minlength=size) > 1).any() for row in poses)
    alike = likeness(data, sessions)

    terms = np.stack([np.eye(size), np.ones((size, size)), alike])[: {"repeats": 1, "flat": 2, "kernel": 3}[law]]

    def kernel(parameters: Floats) -> Floats:
        found = np.minimum(np.tensordot(parameters, terms, axes=1), 1.0)
        if not has_repeats:
            np.fill_diagonal(found, np.maximum(found.diagonal(), ASSUMED_CORRELATION))
        return np.asarray(found)

    def loss(parameters: Floats) -> float:
        losses = sequence_losses(data.logits, data.poses, data.shapes, found, kernel(parameters))
        return float(np.nanmean(losses))

    count = len(terms)
    starts = [np.full(count, 0.3), np.full(count, 0.02)]
    results = [
        scipy.optimize.minimize(loss, start, bounds=[(0.0, 0.999)] * count, method="L-BFGS-B", options={"maxiter": 25})
        for start in starts[: 2 if count > 1 else 1]
    ]
    return kernel(min(results, key=lambda result: result.fun).x)
