"""Vector scaling: a scale and a bias for each shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from belief.calibration.affine import AffineCalibration, structured_penalty
from belief.problem import Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class VectorScaling(AffineCalibration):
    """A scale and a bias for each shape: p = softmax(a * x + b), for log-probabilities x after temperature scaling.

    The form is that of Guo et al. 2017. As in "structured vector scaling" (Berta et al. 2025, arXiv 2511.03685), x
    replaces the logits, and the ridge penalties ``diagonal · (K / n) · Σ (a_k - 1)²`` and ``bias · (K / n) · Σ b_k²``
    are added to the mean NLL. Without penalties there is no optimum if a shape is missing from the labels. They are
    weak, and the share of the probability that is spread over the shapes is small, 1/(n + 2)², so that the fit is near
    the optimum without either wherever there is one.

    Attributes:
        diagonal_strength: of the penalty on the scales, > 0.
        bias_strength: of the penalty on the biases, > 0.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> labels = rng.integers(3, size=3000)
        >>> logits = 2.0 * np.eye(3)[labels] + rng.normal(size=(3000, 3)) - [0.0, 0.0, 1.0]   # biased against the third
        >>> VectorScaling().fit(logits, labels).bias.round(2).tolist()
        [-0.49, -0.62, 1.11]
    """

    name: ClassVar[str] = "vector"

    diagonal_strength: float = 0.25
    bias_strength: float = 0.25

    def spread(self, num_rows: int) -> float:
        """See :meth:`AffineCalibration.spread`."""
        return 1.0 / (num_rows + 2) ** 2

    def penalty(self, num_rows: int, num_shapes: int) -> Floats:
        """See :meth:`AffineCalibration.penalty`; W is diagonal."""
        unit = num_shapes / num_rows
        return structured_penalty(num_shapes, self.diagonal_strength * unit, np.inf, self.bias_strength * unit)
