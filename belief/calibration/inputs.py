"""Validation of the inputs of calibrations: finite logits of any scale, and integer labels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.errors import InvalidArgument
from belief.problem import Floats
from belief.validation import as_logs, as_real, at, checked_indices, normalise_probs

_MOST_POSES = 1000  # or the number of touches, if that is larger


def pose_count(poses: NDArray[np.integer], num_poses: int | None) -> int:
    """P: as given, or one more than the largest of one or more poses.

    Raises:
        InvalidArgument: a pose that is not in [0, P), or a P above 1000 and above the number of touches, which would
            waste memory.

    >>> pose_count(np.array([0, 2]), None), pose_count(np.array([0, 2]), 6)
    (3, 6)
    >>> pose_count(np.array([0, 10**9]), None)
    Traceback (most recent call last):
    ...
    belief.errors.InvalidArgument: touch 1 has pose 1000000000, 2 touches are fitted in at most 1000 poses
    """
    largest, most = int(poses.max()), max(_MOST_POSES, poses.size)
    if num_poses is not None and not (isinstance(num_poses, int | np.integer) and 1 <= num_poses <= most):
        raise InvalidArgument(f"num_poses must be a whole number from 1 to {most}, got {num_poses!r}")
    if poses.min() < 0 or largest >= (most if num_poses is None else num_poses):
        touch = int(poses.argmin() if poses.min() < 0 else poses.argmax())
        known = f"{poses.size} touches are fitted in at most {most} poses"
        if num_poses is not None:
            known = f"num_poses is {num_poses}"
        raise InvalidArgument(f"touch {touch} has pose {poses[touch]}, {known}")
    return largest + 1 if num_poses is None else int(num_poses)


def given_logits(logits: ArrayLike | None, probs: ArrayLike | None) -> Floats:
    """Logits, or the logarithms of probabilities, of which those below the least normal float count as that.

    Raises:
        ValueError: both or none are given, or probabilities that are none; the message names their row.

    >>> given_logits(None, probs=[0.5, 0.5]).round(2).tolist()
    [-0.69, -0.69]
    """
    found = as_logs("logits", logits, "probs", None if probs is None else normalise_probs(probs), stacklevel=4)
    return found if probs is None else np.maximum(found, np.log(np.finfo(np.float64).tiny))


def given(name: str, values: ArrayLike | None) -> ArrayLike:
    """An argument that may follow an optional one; raises InvalidArgument for None.

    >>> given("labels", [0, 1])
    [0, 1]
    """
    if values is None:
        raise InvalidArgument(f"{name} must be given")
    return values


def finite_logits(logits: ArrayLike) -> Floats:
    """Logits as float64, ``(..., K)``.

    Raises:
        ValueError: they are empty, masked or not real numbers, or one is NaN or infinite; the message names its row.

    >>> finite_logits([[1, 2]])
    array([[1., 2.]])
    """
    with np.errstate(over="ignore"):  # a long double may become infinite, which is an error
        z = np.asarray(as_real(logits, "logits"), np.float64)
    if z.ndim == 0 or z.size == 0:
        raise ValueError(f"need logits (..., K), none of the axes empty; got shape {z.shape}")
    if not (np.isfinite(z.max()) and np.isfinite(z.min())):
        row = tuple(np.argwhere(~np.isfinite(z))[0, :-1].tolist())
        raise ValueError(f"logits{at(row)} are not finite: {z[row].tolist()}")
    return z


def labelled_logits(logits: ArrayLike, labels: ArrayLike) -> tuple[Floats, NDArray[np.int64]]:
    """Logits ``(n, K)`` and labels ``(n,)``, checked.

    Raises:
        ValueError: empty input, NaN or infinite logits, labels out of range, shapes that do not fit.

    >>> labelled_logits([[1.0, 2.0]], [1])
    (array([[1., 2.]]), array([1]))
    """
    shape, num_labels = np.shape(logits), np.shape(labels)
    if len(shape) != 2 or 0 in shape or num_labels != shape[:1]:
        raise ValueError(f"need logits (n, K) and labels (n,) with n ≥ 1, got {shape} and {num_labels}")
    return finite_logits(logits), checked_indices("labels", labels, shape[1])
