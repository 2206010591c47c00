"""Multinomial logistic regression with an individual ridge penalty on each coefficient, by Newton's method.

With features x (the last of them 1) and coefficients C ``(K, F)``,

    objective(C) = weighted mean over rows of -log softmax(C x)_label + Σ_kf penalty_kf (C_kf - centre_kf)².

It is strictly convex for positive penalties, with one finite optimum for any labels. An infinite penalty fixes a
coefficient at its centre. Sums run over blocks of rows to limit memory. For many coefficients (45 shapes have 2 070)
the steps come from conjugate gradients with Hessian-vector products.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray
from scipy.special import softmax

from belief.validation import Floats

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
