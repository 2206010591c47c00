"""Beta calibration for several shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from belief.calibration.affine import AffineCalibration, structured_penalty
from belief.problem import Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class BetaCalibration(AffineCalibration):
    """Two scales and a bias for each shape: score_k = a_k ln p_k - b_k ln(1 - p_k) + c_k, then the softmax.

    The scores are those of beta calibration of two classes (Kull et al. 2017, "Beta calibration: a well-founded and
    easily implemented improvement on logistic calibration for binary classifiers"). Unlike vector scaling, it can
    correct probabilities near one and near zero by different amounts. The ridge penalties are those of
    :class:`VectorScaling`, and ``second · (K / n) · Σ b_k²``; p are probabilities after temperature scaling.

    Attributes:
        diagonal_strength: of the penalty on a - 1, > 0.
        second_strength: of the penalty on b, > 0.
        bias_strength: of the penalty on c, > 0.

    Too sure where it is sure, and not sure enough where it is not:

    >>> rng = np.random.default_rng(0)
    >>> labels = rng.integers(3, size=4000)
    >>> logits = 3.0 * np.eye(3)[labels] + 2.0 * rng.normal(size=(4000, 3))
    >>> logits *= np.where(np.ptp(logits, axis=1) > 4.0, 3.0, 1.0)[:, None]
    >>> from belief.calibration import VectorScaling
    >>> losses = [kind().fit(logits, labels).objective(logits, labels)[0] for kind in (VectorScaling, BetaCalibration)]
    >>> losses[1] < losses[0] - 0.01
    True
    """

    name: ClassVar[str] = "beta"
    inputs_per_shape: ClassVar[int] = 2

    diagonal_strength: float = 0.25
    second_strength: float = 0.25
    bias_strength: float = 0.25

    def inputs(self, log_probs: Floats) -> Floats:
        """See :meth:`AffineCalibration.inputs`: ln p, then -ln(1 - p), which the spread probability keeps finite."""
        rest = -np.expm1(log_probs) if log_probs.shape[-1] > 1 else np.ones_like(log_probs)
        return np.concatenate([log_probs, -np.log(np.maximum(rest, np.finfo(float).tiny))], axis=-1)

    def penalty(self, num_rows: int, num_shapes: int) -> Floats:
        """See :meth:`AffineCalibration.penalty`; both blocks of W are diagonal."""
        unit = num_shapes / num_rows
        first = structured_penalty(num_shapes, self.diagonal_strength * unit, np.inf, self.bias_strength * unit)
        second = structured_penalty(num_shapes, self.second_strength * unit, np.inf, np.inf)[:, :-1]
        return np.concatenate([first[:, :-1], second, first[:, -1:]], axis=1)
