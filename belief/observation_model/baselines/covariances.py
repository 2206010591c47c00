"""Shrinkage estimates of the means and covariances of touches by shape, for shapes with few or no touches."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from belief.observation_model.calibration_data import LabelledTouches
from belief.problem import Floats

MEAN_POOLING = 30.0
"""Weight of a shape's mean over all poses in its mean in each pose, in touches."""
_SMALLEST_VARIANCE = 1e-12  # in units of the embedding


def pose_means(vectors: Floats, data: LabelledTouches, pooling: float = MEAN_POOLING) -> tuple[Floats, Floats]:
    """Mean vector of each shape in each pose, ``(P, K, D)``, and the residuals of the touches, ``(n, D)``.

    Each mean is shrunk towards the shape's mean over all poses. A shape without touches gets the mean of all touches.

    >>> from belief import Touch
    >>> data = LabelledTouches.of([Touch(pose, np.zeros(2)) for pose in (0, 0, 1)], [0, 0, 0], None)
    >>> means, rest = pose_means(np.array([[1.0], [1.0], [4.0]]), data, pooling=1.0)
    >>> means[:, 0].round(2).tolist(), rest.round(2).tolist()                # 2 is the mean over both poses
    ([[1.33], [3.0]], [[-0.33], [-0.33], [1.0]])
    """
    sums = np.zeros((data.num_poses, data.num_shapes, vectors.shape[1]))
    counts = np.zeros((data.num_poses, data.num_shapes, 1))
    np.add.at(sums, (data.poses, data.shapes), vectors)
    np.add.at(counts, (data.poses, data.shapes), 1.0)
    seen = counts.sum(axis=0)
    overall = np.where(seen > 0.0, sums.sum(axis=0) / np.maximum(seen, 1.0), vectors.mean(axis=0))
    means = (sums + pooling * overall) / (counts + pooling)
    return means, vectors - means[data.poses, data.shapes]


def scatter_of_shapes(rest: Floats, data: LabelledTouches) -> Floats:
    """Sums of squares of ``rest (n, D)`` over the touches of each shape, ``(K, D, D)``.

    >>> from belief import Touch
    >>> data = LabelledTouches.of([Touch(0, np.zeros(2))] * 3, [0, 1, 1], None)
    >>> scatter_of_shapes(np.array([[1.0], [2.0], [-1.0]]), data).ravel().tolist()
    [1.0, 5.0]
    """
    of_shapes = (rest[data.shapes == k] for k in range(data.num_shapes))
    return np.stack([some.T @ some for some in of_shapes])


def pooled(sums: Floats, numbers: ArrayLike, pooling: float) -> Floats:
    """Covariances ``(K, D, D)`` from sums of squares, each shrunk towards the covariance of all shapes together.

    Args:
        sums: sums of squares, ``(K, D, D)``.
        numbers: number of terms of each sum, ``(K,)``, ≥ 0.
        pooling: weight of the common covariance, in terms, ≥ 0; with ``inf`` all shapes get it.

    Raises:
        ValueError: ``pooling`` is negative or NaN.

    >>> sums, numbers = np.array([[[40.0]], [[20.0]]]), [10, 10]
    >>> [pooled(sums, numbers, pooling).ravel().tolist() for pooling in (0.0, 10.0, np.inf)]
    [[4.0, 2.0], [3.5, 2.5], [3.0, 3.0]]
    """
    if not pooling >= 0.0:
        raise ValueError(f"pooling must be ≥ 0, got {pooling}")
    number = np.asarray(numbers, np.float64)[:, None, None]
    common = sums.sum(axis=0) / max(number.sum(), 1.0)
    if np.isinf(pooling):
        return np.broadcast_to(common, sums.shape).copy()
    weight = np.where(number > 0.0, pooling, 1.0)  # a shape without touches gets the common covariance
    return np.asarray((sums + weight * common) / (number + weight))


def positive_definite(covariances: Floats) -> Floats:
    """Covariances ``(K, D, D)`` with eigenvalues raised to at least 1e-6 of the largest.

    >>> positive_definite(np.diag([4.0, 0.0])[None]).tolist()
    [[[4.0, 0.0], [0.0, 4e-06]]]
    """
    values, basis = np.linalg.eigh((covariances + np.swapaxes(covariances, 1, 2)) / 2)
    values = np.maximum(values, np.maximum(1e-6 * values[:, -1:], _SMALLEST_VARIANCE))
    return np.asarray((basis * values[:, None]) @ np.swapaxes(basis, 1, 2))


def whitened(vectors: Floats, bases: Floats) -> Floats:
    """Vectors ``(..., D)`` in the basis of each shape, ``(..., K, D)``, for bases ``(K, D, D)``.

    >>> whitened(np.array([1.0, 2.0]), np.stack([np.eye(2), np.diag([2.0, 0.5])])).tolist()
    [[1.0, 2.0], [2.0, 1.0]]
    """
    flat = bases.reshape(-1, bases.shape[2])
    return (vectors @ flat.T).reshape(*vectors.shape[:-1], *bases.shape[:2])


def squares_within(scatter: Floats, bases: Floats) -> Floats:
    """Traces of sums of squares ``(S, D, D)`` in the basis of each shape, ``(S, K)``, for bases ``(K, D, D)``.

    >>> squares_within(np.diag([1.0, 2.0])[None], np.stack([np.eye(2), np.diag([2.0, 0.0])])).tolist()
    [[3.0, 4.0]]
    """
    precision = np.swapaxes(bases, 1, 2) @ bases
    return np.asarray(scatter.reshape(len(scatter), -1) @ precision.reshape(len(bases), -1).T)


def require_means(means: Floats, num_shapes: int, num_components: int) -> None:
    """Raise ValueError unless means are finite and ``(P, K, D)`` for the given K and D.

    >>> require_means(np.zeros((1, 2, 3)), num_shapes=2, num_components=4)
    Traceback (most recent call last):
    ...
    ValueError: means must be (P, 2, 4), got (1, 2, 3)
    """
    if means.ndim != 3 or means.shape[1:] != (num_shapes, num_components) or len(means) == 0:
        raise ValueError(f"means must be (P, {num_shapes}, {num_components}), got {means.shape}")
    if not np.isfinite(means).all():
        raise ValueError("means must be finite")


def require_covariances(name: str, covariances: Floats, means: Floats, *, definite: bool) -> None:
    """Check that covariances are valid and ``(K, D, D)``, one for each shape of ``means (P, K, D)``.

    Raises:
        ValueError: wrong shape, NaN, not symmetric, or an eigenvalue below zero (not above zero, if ``definite``).

    >>> require_covariances("own", np.zeros((2, 1, 1)), means=np.zeros((1, 2, 1)), definite=True)
    Traceback (most recent call last):
    ...
    ValueError: own must be positive definite, the least eigenvalue of each is [0. 0.]
    """
    size = means.shape[2]
    if covariances.shape != (means.shape[1], size, size) or not np.isfinite(covariances).all():
        raise ValueError(f"{name} must be finite and of shape {(means.shape[1], size, size)}, got {covariances.shape}")
    scale = np.abs(covariances).max(axis=(1, 2))
    if (np.abs(covariances - np.swapaxes(covariances, 1, 2)).max(axis=(1, 2)) > 1e-9 * scale).any():
        raise ValueError(f"{name} must be symmetric")
    least = np.linalg.eigvalsh(covariances)[:, 0]
    if not (least > 0.0 if definite else least >= -1e-9 * scale).all():
        kind = "definite" if definite else "semidefinite"
        raise ValueError(f"{name} must be positive {kind}, the least eigenvalue of each is {least}")
