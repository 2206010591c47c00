"""Vector, Dirichlet and structured matrix scaling: affine maps of log-probabilities, their base class, and their fit.

The fit is multinomial logistic regression with an individual ridge penalty on each coefficient, by Newton's method.
With features x (the last of them 1) and coefficients C ``(K, F)``,

    objective(C) = weighted mean over rows of -log softmax(C x)_label + Σ_kf penalty_kf (C_kf - centre_kf)².

It is strictly convex for positive penalties, with one finite optimum for any labels. An infinite penalty fixes a
coefficient at its centre. Sums run over blocks of rows to limit memory. For many coefficients (45 shapes have 2 070)
the steps come from conjugate gradients with Hessian-vector products.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field, fields, replace
from typing import ClassVar, Self

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray
from scipy.special import softmax

from belief.calibration.base import Calibration, Status
from belief.calibration.temperature import TemperatureScaling
from belief.constraints import Positive, check
from belief.frozen import FrozenArrays
from belief.validation import Floats, as_real, labelled_logits

_BLOCK = 4096  # rows
_MAX_STEPS = 100
_MOST_DENSE = 2000  # free coefficients up to which the Hessian is formed: 32 MB


@dataclass(frozen=True, eq=False)
class SoftmaxRegression:
    """One regression problem: its data, and a penalty and a centre for each coefficient.

    ``features (F, n)`` have a row of ones for intercepts; ``labels (n,)`` are in [0, K); the ``weights (n,)`` of the
    rows are above zero. ``penalty (K, F)`` is positive, and infinite for coefficients fixed at their ``centre (K, F)``.

    >>> features, labels = np.array([[1.0, 2.0, -1.0], [1.0, 1.0, 1.0]]), np.array([0, 0, 1])
    >>> problem = SoftmaxRegression(features, labels, np.ones(3), np.full((2, 2), 0.1), np.zeros((2, 2)))
    >>> best = problem.solve()
    >>> bool(np.abs(problem.value_and_gradient(best)[1]).max() < 1e-12)
    True
    """

    features: Floats
    labels: NDArray[np.intp]
    weights: Floats
    penalty: Floats
    centre: Floats

    def value_and_gradient(self, coefficients: Floats) -> tuple[float, Floats]:
        """Objective [nats] and its derivatives in the free coefficients, in ascending order of (k, f)."""
        value, gradient, _ = self._derivatives(coefficients, curvature=False)
        return value, gradient

    def solve(self) -> Floats:
        """Coefficients at the optimum, ``(K, F)``, by Newton's method with step halving."""
        free = np.isfinite(self.penalty)
        current, is_dense = self.centre.copy(), free.sum() <= _MOST_DENSE
        if not free.any():
            return current
        value, gradient, hessian = self._derivatives(current, is_dense)
        for _ in range(_MAX_STEPS):
            step = -np.linalg.solve(hessian, gradient) if is_dense else self._step(current, free, gradient)
            expected, length = float(gradient @ step), 1.0
            while True:
                proposal = current.copy()
                proposal[free] += length * step
                proposed = self._derivatives(proposal, is_dense)
                # Near the optimum the descent is below rounding, and the full step is accepted.
                if proposed[0] <= value + 1e-4 * length * expected + 1e-13 * (1.0 + abs(value)):
                    break
                length /= 2.0
            current, (value, gradient, hessian) = proposal, proposed
            if length * np.abs(step).max() < 1e-9:  # the error is of the order of the squared step
                break
        return current

    def _step(self, coefficients: Floats, free: NDArray[np.bool_], gradient: Floats) -> Floats:
        """The Newton step by conjugate gradients, without a Hessian; more precise the smaller the gradient is."""
        # Preconditioner: inverse of the penalties plus an upper bound on the curvature of each coefficient.
        squares = np.square(self.features) @ self.weights / self.weights.sum()
        diagonal = (2.0 * self.penalty + squares / len(self.centre))[free]
        total, ridge = self.weights.sum(), 2.0 * self.penalty[free]

        def curvature(vector: Floats) -> Floats:
            """The product of the Hessian at these coefficients and a vector of the free ones."""
            direction, bent = np.zeros(self.centre.shape), np.zeros(self.centre.shape)
            direction[free] = vector.ravel()
            for first in range(0, len(self.labels), _BLOCK):
                x = self.features[:, first : first + _BLOCK]
                probs = softmax(coefficients @ x, axis=0)
                moved = direction @ x
                bent += (self.weights[first : first + _BLOCK] * probs * (moved - (probs * moved).sum(axis=0))) @ x.T
            return np.asarray(bent[free] / total + ridge * vector.ravel())

        operator, scale = (
            scipy.sparse.linalg.LinearOperator((gradient.size, gradient.size), matvec=product, dtype=np.float64)
            for product in (curvature, lambda vector: vector / diagonal)
        )
        tolerance = min(0.1, float(np.sqrt(np.abs(gradient).max())))  # gives superlinear convergence
        step, _ = scipy.sparse.linalg.cg(operator, -gradient, rtol=tolerance, atol=1e-12, M=scale)
        return np.asarray(step)

    def _derivatives(self, coefficients: Floats, curvature: bool) -> tuple[float, Floats, Floats]:
        """Objective, gradient and Hessian (empty without ``curvature``) in the free coefficients."""
        which, feature = np.nonzero(np.isfinite(self.penalty))
        size = len(which) if curvature else 0
        same = which[:size, None] == which[:size]
        loss, slope, bend = 0.0, np.zeros(self.centre.shape), np.zeros((size, size))
        total = float(self.weights.sum())
        for first in range(0, len(self.labels), _BLOCK):
            block = slice(first, first + _BLOCK)
            x, y, w = self.features[:, block], self.labels[block], self.weights[block]
            rows = np.arange(len(y))
            scores = coefficients @ x  # (K, rows)
            scores -= scores.max(axis=0)
            probs = np.exp(scores)
            totals = probs.sum(axis=0)
            probs /= totals
            loss += float((w * (np.log(totals) - scores[y, rows])).sum())
            if curvature:
                weighted = probs[which] * x[feature]  # (free, rows)
                bend += np.where(same, ((w * weighted) @ x.T)[:, feature], 0.0) - (w * weighted) @ weighted.T
            probs[y, rows] -= 1.0
            slope += (w * probs) @ x.T
        ridge, away = self.penalty[which, feature], (coefficients - self.centre)[which, feature]
        value = loss / total + float(ridge @ away**2)
        bend /= total
        bend[np.diag_indices(size)] += 2.0 * ridge[:size]
        return value, slope[which, feature] / total + 2.0 * ridge * away, bend


