"""Support vectors with a Gaussian kernel: scikit-learn fits them, numpy evaluates them.

So a saved reader is arrays, and whoever reads with it needs no scikit-learn.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from activetouch.extras import require_extra
from belief.validation import Floats

_BLOCK = 1 << 22  # kernel values in memory at a time


@dataclass(eq=False)
class SupportVectors:
    """A classifier with scikit-learn's interface; the score of a label is its mean margin over the others.

    Attributes:
        C: weight of touches on the wrong side of a margin.
        classes_: the labels, K.
        vectors: ``(V, F)``.
        coefficients, intercepts: of the labels' scores in the kernel's values, ``(V, K)`` and ``(K,)``.
        gamma: of the kernel exp(-gamma ‖x - v‖²).
    """

    C: float
    classes_: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    vectors: Floats = field(default_factory=lambda: np.empty((0, 0)))
    coefficients: Floats = field(default_factory=lambda: np.empty((0, 0)))
    intercepts: Floats = field(default_factory=lambda: np.empty(0))
    gamma: float = 1.0

    def fit(self, features: Floats, labels: NDArray[np.int64]) -> SupportVectors:
        """Learn from features ``(n, F)`` with labels ``(n,)``.

        Raises:
            MissingPackage: scikit-learn is not installed.
        """
        require_extra("recorded")
        from sklearn.svm import SVC

        variance = float(features.var())
        self.gamma = 1.0 / (features.shape[1] * variance) if variance else 1.0
        fitted = SVC(C=self.C, gamma=self.gamma, decision_function_shape="ovo", class_weight="balanced")
        fitted.fit(features, labels)
        self.classes_, self.vectors = fitted.classes_, fitted.support_vectors_
        size, owners = len(self.classes_), np.repeat(np.arange(len(self.classes_)), fitted.n_support_)
        self.coefficients, self.intercepts = np.zeros((len(owners), size)), np.zeros(size)
        sign = -1.0 if size == 2 else 1.0  # scikit-learn turns the margin of two labels around
        for pair, (one, other) in enumerate(zip(*np.triu_indices(size, 1), strict=True)):
            weights = np.zeros(len(owners))
            weights[owners == one] = fitted.dual_coef_[other - 1, owners == one]
            weights[owners == other] = fitted.dual_coef_[one, owners == other]
            for label, way in ((one, sign), (other, -sign)):
                self.coefficients[:, label] += way * weights
                self.intercepts[label] += way * fitted.intercept_[pair]
        self.coefficients /= size - 1 if size > 2 else 2
        self.intercepts /= size - 1 if size > 2 else 2
        return self

    def decision_function(self, features: Floats) -> Floats:
        """Scores ``(n, K)`` of features ``(n, F)``."""
        squares = (self.vectors**2).sum(axis=1)
        size = max(1, _BLOCK // max(len(self.vectors), 1))
        found = [np.empty((0, len(self.classes_)))]
        for first in range(0, len(features), size):
            rows = features[first : first + size]
            distances = (rows**2).sum(axis=1)[:, None] - 2.0 * rows @ self.vectors.T + squares
            found.append(np.exp(-self.gamma * np.maximum(distances, 0.0)) @ self.coefficients + self.intercepts)
        return np.concatenate(found)
