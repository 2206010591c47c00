"""Structured matrix scaling, the default calibration (decision 0022)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from belief.calibration.affine import AffineCalibration, structured_penalty
from belief.problem import Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class StructuredMatrixScaling(AffineCalibration):
    """Structured matrix scaling, p = softmax(W x + b), with penalties proportional to the number of parameters.

    Method: Berta, Holzmüller, Jordan and Bach, "Structured Matrix Scaling for Multi-Class Calibration", arXiv
    2511.03685, second version, with the defaults of the authors' implementation. x are log-probabilities after
    temperature scaling and mixing with the uniform distribution. The penalties, which are added to the mean NLL, are

        diagonal · (K / n) Σ (W_kk - 1)²,   off_diagonal · (K (K - 1) / n) Σ_{j≠k} W_jk²,   bias · (K / n) Σ b_k².

    With few touches the result is therefore temperature scaling. Unlike the paper, the uniform distribution has weight
    1/(n + 2) instead of 1/(n + 1), as in :class:`TemperatureScaling`, and K = 2 has no special case.

    Attributes:
        diagonal_strength: of the penalty on the diagonal, > 0.
        off_diagonal_strength: of the penalty on the rest of the matrix, > 0.
        bias_strength: of the penalty on the biases, > 0.

    Example:
        >>> import numpy as np
        >>> rng = np.random.default_rng(0)
        >>> labels = rng.integers(3, size=6000)
        >>> typical = np.array([[3.0, 1.5, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]])   # the first resembles the second
        >>> logits = typical[labels] + rng.normal(size=(6000, 3))
        >>> StructuredMatrixScaling().fit(logits[:9], labels[:9]).weights.round(1).tolist()
        [[1.0, -0.0, -0.0], [-0.0, 1.1, 0.0], [-0.0, 0.0, 1.1]]
        >>> StructuredMatrixScaling().fit(logits, labels).weights.round(1).tolist()
        [[1.1, 0.2, -0.2], [-0.0, 1.1, 0.0], [-0.0, -0.2, 1.4]]
    """

    name: ClassVar[str] = "structured_matrix"

    diagonal_strength: float = 1.0
    off_diagonal_strength: float = 1.0
    bias_strength: float = 1.0

    def penalty(self, num_rows: int, num_shapes: int) -> Floats:
        """See :meth:`AffineCalibration.penalty`."""
        unit = num_shapes / num_rows
        return structured_penalty(
            num_shapes,
            self.diagonal_strength * unit,
            self.off_diagonal_strength * unit * (num_shapes - 1),
            self.bias_strength * unit,
        )
