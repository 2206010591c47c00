"""Dirichlet calibration with off-diagonal and intercept regularisation (ODIR)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from belief.calibration.affine import AffineCalibration, structured_penalty
from belief.problem import Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class DirichletCalibration(AffineCalibration):
    """A full matrix on log-probabilities and a bias, p = softmax(W x + b): right if each shape's p is Dirichlet.

    From Kull et al. 2019, "Beyond temperature scaling: Obtaining well-calibrated multi-class probabilities with
    Dirichlet calibration", the form and the penalties beside the mean NLL,

        off_diagonal · 1 / (K (K - 1)) Σ_{j≠k} W_jk²  +  bias · 1 / K Σ b_k²,

    which do not shrink with n: choose strengths by cross-validation, see :func:`choose_calibration`. Ours: x are
    log-probabilities *after* temperature scaling, so that a strength means the same whatever the scale of the logits,
    and the diagonal, free in the paper, is drawn to 1 by diagonal · (1 / n) Σ (W_kk - 1)²: without that, there is no
    optimum where a shape is missing.

    Attributes:
        diagonal_strength: of the penalty on the diagonal, > 0.
        off_diagonal_strength: λ of the paper, > 0.
        bias_strength: μ of the paper, > 0.

    Example:
        >>> import numpy as np
        >>> rng = np.random.default_rng(0)
        >>> labels = rng.integers(2, size=4000)
        >>> p = rng.beta(np.array([2.0, 5.0])[labels], np.array([4.0, 3.0])[labels])    # stated for shape 1
        >>> weak = DirichletCalibration(off_diagonal_strength=1e-3, bias_strength=1e-3)   # there are many touches
        >>> fitted = weak.fit(np.log(np.stack([1.0 - p, p], axis=1)), labels)
        >>> fitted.predict_proba(np.log([0.5, 0.5])).round(2).tolist()   # by Bayes' rule 0.568 where one half is stated
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
