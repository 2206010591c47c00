"""Multinomial logistic regression with a ridge penalty of its own on every coefficient, by Newton's method.

With features x (the last of them 1) and coefficients C ``(K, F)``,

    objective(C) = mean over rows of -log softmax(C x)_label + Σ_kf penalty_kf (C_kf - centre_kf)².

It is convex, and strictly so where all penalties are above zero: one finite optimum, whatever the labels. An infinite
penalty holds a coefficient at its centre. Everything is summed over blocks of rows: memory does not grow with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from belief.problem import Floats

_BLOCK = 4096  # rows
_MAX_STEPS = 100


@dataclass(frozen=True, eq=False)
class SoftmaxRegression:
    """One problem: data, penalties and centre.

    Attributes:
        features: ``(F, n)``, of moderate size; a row of ones gives intercepts.
        labels: ``(n,)``, in [0, K).
        penalty: ``(K, F)``, above zero; infinite where the coefficient is held at its centre.
        centre: ``(K, F)``, where there are no data the best coefficients are these.

    Example:
        >>> features, labels = np.array([[1.0, 2.0, -1.0], [1.0, 1.0, 1.0]]), np.array([0, 0, 1])
        >>> problem = SoftmaxRegression(features, labels, np.full((2, 2), 0.1), np.zeros((2, 2)))
        >>> best = problem.solve()
        >>> bool(np.abs(problem.value_and_gradient(best)[1]).max() < 1e-12)
        True
    """

    features: Floats
    labels: NDArray[np.intp]
    penalty: Floats
    centre: Floats

    def value_and_gradient(self, coefficients: Floats) -> tuple[float, Floats]:
        """Objective [nats] and its derivatives in the coefficients that are free, in rising order of (k, f)."""
        value, gradient, _ = self._derivatives(coefficients, curvature=False)
        return value, gradient

    def solve(self) -> Floats:
        """Coefficients at the optimum, ``(K, F)``: Newton steps, halved while they do not descend."""
        free = np.isfinite(self.penalty)
        current = self.centre.copy()
        if not free.any():
            return current
        value, gradient, hessian = self._derivatives(current)
        for _ in range(_MAX_STEPS):
            step = -np.linalg.solve(hessian, gradient)
            promised, length = float(gradient @ step), 1.0
            while True:
                proposal = current.copy()
                proposal[free] += length * step
                proposed = self._derivatives(proposal)
                # Near the optimum the descent drowns in rounding, and the full step is right.
                if proposed[0] <= value + 1e-4 * length * promised + 1e-13 * (1.0 + abs(value)):
                    break
                length /= 2.0
            current, (value, gradient, hessian) = proposal, proposed
            if length * np.abs(step).max() < 1e-9:  # the error is of the order of its square
                break
        return current

    def _derivatives(self, coefficients: Floats, curvature: bool = True) -> tuple[float, Floats, Floats]:
        """Objective, gradient and Hessian (zero if not asked for) in the free coefficients."""
        which, feature = np.nonzero(np.isfinite(self.penalty))
        same = which[:, None] == which
        loss, slope, bend = 0.0, np.zeros(self.centre.shape), np.zeros(same.shape)
        num_rows = len(self.labels)
        for first in range(0, num_rows, _BLOCK):
            x, y = self.features[:, first : first + _BLOCK], self.labels[first : first + _BLOCK]
            rows = np.arange(len(y))
            scores = coefficients @ x  # (K, rows)
            scores -= scores.max(axis=0)
            probs = np.exp(scores)
            totals = probs.sum(axis=0)
            probs /= totals
            loss += float(np.log(totals).sum() - scores[y, rows].sum())
            if curvature:
                weighted = probs[which] * x[feature]  # (free, rows)
                bend += np.where(same, (weighted @ x.T)[:, feature], 0.0) - weighted @ weighted.T
            probs[y, rows] -= 1.0
            slope += probs @ x.T
        ridge, away = self.penalty[which, feature], (coefficients - self.centre)[which, feature]
        value = loss / num_rows + float(ridge @ away**2)
        bend /= num_rows
        bend[np.diag_indices_from(bend)] += 2.0 * ridge
        return value, slope[which, feature] / num_rows + 2.0 * ridge * away, bend
