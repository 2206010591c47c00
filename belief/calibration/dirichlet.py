"""Dirichlet calibration with off-diagonal and intercept regularisation (ODIR)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from belief.calibration.affine import AffineCalibration, structured_penalty
from belief.problem import Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class DirichletCalibration(AffineCalibration):
    """Dirichlet calibration, p = softmax(W x + b): exact if the classifier's p has a Dirichlet density for each shape.

    The form and the penalties, which are added to the mean NLL, are those of Kull et al. 2019, "Beyond temperature
    scaling: Obtaining well-calibrated multi-class probabilities with Dirichlet calibration":

        off_diagonal · 1 / (K (K - 1)) Σ_{j≠k} W_jk²  +  bias · 1 / K Σ b_k².

    They do not decrease with n: choose strengths by cross-validation (:func:`choose_calibration`). Unlike the paper, x
    are log-probabilities *after* temperature scaling, and the diagonal has the penalty diagonal · (1 / n) Σ (W_kk -
    1)², so that an optimum exists also if a shape is missing.

    Attributes:
        diagonal_strength: of the penalty on the diagonal, > 0.
        off_diagonal_strength: λ of the paper, > 0.
        bias_strength: μ of the paper, > 0.

    Example:
        >>> import numpy as np
        >>> rng = np.random.default_rng(0)
        >>> labels = rng.integers(2, size=4000)
        >>> p = rng.beta(np.array([2.0, 5.0])[labels], np.array([4.0, 3.0])[labels])    # probability of shape 1
        >>> weak = DirichletCalibration(off_diagonal_strength=1e-3, bias_strength=1e-3)   # n is large
        >>> fitted = weak.fit(np.log(np.stack([1.0 - p, p], axis=1)), labels)
        >>> fitted.predict_proba(np.log([0.5, 0.5])).round(2).tolist()   # Bayes' rule: 0.568
        [0.42, 0.58]
    """

    name: ClassVar[str] = "dirichlet"

    diagonal_strength: float = 0.1
    off_diagonal_strength: float = 0.1
    bias_strength: float = 0.1

    def penalty(self, num_rows: int, num_shapes: int) -> Floats:
        """See :meth:`AffineCalibration.penalty`."""
        return structured_penalty(
            num_shapes,
            self.diagonal_strength / num_rows,
            self.off_diagonal_strength / max(num_shapes * (num_shapes - 1), 1),
            self.bias_strength / num_shapes,
        )
