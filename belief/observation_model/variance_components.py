"""Expectation maximisation for what touches share: with their object, with their object and pose, with none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from belief.observation_model.gaussian import pooled
from belief.problem import Floats


class Components(NamedTuple):
    """Covariances, each ``(K, D, D)``.

    Attributes:
        of_object: B, of what all touches of an object share.
        of_pose: V, of what an object's touches in one pose share beyond that.
        of_touch: W, of the rest; positive definite.
    """

    of_object: Floats
    of_pose: Floats
    of_touch: Floats


def estimate_components(
    rest: Floats,
    shapes: NDArray[np.int64],
    objects: NDArray[np.int64],
    poses: NDArray[np.int64],
    total: Floats,
    pooling: float,
    *,
    has_repeats: bool,
    num_rounds: int = 60,
) -> Components:
    """Penalised maximum likelihood of the components.

    Args:
        rest: touches less the mean of their shape and pose, ``(n, D)``.
        shapes: of each touch, ``(n,)``.
        objects: of each touch, ``(n,)``, from 0 without gaps.
        poses: of each touch, ``(n,)``.
        total: covariance of ``rest`` for each shape, ``(K, D, D)``, from which the search starts, a third each.
        pooling: weight of what all shapes have in common, see :func:`pooled`.
        has_repeats: whether some object was touched twice in a pose; if not, V and W stay equal.
        num_rounds: of expectation maximisation.
    """
    num_poses, num_objects, size = int(poses.max()) + 1, int(objects.max()) + 1, rest.shape[1]
    counts = np.zeros((num_objects, num_poses))
    np.add.at(counts, (objects, poses), 1.0)
    means = np.zeros((num_objects, num_poses, size))
    np.add.at(means, (objects, poses), rest)
    means /= np.maximum(counts, 1.0)[..., None]
    spread = rest - means[objects, poses]
    shape_of = np.zeros(num_objects, np.int64)
    shape_of[objects] = shapes
    members = [np.flatnonzero(shape_of == k) for k in range(len(total))]
    scatter = [spread[shapes == k].T @ spread[shapes == k] for k in range(len(total))]
    parts = np.stack([total / 3.0] * 3)  # (3, K, D, D)
    for _ in range(num_rounds):
        sums = np.zeros_like(parts)
        numbers = np.zeros((3, len(total)))
        for k, rows in enumerate(members):
            if rows.size:
                sums[:, k], numbers[:, k] = _expect(counts[rows], means[rows], parts[:, k])
                sums[2, k] += scatter[k]
        updated = np.stack([pooled(sums[i], numbers[i], pooling) for i in range(3)])
        if not has_repeats:
            updated[1:] = updated[1:].mean(axis=0)
        done = np.abs(updated - parts).max() <= 1e-6 * np.abs(parts).max()
        parts = updated
        if done:
            break
    floor = 1e-6 * np.trace(total, axis1=1, axis2=2)[:, None, None] / size * np.eye(size)
    return Components(parts[0], parts[1], parts[2] + floor)


def _expect(counts: Floats, means: Floats, parts: Floats) -> tuple[Floats, Floats]:
    """Expected sums of squares of u, v and e over the objects of one shape, ``(3, D, D)``, and how many each has."""
    shared_object, shared_pose, own = parts
    seen = counts > 0.0
    identity = np.eye(len(own))
    levels, level = np.unique(counts, return_inverse=True)  # few numbers of touches occur, whatever the objects
    level = level.reshape(counts.shape)
    gains = np.stack([shared_pose @ np.linalg.inv(shared_pose + own / n) if n else 0.0 * own for n in levels])
    precisions = np.stack([np.linalg.inv(shared_pose + own / n) if n else 0.0 * own for n in levels])
    precision = precisions[level]  # (S, P, D, D), zero where there is no touch
    # Posterior of u: precision B⁻¹ + ∑ C⁻¹, written without B⁻¹ because B may vanish.
    inner = identity + shared_object @ precision.sum(axis=1)
    spread_u = np.linalg.solve(inner, np.broadcast_to(shared_object, inner.shape))
    spread_u = (spread_u + np.swapaxes(spread_u, 1, 2)) / 2
    pull = np.einsum("spde,spe->sd", precision, means)
    mean_u = np.einsum("sde,se->sd", spread_u, pull)
    gain = gains[level]
    left = means - mean_u[:, None]
    mean_v = np.einsum("spde,spe->spd", gain, left)
    error = (left - mean_v)[seen]
    of_v = np.einsum("spde,sef,spgf->spdg", gain, spread_u, gain) + shared_pose - gain @ shared_pose
    away = identity - gain
    of_e = np.einsum("spde,sef,spgf->spdg", away, spread_u, away) + shared_pose - gain @ shared_pose
    sum_u = mean_u.T @ mean_u + spread_u.sum(axis=0)
    sum_v = mean_v[seen].T @ mean_v[seen] + of_v[seen].sum(axis=0)
    weight = counts[seen]
    sum_e = (weight[:, None] * error).T @ error + (weight[:, None, None] * of_e[seen]).sum(axis=0)
    return np.stack([sum_u, sum_v, sum_e]), np.array([len(counts), seen.sum(), counts.sum()], float)
