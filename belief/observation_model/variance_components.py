"""Expectation maximisation for variance components: by object, by object and pose, and by touch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from belief.observation_model.calibration_data import LabelledTouches
from belief.validation import Floats


class Components(NamedTuple):
    """Covariances that all shapes share, each ``(D, D)``.

    Attributes:
        of_object: B, of the effect that all touches of an object share.
        of_pose: V, of the effect that touches of an object in one pose share.
        of_touch: W, of single touches; positive definite.
    """

    of_object: Floats
    of_pose: Floats
    of_touch: Floats


def estimate_components(rest: Floats, data: LabelledTouches, *, has_repeats: bool, num_rounds: int = 300) -> Components:
    """Maximum-likelihood estimate of the components.

    Args:
        rest: touches minus the mean of their shape and pose, ``(n, D)``.
        data: labels of these touches.
        has_repeats: whether some object was touched twice in a pose; if not, V and W are kept equal.
        num_rounds: largest number of iterations.
    """
    total, cells = covariance(rest), _Cells.of(rest, data)
    # Without a floor, W would vanish for equal touches, and the likelihood would be unbounded.
    floor = 1e-6 * np.trace(total) / len(total) * np.eye(len(total))
    parts = np.stack([total / 3.0] * 3)
    for _ in range(num_rounds):
        updated = cells.expected_squares(parts)
        updated = (updated + np.swapaxes(updated, 1, 2)) / 2
        if not has_repeats:
            updated[1:] = updated[1:].mean(axis=0)
        updated[2] += floor
        done = np.abs(updated - parts).max() <= 1e-6 * np.abs(parts).max()
        parts = updated
        if done:
            break
    values, basis = np.linalg.eigh(parts[:2])  # rounding may leave eigenvalues slightly below zero
    shared = (basis * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(basis, -1, -2)
    return Components(shared[0], shared[1], parts[2])


def covariance(rest: Floats) -> Floats:
    """Covariance ``(D, D)`` of vectors of mean zero, ``(n, D)``, with eigenvalues at least 1e-6 of the largest."""
    values, basis = np.linalg.eigh(rest.T @ rest / len(rest))
    values = np.maximum(values, max(1e-6 * values[-1], 1e-12))
    return np.asarray((basis * values) @ basis.T)


class _Cells(NamedTuple):
    """Sufficient statistics; a *cell* is an object in a pose, a *level* the number of touches of a cell.

    The posterior covariance of an object's effect depends only on how many of its cells are on each level, its
    *pattern*, and few patterns occur.

    Attributes:
        levels: numbers of touches that occur, ``(L,)``.
        level: level of each cell, ``(C,)``.
        means: of the touches of each cell, ``(C, D)``.
        objects: object of each cell, ``(C,)``.
        patterns: patterns that occur, ``(U, L)``.
        pattern: pattern of each object, ``(N,)``.
        scatter: sum of squares of the touches about the means of their cells, ``(D, D)``.
    """

    levels: Floats
    level: NDArray[np.intp]
    means: Floats
    objects: NDArray[np.int64]
    patterns: Floats
    pattern: NDArray[np.intp]
    scatter: Floats

    @classmethod
    def of(cls, rest: Floats, data: LabelledTouches) -> _Cells:
        keys, cell, counts = np.unique(
            data.objects * data.num_poses + data.poses, return_inverse=True, return_counts=True
        )
        means = np.zeros((len(keys), rest.shape[1]))
        np.add.at(means, cell, rest)
        means /= counts[:, None]
        levels, level = np.unique(counts, return_inverse=True)
        objects, about = keys // data.num_poses, rest - means[cell]
        of_objects = np.zeros((data.num_objects, len(levels)))
        np.add.at(of_objects, (objects, level), 1.0)
        patterns, pattern = np.unique(of_objects, axis=0, return_inverse=True)
        return cls(levels, level, means, objects, patterns, pattern.ravel(), about.T @ about)

    def expected_squares(self, parts: Floats) -> Floats:
        """Mean squares of the effects u, v and e, given the touches and their covariances, all ``(3, D, D)``."""
        shared_object, shared_pose, own = parts
        identity, num_objects = np.eye(len(own)), np.bincount(self.pattern, minlength=len(self.patterns))
        number = np.bincount(self.level)  # of cells on each level
        precision = np.linalg.inv(shared_pose + own / self.levels[:, None, None])  # of a cell's mean, given u
        # Posterior of u: precision B⁻¹ + ∑ C⁻¹, written without B⁻¹ because B may vanish.
        inner = identity + shared_object @ np.einsum("ul,lde->ude", self.patterns, precision)
        spread = np.linalg.solve(inner, np.broadcast_to(shared_object, inner.shape))  # (U, D, D)
        spread = (spread + np.swapaxes(spread, 1, 2)) / 2
        pull = np.zeros((len(self.pattern), len(own)))
        np.add.at(pull, self.objects, (precision[self.level] @ self.means[..., None])[..., 0])
        mean = (spread[self.pattern] @ pull[..., None])[..., 0]  # (N, D)
        # Expected squares of a cell's mean less u, summed over the cells of a level; then of v and e, given those.
        left = self.means - mean[self.objects]
        away = np.stack([left[self.level == i].T @ left[self.level == i] for i in range(len(self.levels))])
        away += np.einsum("u,ul,ude->lde", num_objects, self.patterns, spread)
        gain = shared_pose @ precision  # from that mean, less u, to v
        rest, about = identity - gain, number[:, None, None] * (shared_pose - gain @ shared_pose)
        of_mean = rest @ away @ np.swapaxes(rest, 1, 2) + about
        sum_u = mean.T @ mean + np.einsum("u,ude->de", num_objects, spread)
        sum_v = (gain @ away @ np.swapaxes(gain, 1, 2) + about).sum(axis=0)
        sum_e = self.scatter + np.einsum("l,lde->de", self.levels, of_mean)
        return np.stack([sum_u / len(mean), sum_v / number.sum(), sum_e / (self.levels @ number)])
