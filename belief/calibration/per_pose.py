"""One calibration per pose, shrunk towards a common one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.calibration.affine import CALIBRATIONS, StructuredMatrixScaling
from belief.calibration.base import Calibration, no_probs
from belief.constraints import CountOrNone, NotNegative, check
from belief.validation import Floats, checked_indices, finite_logits, labelled_logits, pose_count, warn_of_one_shape


@dataclass(frozen=True, eq=False)
class PerPose:
    """One calibration per pose, shrunk towards the calibration of all poses together.

    For a pose with n touches, log p = w log p_pose + (1 - w) log p_pooled up to a constant, with w = n / (n + pooling).
    For temperature scaling this averages 1/T.

    Attributes:
        kind: the unfitted calibration.
        pooling: weight of the pooled calibration, in touches, ≥ 0.
        fitted: calibrations of all touches together, and of those of each pose; none before the fit.
        num_touches: number of touches in each of P poses.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> labels, poses = rng.integers(2, size=8000), rng.integers(2, size=8000)
        >>> logits = np.eye(2)[labels] * 4.0 + rng.normal(size=(8000, 2)) * np.array([1.0, 4.0])[poses, None]
        >>> calibration = PerPose().fit(logits, labels, poses)
        >>> np.exp(calibration.predict_log_proba([[4.0, 0.0], [4.0, 0.0]], [0, 1])).round(2).tolist()
        [[1.0, 0.0], [0.74, 0.26]]
        >>> PerPose.from_fields(calibration.to_fields()).to_fields() == calibration.to_fields()
        True
    """

    kind: Calibration = field(default=StructuredMatrixScaling())
    pooling: NotNegative = 100.0
    fitted: tuple[Calibration, ...] = ()
    num_touches: tuple[CountOrNone, ...] = ()

    def __post_init__(self) -> None:
        check(self)
        sizes = {calibration.num_shapes for calibration in self.fitted}
        if len(self.fitted) - bool(self.fitted) != len(self.num_touches) or len(sizes) > 1:
            raise ValueError(
                f"need a calibration of all touches and of each of {len(self.num_touches)} poses, for as many shapes, "
                f"got {len(self.fitted)} for {sizes} shapes"
            )

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
        warn_of_one_shape(y, z.shape[1])
        p = checked_indices("poses", poses, np.iinfo(np.int64).max)
        if p.shape != y.shape:
            raise ValueError(f"need a pose for each of {len(y)} rows, got {p.shape}")
        return self.fit_logits(z, y, p, pose_count(p, num_poses))

    def fit_logits(self, z: Floats, y: NDArray[np.int64], poses: NDArray[np.int64], num_poses: int) -> PerPose:
        """:meth:`fit` of checked arrays, without a warning; labels may be all the same, as in a part of the data."""
        masks = [poses == pose for pose in range(num_poses)]
        pooled = self.kind.fit_logits(z, y)
        own = (self.kind.fit_logits(z[mask], y[mask]) if mask.any() else pooled for mask in masks)
        return replace(self, fitted=(pooled, *own), num_touches=tuple(int(mask.sum()) for mask in masks))

    def predict_log_proba(self, logits: ArrayLike, poses: ArrayLike) -> Floats:
        """Calibrated log probabilities, ``(n, K)``, of logits ``(n, K)`` in poses ``(n,)``.

        Raises:
            ValueError: not fitted, invalid logits, or poses out of range.
        """
        if not self.fitted:
            raise ValueError("there is no calibration yet: call fit first")
        z, p = finite_logits(no_probs(logits)), checked_indices("poses", poses, len(self.num_touches))
        if z.ndim != 2 or p.shape != z.shape[:1]:
            raise ValueError(f"need logits (n, K) and a pose for each row, got {z.shape} and {p.shape}")
        log_probs = self.fitted[0].log_proba(z)
        with np.errstate(over="ignore", under="ignore"):
            for pose in np.unique(p).tolist():
                rows, n = p == pose, self.num_touches[pose]
                weight = n / (n + self.pooling) if n else 0.0
                own = self.fitted[1 + pose].log_proba(z[rows])
                log_probs[rows] = weight * own + (1.0 - weight) * log_probs[rows]
            log_probs -= log_probs.max(axis=1, keepdims=True)
            np.maximum(log_probs, -np.finfo(float).max, out=log_probs)
            log_probs -= np.log(np.exp(log_probs).sum(axis=1, keepdims=True))
        return log_probs

    def to_fields(self) -> dict[str, Any]:
        """All parameters, as JSON types, exact to the last bit."""
        return {
            "kind": self.kind.name,
            "unfitted": self.kind.to_fields(),
            "pooling": self.pooling,
            "fitted": [calibration.to_fields() for calibration in self.fitted],
            "num_touches": list(self.num_touches),
        }

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> PerPose:
        """The calibration of fields from :meth:`to_fields`; KeyError or ValueError for fields that are none."""
        kind = CALIBRATIONS[fields["kind"]]
        fitted = tuple(kind.from_fields(one) for one in fields["fitted"])
        return cls(kind.from_fields(fields["unfitted"]), float(fields["pooling"]), fitted, tuple(fields["num_touches"]))
