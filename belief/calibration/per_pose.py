"""One calibration per pose, shrunk towards a common one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.calibration.affine import StructuredMatrixScaling
from belief.calibration.base import Calibration, no_probs
from belief.calibration.table import CALIBRATIONS
from belief.validation import Floats, checked_indices, finite_logits, labelled_logits, pose_count, unmasked


@dataclass(frozen=True, eq=False)
class PerPose:
    """One calibration per pose, shrunk towards the calibration of all poses together.

    For a pose with n touches, log p = w log p_pose + (1 - w) log p_pooled up to a constant, with w = n / (n + pooling).
    For temperature scaling this averages 1/T.

    Attributes:
        kind: the unfitted calibration.
        pooling: weight of the pooled calibration, in touches, ≥ 0.
        pooled: fitted to all touches.
        by_pose: fitted to the touches of each pose, P of them; the pooled one for poses without touches.
        num_touches: number of touches in each pose.

    Raises:
        ValueError: ``pooling`` is negative or not finite.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> labels, poses = rng.integers(2, size=8000), rng.integers(2, size=8000)
        >>> logits = np.eye(2)[labels] * 4.0 + rng.normal(size=(8000, 2)) * np.array([1.0, 4.0])[poses, None]
        >>> calibration = PerPose().fit(logits, labels, poses)
        >>> np.exp(calibration.predict_log_proba([[4.0, 0.0], [4.0, 0.0]], [0, 1])).round(2).tolist()
        [[1.0, 0.0], [0.74, 0.26]]
    """

    kind: Calibration = field(default=StructuredMatrixScaling())
    pooling: float = 100.0
    pooled: Calibration | None = None
    by_pose: tuple[Calibration, ...] = ()
    num_touches: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.pooling < np.inf:
            raise ValueError(f"pooling must be finite and ≥ 0, got {self.pooling}")
        if len(self.by_pose) != len(self.num_touches) or (self.pooled is None) != (not self.by_pose):
            raise ValueError("a fitted one needs a pooled calibration, one for every pose, and numbers of touches")
        if len({calibration.num_shapes for calibration in self.by_pose} - {self.num_shapes}) > 0:
            raise ValueError(f"poses have calibrations for other numbers of shapes than {self.num_shapes}")
        if not all(isinstance(n, int) and n >= 0 for n in self.num_touches):
            raise ValueError(f"numbers of touches must be integers ≥ 0, got {self.num_touches}")

    def fit(self, logits: ArrayLike, labels: ArrayLike, poses: ArrayLike, num_poses: int | None = None) -> PerPose:
        """The calibration fitted to all touches together and to those of each pose.

        Args:
            logits: ``(n, K)``.
            labels: true shape indices, ``(n,)``.
            poses: pose indices, ``(n,)``.
            num_poses: P; by default one more than the largest pose in the data.

        Raises:
            ValueError: invalid logits or labels, or poses out of range.
        """
        z, y = labelled_logits(no_probs(logits), labels)
        p = _poses(poses, len(y))
        size = pose_count(p, num_poses)
        pooled = self.kind.fit_logits(z, y)
        masks = [p == pose for pose in range(size)]
        own = tuple(self.kind.fit_logits(z[mask], y[mask]) if mask.any() else pooled for mask in masks)
        return replace(self, pooled=pooled, by_pose=own, num_touches=tuple(int(mask.sum()) for mask in masks))

    def predict_log_proba(self, logits: ArrayLike, poses: ArrayLike) -> Floats:
        """Calibrated log probabilities, ``(n, K)``, of logits ``(n, K)`` in poses ``(n,)``.

        Raises:
            ValueError: not fitted, invalid logits, or poses out of range.
        """
        return self._log_proba_of(no_probs(logits), poses)

    def _log_proba_of(self, logits: Floats, poses: ArrayLike) -> Floats:
        if self.pooled is None:
            raise ValueError("there is no calibration yet: call fit first")
        z = finite_logits(logits)
        if z.ndim != 2:
            raise ValueError(f"need logits (n, K), got {z.shape}")
        p = checked_indices("poses", _poses(poses, len(z)), len(self.by_pose))
        log_probs = self.pooled.log_proba_of(z)
        with np.errstate(over="ignore", under="ignore"):
            for pose in np.unique(p).tolist():
                rows, n = p == pose, self.num_touches[pose]
                weight = n / (n + self.pooling) if n else 0.0
                own = self.by_pose[pose].log_proba_of(z[rows])
                log_probs[rows] = weight * own + (1.0 - weight) * log_probs[rows]
            log_probs -= log_probs.max(axis=1, keepdims=True)
            np.maximum(log_probs, -np.finfo(float).max, out=log_probs)
            log_probs -= np.log(np.exp(log_probs).sum(axis=1, keepdims=True))
        return log_probs

    def predict_proba(self, logits: ArrayLike, poses: ArrayLike) -> Floats:
        """Calibrated probabilities, ``(n, K)``; raises as :meth:`predict_log_proba`."""
        with np.errstate(under="ignore"):
            return np.exp(self._log_proba_of(no_probs(logits), poses))

    def to_fields(self) -> dict[str, Any]:
        """All parameters, as JSON types, exact to the last bit."""
        fitted = [] if self.pooled is None else [self.pooled, *self.by_pose]
        return {
            "kind": self.kind.name,
            "unfitted": self.kind.to_fields(),
            "pooling": self.pooling,
            "fitted": [calibration.to_fields() for calibration in fitted],
            "num_touches": list(self.num_touches),
        }

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> PerPose:
        """The calibration of fields from :meth:`to_fields`.

        Raises:
            KeyError: a field is missing, or there is no such kind of calibration.
            ValueError: parameters that are out of range or do not fit each other.

        >>> calibration = PerPose().fit(4.0 * np.eye(2), [0, 1], [0, 0])
        >>> PerPose.from_fields(calibration.to_fields()).to_fields() == calibration.to_fields()
        True
        """
        kind = CALIBRATIONS[fields["kind"]]
        fitted = [kind.from_fields(one) for one in fields["fitted"]]
        pooled, by_pose = (fitted[0], tuple(fitted[1:])) if fitted else (None, ())
        unfitted, pooling = kind.from_fields(fields["unfitted"]), float(fields["pooling"])
        return cls(unfitted, pooling, pooled, by_pose, tuple(fields["num_touches"]))

    @property
    def num_shapes(self) -> int | None:
        """K; None if it is valid for any number."""
        return None if self.pooled is None else self.pooled.num_shapes


def _poses(poses: ArrayLike, num_rows: int) -> NDArray[np.integer]:
    """Poses as an array with an integer for each row."""
    p = unmasked(poses, "poses")
    if p.shape != (num_rows,) or not np.issubdtype(p.dtype, np.integer):
        raise ValueError(f"need an integer pose for each of {num_rows} rows, got {p.dtype} {p.shape}")
    return p