@dataclass(frozen=True, eq=False, kw_only=True)
class AffineCalibration(FrozenArrays, Calibration):
    """An affine map of log-probabilities x after temperature scaling: p = softmax(W x + b).

    First a temperature is fitted, and a small share of the probability is spread evenly over the shapes, 1/(n + 2)
    unless a class says otherwise; so x is of moderate size for logits of any scale. Then W and b are fitted with ridge
    penalties towards the identity and zero. The optimum is finite and unique for any labels. With few or uninformative
    data the result is temperature scaling.

    Attributes:
        temperature: the first step, with the spread probability as its floor.
        coefficients: (W | b), ``(K, K + 1)``; None before the fit.

    Example:
        >>> from belief.calibration import VectorScaling
        >>> fitted = VectorScaling().fit([[2.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 0.0]], [0, 1, 1, 0])
        >>> fitted.coefficients.shape, fitted.status
        ((2, 3), 'ok')
    """

    last_in_file: ClassVar = ("temperature", "coefficients")

    temperature: TemperatureScaling = field(default=TemperatureScaling())
    coefficients: Floats | None = None

    def __post_init__(self) -> None:
        check(self)
        if self.coefficients is None:
            return
        matrix = np.asarray(as_real(self.coefficients, "coefficients"), np.float64)
        if matrix.ndim != 2 or matrix.shape[1] != len(matrix) + 1 or not np.isfinite(matrix).all():
            raise ValueError(f"coefficients must be (K, K + 1) and finite, got {matrix.shape}: {matrix.tolist()}")
        object.__setattr__(self, "coefficients", matrix)
        self.freeze()

    @classmethod
    def penalty_names(cls) -> tuple[str, ...]:
        """Names of the fields that are strengths of penalties."""
        return tuple(f.name for f in fields(cls) if f.name not in ("temperature", "coefficients"))

    @abstractmethod
    def penalties(self, num_rows: float, num_shapes: int) -> tuple[float, float, float]:
        """Penalties on the squares of the diagonal of W - I, of its rest, and of b; infinite: they are zero."""

    def penalty(self, num_rows: float, num_shapes: int) -> Floats:
        """Penalty on the square of each entry of (W - I | b), ``(K, K + 1)``."""
        diagonal, off_diagonal, bias = self.penalties(num_rows, num_shapes)
        penalty = np.full((num_shapes, num_shapes + 1), off_diagonal)
        np.fill_diagonal(penalty, diagonal)
        penalty[:, -1] = bias
        return penalty

    def spread(self, num_rows: float) -> float:
        """The share of the probability that is spread evenly over the shapes after the temperature."""
        return 1.0 / (num_rows + 2)

    @property
    def status(self) -> Status:
        """Status of the temperature; unless it is ``ok``, W has no effect and b fits the frequencies of the shapes."""
        return self.temperature.status

    @property
    def weights(self) -> Floats:
        """W, ``(K, K)``; raises ValueError before the fit."""
        return self._fitted()[:, :-1]

    @property
    def bias(self) -> Floats:
        """b, ``(K,)``; raises ValueError before the fit."""
        return self._fitted()[:, -1]

    @property
    def num_shapes(self) -> int | None:
        """K; None before the fit."""
        return None if self.coefficients is None else len(self.coefficients)

    def fit_logits(self, logits: ArrayLike, labels: ArrayLike, weights: Floats | None = None) -> Self:
        """See :meth:`Calibration.fit`; Newton's method until the gradient is at rounding errors."""
        z, y = labelled_logits(logits, labels)
        total = len(y) if weights is None else float(weights.sum())
        temperature = replace(TemperatureScaling().fit_logits(z, y, weights), floor=self.spread(total))
        unsolved = replace(self, temperature=temperature, coefficients=None)
        return replace(unsolved, coefficients=unsolved._problem(z, y, weights).solve())

    def log_proba(self, logits: ArrayLike) -> Floats:
        """See :meth:`Calibration.log_proba`."""
        x = self.temperature.log_proba(logits)
        if self.coefficients is None:
            return x
        self._check_shapes(x.shape[-1])
        scores = x @ self.coefficients[:, :-1].T + self.coefficients[:, -1]
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

    def _fitted(self) -> Floats:
        if self.coefficients is None:
            raise ValueError("there are no coefficients yet: call fit first")
        return self.coefficients

    def _problem(self, logits: Floats, labels: NDArray[np.intp], weights: Floats | None = None) -> SoftmaxRegression:
        num_rows, num_shapes = logits.shape
        w = np.ones(num_rows) if weights is None else weights
        centre = np.eye(num_shapes, num_shapes + 1)  # changes nothing
        features = np.ones((num_shapes + 1, num_rows))
        features[:-1] = self.temperature.log_proba(logits).T
        return SoftmaxRegression(features, labels, w, self.penalty(float(w.sum()), num_shapes), centre)

    def _check_shapes(self, num_shapes: int) -> None:
        if num_shapes != self.num_shapes:
            raise ValueError(f"fitted for {self.num_shapes} shapes, got logits of {num_shapes}")


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

    >>> labels = np.arange(3000) % 3
    >>> logits = 2.0 * np.eye(3)[labels] + np.random.default_rng(0).normal(size=(3000, 3)) - [0.0, 0.0, 1.0]
    >>> int(VectorScaling().fit(logits, labels).bias.argmax())  # which they are biased against
    2
    """

    name: ClassVar[str] = "vector"

    diagonal_strength: Positive = 0.25
    bias_strength: Positive = 0.25

    def spread(self, num_rows: float) -> float:
        """See :meth:`AffineCalibration.spread`."""
        return 1.0 / (num_rows + 2) ** 2

    def penalties(self, num_rows: float, num_shapes: int) -> tuple[float, float, float]:
        """See :meth:`AffineCalibration.penalties`; W is diagonal."""
        unit = num_shapes / num_rows
        return self.diagonal_strength * unit, np.inf, self.bias_strength * unit


@dataclass(frozen=True, eq=False, kw_only=True)
class DirichletCalibration(AffineCalibration):
    """Dirichlet calibration, p = softmax(W x + b): exact if the classifier's p has a Dirichlet density for each shape.

    The form and the penalties, which are added to the mean NLL, are those of Kull et al. 2019, "Beyond temperature
    scaling: Obtaining well-calibrated multi-class probabilities with Dirichlet calibration":

        off_diagonal · 1 / (K (K - 1)) Σ_{j≠k} W_jk²  +  bias · 1 / K Σ b_k².

    They do not decrease with n: choose strengths by cross-validation. Unlike the paper, x
    are log-probabilities *after* temperature scaling, and the diagonal has the penalty diagonal · (1 / n) Σ (W_kk -
    1)², so that an optimum exists also if a shape is missing.

    Attributes:
        diagonal_strength: of the penalty on the diagonal, > 0.
        off_diagonal_strength: λ of the paper, > 0.
        bias_strength: μ of the paper, > 0.

    >>> labels, rng = np.arange(4000) % 2, np.random.default_rng(0)
    >>> p = rng.beta(np.array([2.0, 5.0])[labels], np.array([4.0, 3.0])[labels])    # probability of shape 1
    >>> weak = DirichletCalibration(off_diagonal_strength=1e-3, bias_strength=1e-3)   # n is large
    >>> fitted = weak.fit(np.log(np.stack([1.0 - p, p], axis=1)), labels)
    >>> int(fitted.predict_proba(np.log([0.5, 0.5])).argmax())   # by Bayes' rule, shape 1 has 0.568
    1
    """

    name: ClassVar[str] = "dirichlet"

    diagonal_strength: Positive = 0.1
    off_diagonal_strength: Positive = 0.1
    bias_strength: Positive = 0.1

    def penalties(self, num_rows: float, num_shapes: int) -> tuple[float, float, float]:
        """See :meth:`AffineCalibration.penalties`."""
        off_diagonal = self.off_diagonal_strength / max(num_shapes * (num_shapes - 1), 1)
        return self.diagonal_strength / num_rows, off_diagonal, self.bias_strength / num_shapes


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

    >>> labels, rng = np.arange(6000) % 3, np.random.default_rng(0)
    >>> typical = np.array([[3.0, 1.5, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]])   # the first resembles the second
    >>> logits = typical[labels] + rng.normal(size=(6000, 3))
    >>> few, many = (StructuredMatrixScaling().fit(logits[:n], labels[:n]).weights for n in (9, 6000))
    >>> bool(np.abs(few - np.eye(3)).max() < 0.2 < np.abs(many - np.eye(3)).max())
    True
    """

    name: ClassVar[str] = "structured_matrix"

    diagonal_strength: Positive = 1.0
    off_diagonal_strength: Positive = 1.0
    bias_strength: Positive = 1.0

    def penalties(self, num_rows: float, num_shapes: int) -> tuple[float, float, float]:
        """See :meth:`AffineCalibration.penalties`."""
        unit = num_shapes / num_rows
        off_diagonal = self.off_diagonal_strength * unit * (num_shapes - 1)
        return self.diagonal_strength * unit, off_diagonal, self.bias_strength * unit


CALIBRATIONS: dict[str, type[Calibration]] = {
    kind.name: kind for kind in (TemperatureScaling, VectorScaling, StructuredMatrixScaling, DirichletCalibration)
}
"""Classes by name, the simplest first."""
