"""Expectation maximisation for variance components: by object, by object and pose, and by touch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from belief.observation_model.baselines.covariances import pooled
from belief.observation_model.calibration_data import LabelledTouches
from belief.problem import Floats


class Components(NamedTuple):
    """Covariances, each ``(K, D, D)``.

    Attributes:
        of_object: B, of the effect that all touches of an object share.
        of_pose: V, of the effect that touches of an object in one pose share.
        of_touch: W, of single touches; positive definite.
    """

    of_object: Floats
    of_pose: Floats
    of_touch: Floats


def estimate_components(
    rest: Floats,
    data: LabelledTouches,
    total: Floats,
    pooling: float,
    *,
    has_repeats: bool,
    num_rounds: int = 300,
) -> Components:
    """Maximum-likelihood estimate of the components, shrunk towards their means over shapes.

    Args:
        rest: touches minus the mean of their shape and pose, ``(n, D)``.
        data: labels of these touches.
        total: covariance of ``rest`` for each shape, ``(K, D, D)``; each component starts at a third of it.
        pooling: as for :func:`pooled`.
        has_repeats: whether some object was touched twice in a pose; if not, V and W are kept equal.
        num_rounds: largest number of iterations.

    >>> rng = np.random.default_rng(0)
    >>> from belief import Touch
    >>> ids = np.arange(6000) // 3                                       # three touches of each object in one pose
    >>> rest = 2.0 * rng.normal(size=(2000, 1))[ids] + rng.normal(size=(6000, 1))
    >>> data = LabelledTouches.of([Touch(0, np.zeros(2))] * 6000, np.zeros(6000, int), ids)
    >>> parts = estimate_components(rest, data, np.full((2, 1, 1), 5.0), pooling=np.inf, has_repeats=True)
    >>> shared = parts.of_object + parts.of_pose                         # not separable with a single pose
    >>> shared[0].round(1).tolist(), parts.of_touch[0].round(1).tolist()
    ([[4.1]], [[1.0]])
    """
    num_shapes, size = len(total), rest.shape[1]
    if np.isinf(pooling):  # the same covariances for all shapes
        statistics, total = [_statistics(rest, data, np.ones(data.num_objects, np.bool_))], total[:1]
    else:
        statistics = [_statistics(rest, data, data.shape_of_object == k) for k in range(num_shapes)]
    # Without a floor, W would vanish for equal touches, and the likelihood would be unbounded.
    floor = 1e-6 * np.trace(total, axis1=1, axis2=2)[:, None, None] / size * np.eye(size)
    parts = np.stack([total / 3.0] * 3)  # (3, K, D, D)
    for _ in range(num_rounds):
        sums, numbers = np.zeros_like(parts), np.zeros((3, len(total)))
        for k, of_shape in enumerate(statistics):
            if of_shape is not None:
                sums[:, k], numbers[:, k] = _expect(of_shape, parts[:, k])
        updated = np.stack([pooled(sums[i], numbers[i], pooling) for i in range(3)])
        updated = (updated + np.swapaxes(updated, 2, 3)) / 2
        if not has_repeats:
            updated[1:] = updated[1:].mean(axis=0)
        updated[2] += floor
        done = np.abs(updated - parts).max() <= 1e-6 * np.abs(parts).max()
        parts = updated
        if done:
            break
    values, basis = np.linalg.eigh(parts[:2])  # rounding may leave eigenvalues slightly below zero
    shared = (basis * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(basis, -1, -2)
    found = np.concatenate([shared, parts[2:]])
    return Components(*np.broadcast_to(found, (3, num_shapes, size, size)).copy())


class _Statistics(NamedTuple):
    """Sufficient statistics of N objects that share their covariances.

    A *level* is a number of touches in a pose. A *pattern* states how many poses of an object are on each level. The
    posterior covariance of an object's effect depends only on its pattern, and few patterns occur.

    Attributes:
        levels: numbers of touches that occur, ``(L,)``.
        patterns: patterns that occur, ``(U, L)``.
        pattern: index of each object's pattern, ``(N,)``.
        sums: sum of the means of an object's poses on each level, ``(N, L, D)``.
        squares: sums of squares of those means over all objects, ``(L, D, D)``.
        scatter: sum of squares of touches about the mean of their object and pose, ``(D, D)``.
    """

    levels: Floats
    patterns: Floats
    pattern: NDArray[np.intp]
    sums: Floats
    squares: Floats
    scatter: Floats


def _statistics(rest: Floats, data: LabelledTouches, members: NDArray[np.bool_]) -> _Statistics | None:
    """Statistics of the objects in a mask ``(N,)``; None if there are none."""
    if not members.any():
        return None
    counts = np.zeros((data.num_objects, data.num_poses))
    np.add.at(counts, (data.objects, data.poses), 1.0)
    means = np.zeros((*counts.shape, rest.shape[1]))
    np.add.at(means, (data.objects, data.poses), rest)
    means /= np.maximum(counts, 1.0)[..., None]
    about = (rest - means[data.objects, data.poses])[members[data.objects]]
    levels = np.unique(counts[members])
    levels = levels[levels > 0.0]
    at_level = (counts[members][:, None] == levels[:, None]).astype(np.float64)  # (N, L, P)
    patterns, pattern = np.unique(at_level.sum(axis=2), axis=0, return_inverse=True)
    on_level = at_level[..., None] * means[members][:, None]  # (N, L, P, D)
    return _Statistics(
        levels,
        patterns,
        pattern.ravel(),
        on_level.sum(axis=2),
        np.einsum("nlpd,nlpe->lde", on_level, on_level, optimize=True),
        about.T @ about,
    )


def _expect(of: _Statistics, parts: Floats) -> tuple[Floats, Floats]:
    """Expected sums of squares of u, v and e over these objects, ``(3, D, D)``, and their numbers of terms."""
    shared_object, shared_pose, own = parts
    identity = np.eye(len(own))
    precision = np.linalg.inv(shared_pose + own / of.levels[:, None, None])  # of a pose's mean, given u; (L, D, D)
    gain = shared_pose @ precision  # from that mean, less u, to v
    # Posterior of u: precision B⁻¹ + ∑ C⁻¹, written without B⁻¹ because B may vanish.
    inner = identity + shared_object @ np.einsum("ul,lde->ude", of.patterns, precision)
    spread = np.linalg.solve(inner, np.broadcast_to(shared_object, inner.shape))  # (U, D, D)
    spread = (spread + np.swapaxes(spread, 1, 2)) / 2
    pull = np.einsum("lde,nle->nd", precision, of.sums)
    mean = (spread[of.pattern] @ pull[..., None])[..., 0]  # (N, D)
    objects = np.bincount(of.pattern, minlength=len(of.patterns))
    poses = of.patterns[of.pattern]  # (N, L)
    # Expected squares of a pose's mean less u, summed over the poses on a level; then of v and e, given those.
    cross = np.einsum("nld,ne->lde", of.sums, mean)
    away = of.squares - cross - np.swapaxes(cross, 1, 2) + np.einsum("nl,nd,ne->lde", poses, mean, mean, optimize=True)
    away += np.einsum("u,ul,ude->lde", objects, of.patterns, spread)
    number = poses.sum(axis=0)
    left = number[:, None, None] * (shared_pose - gain @ shared_pose)
    rest = identity - gain
    sum_u = mean.T @ mean + np.einsum("u,ude->de", objects, spread)
    sum_v = (gain @ away @ np.swapaxes(gain, 1, 2) + left).sum(axis=0)
    of_mean = rest @ away @ np.swapaxes(rest, 1, 2) + left
    sum_e = of.scatter + np.einsum("l,lde->de", of.levels, of_mean)
    return np.stack([sum_u, sum_v, sum_e]), np.array([len(mean), number.sum(), of.levels @ number])
