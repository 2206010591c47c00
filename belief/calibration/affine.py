"""Base class of vector, beta, Dirichlet and structured matrix scaling: an affine map of log-probabilities."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.calibration.base import Calibration, Status
from belief.calibration.inputs import labelled_logits
from belief.calibration.softmax_regression import SoftmaxRegression
from belief.calibration.temperature import TemperatureScaling
from belief.frozen import FrozenArrays
from belief.problem import Floats
from belief.validation import as_real


@dataclass(frozen=True, eq=False, kw_only=True)
class AffineCalibration(FrozenArrays, Calibration):
    """An affine map of log-probabilities x after temperature scaling: p = softmax(W x + b).

    First a temperature is fitted, and a small share of the probability is spread evenly over the shapes, 1/(n + 2)
    unless a class says otherwise; so x is of moderate size for logits of any scale. Then W and b are fitted with ridge
    penalties towards the identity and zero. The optimum is finite and unique for any labels. With few or uninformative
    data the result is temperature scaling.

    Attributes:
        inputs_per_shape: F / K.
        temperature: the first step, with the spread probability as its floor.
        coefficients: (W | b), ``(K, F + 1)`` for F inputs, which are K unless a class has more; None before the fit.

    Raises:
        ValueError: a penalty that is not positive, or coefficients of the wrong shape or not finite.

    Example:
        >>> from belief.calibration import VectorScaling
        >>> fitted = VectorScaling().fit([[2.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 0.0]], [0, 1, 1, 0])
        >>> fitted.coefficients.shape, fitted.status
        ((2, 3), 'ok')
    """

    inputs_per_shape: ClassVar[int] = 1

    temperature: TemperatureScaling = field(default=TemperatureScaling())
    coefficients: Floats | None = None

    def __post_init__(self) -> None:
        for name in self.penalty_names():
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be above zero and finite, got {getattr(self, name)}")
        if self.coefficients is None:
            return
        matrix = np.array(as_real(self.coefficients, "coefficients"), np.float64)
        each = f"{self.inputs_per_shape} K + 1" if self.inputs_per_shape > 1 else "K + 1"
        fits = matrix.ndim == 2 and matrix.shape[1] == self.inputs_per_shape * len(matrix) + 1
        if not (fits and np.isfinite(matrix).all()):
            raise ValueError(f"coefficients must be (K, {each}) and finite, got {matrix.shape}: {matrix.tolist()}")
        matrix.flags.writeable = False
        object.__setattr__(self, "coefficients", matrix)

    @classmethod
    def penalty_names(cls) -> tuple[str, ...]:
        """Names of the fields that are strengths of penalties."""
        return tuple(f.name for f in fields(cls) if f.name not in ("temperature", "coefficients"))

    @abstractmethod
    def penalty(self, num_rows: int, num_shapes: int) -> Floats:
        """Penalty on the square of each entry of (W - I | b), ``(K, F + 1)``; infinite for entries fixed at zero."""

    def inputs(self, log_probs: Floats) -> Floats:
        """What the map reads, ``(..., F)``, of log-probabilities x, ``(..., K)``; the first K are x."""
        return log_probs

    def spread(self, num_rows: int) -> float:
        """The share of the probability that is spread evenly over the shapes after the temperature."""
        return 1.0 / (num_rows + 2)

    @property
    def status(self) -> Status:
        """Status of the temperature; unless it is ``ok``, W has no effect and b fits the frequencies of the shapes."""
        return self.temperature.status

    @property
    def weights(self) -> Floats:
        """W, ``(K, F)``; raises ValueError before the fit."""
        return self._fitted()[:, :-1]

    @property
    def bias(self) -> Floats:
        """b, ``(K,)``; raises ValueError before the fit."""
        return self._fitted()[:, -1]

    @property
    def num_shapes(self) -> int | None:
        """K; None before the fit."""
        return None if self.coefficients is None else len(self.coefficients)

    def fit_logits(self, logits: ArrayLike, labels: ArrayLike) -> Self:
        """See :meth:`Calibration.fit`; Newton's method until the gradient is at rounding errors."""
        z, y = labelled_logits(logits, labels)
        temperature = replace(TemperatureScaling().fit_logits(z, y), floor=self.spread(len(y)))
        unsolved = replace(self, temperature=temperature, coefficients=self._identity(z.shape[1]))
        return replace(unsolved, coefficients=unsolved._problem(z, y).solve())

    def log_proba_of(self, logits: ArrayLike) -> Floats:
        """See :meth:`Calibration.predict_log_proba`."""
        x = self.temperature.log_proba_of(logits)
        if self.coefficients is None:
            return x
        self._check_shapes(x.shape[-1])
        scores = self.inputs(x) @ self.coefficients[:, :-1].T + self.coefficients[:, -1]
        scores -= scores.max(axis=-1, keepdims=True)
        with np.errstate(under="ignore"):
            scores -= np.log(np.exp(scores).sum(axis=-1, keepdims=True))
        return scores

    def objective(self, logits: ArrayLike, labels: ArrayLike) -> tuple[float, Floats]:
        """See :meth:`Calibration.objective`; for the fitted temperature."""
        z, y = labelled_logits(logits, labels)
        coefficients = self._fitted()
        self._check_shapes(z.shape[1])
        return self._problem(z, y).value_and_gradient(coefficients)

    def to_fields(self) -> dict[str, Any]:
        """See :meth:`Calibration.to_fields`."""
        strengths = {name: getattr(self, name) for name in self.penalty_names()}
        matrix = None if self.coefficients is None else self.coefficients.tolist()
        return {**strengths, "temperature": self.temperature.to_fields(), "coefficients": matrix}

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Self:
        """See :meth:`Calibration.from_fields`."""
        strengths = {name: float(fields[name]) for name in cls.penalty_names()}
        temperature = TemperatureScaling.from_fields(fields["temperature"])
        return cls(temperature=temperature, coefficients=fields["coefficients"], **strengths)

    def _fitted(self) -> Floats:
        if self.coefficients is None:
            raise ValueError("there are no coefficients yet: call fit first")
        return self.coefficients

    def _problem(self, logits: Floats, labels: NDArray[np.intp]) -> SoftmaxRegression:
        num_rows, num_shapes = logits.shape
        centre = self._identity(num_shapes)
        features = np.ones((centre.shape[1], num_rows))
        features[:-1] = self.inputs(self.temperature.log_proba_of(logits)).T
        return SoftmaxRegression(features, labels, self.penalty(num_rows, num_shapes), centre)

    def _identity(self, num_shapes: int) -> Floats:
        """The map that changes nothing."""
        return np.eye(num_shapes, self.inputs_per_shape * num_shapes + 1)

    def _check_shapes(self, num_shapes: int) -> None:
        if num_shapes != self.num_shapes:
            raise ValueError(f"fitted for {self.num_shapes} shapes, got logits of {num_shapes}")


def structured_penalty(num_shapes: int, diagonal: float, off_diagonal: float, bias: float) -> Floats:
    """Penalties on (W | b), ``(K, K + 1)``, one for each part.

    >>> structured_penalty(2, diagonal=1.0, off_diagonal=2.0, bias=3.0)
    array([[1., 2., 3.],
           [2., 1., 3.]])
    """
    penalty = np.full((num_shapes, num_shapes + 1), off_diagonal)
    np.fill_diagonal(penalty, diagonal)
    penalty[:, -1] = bias
    return penalty
