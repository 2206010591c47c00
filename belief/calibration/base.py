"""The base class of calibrations."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from belief.codec import from_fields, to_fields
from belief.constraints import Within, require_rule
from belief.validation import (
    Floats,
    as_real,
    at,
    checked_values,
    labelled_logits,
    normalise_probs,
    warn_of_one_shape,
    warn_of_probs,
)

Status: TypeAlias = Literal["unfitted", "ok", "separable", "uninformative", "anti_informative"]


class Calibration(ABC):
    """A map from a classifier's logits to calibrated probabilities.

    Calibrations are immutable: :meth:`fit` returns a new one. An unfitted calibration is the softmax. A constant added
    to all logits of a row has no effect; logits may have any scale.

    To add one, derive a class and enter it in :data:`belief.calibration.CALIBRATIONS`.

    Attributes:
        name: name in files and tables.

    Example:
        >>> from belief.calibration import TemperatureScaling
        >>> logits, labels = np.array([[2.0, 0.0], [0.0, 2.0], [2.0, 0.0], [2.0, 0.0]]), np.array([0, 1, 0, 1])
        >>> calibration = TemperatureScaling().fit(logits, labels)
        >>> TemperatureScaling.from_fields(calibration.to_fields()) == calibration
        True
    """

    name: ClassVar[str]

    @property
    @abstractmethod
    def status(self) -> Status:
        """Status of the fit, see :class:`~belief.calibration.TemperatureScaling`."""

    @property
    @abstractmethod
    def num_shapes(self) -> int | None:
        """K; None if it is valid for any number."""

    def fit(self, logits: ArrayLike, labels: ArrayLike, weights: ArrayLike | None = None) -> Self:
        """A calibration that minimises :meth:`objective` on these data.

        Logits that look like probabilities or percentages, non-negative rows that sum to one or 100, cause a
        UserWarning: give :func:`logits_from_probs` of them. So do labels that are all the same.

        Args:
            logits: ``(n, K)``, any float type, finite.
            labels: true shape indices, ``(n,)``.
            weights: ``(n,)``, not negative; a row of weight 2 counts as two rows. By default each row counts once.

        Raises:
            ValueError: empty input, NaN or infinite logits, labels out of range, shapes that do not fit; weights that
                are negative, not finite, or all zero.
        """
        z, y = labelled_logits(no_probs(logits), labels)
        warn_of_one_shape(y, z.shape[1])
        if weights is None:
            return self.fit_logits(z, y)
        w = checked_values("weights", weights)
        if w.shape != y.shape:
            raise ValueError(f"need a weight for each of {len(y)} rows, got shape {w.shape}")
        if w.min() < 0.0 or not w.max() > 0.0:
            row = int(w.argmin())
            raise ValueError(f"weights must not be negative, and one must be above zero; got {w[row]}{at((row,))}")
        return self.fit_logits(z[w > 0.0], y[w > 0.0], w[w > 0.0])

    def predict_log_proba(self, logits: ArrayLike) -> Floats:
        """Calibrated log probabilities, ``(..., K)``, of logits ``(..., K)``; finite.

        Logits that look like probabilities cause a UserWarning, as in :meth:`fit`.

        Raises:
            ValueError: empty, NaN or infinite logits, or another K than in the fit.
        """
        return self.log_proba(no_probs(logits))

    def predict_proba(self, logits: ArrayLike) -> Floats:
        """Calibrated probabilities, ``(..., K)``; arguments and errors are those of :meth:`predict_log_proba`.

        A calibration that is not fitted changes nothing but what its settings say, with a UserWarning.
        """
        log_probs = self.log_proba(no_probs(logits))
        if self.status == "unfitted":
            written = "calibration = calibration.fit(logits, labels)"
            warnings.warn(
                f"this {type(self).__name__} is not fitted; fit returns a new object: {written}", stacklevel=2
            )
        with np.errstate(under="ignore"):
            return np.exp(log_probs)

    @abstractmethod
    def fit_logits(self, logits: ArrayLike, labels: ArrayLike, weights: Floats | None = None) -> Self:
        """:meth:`fit` to logits, without a warning; weights are above zero."""

    @abstractmethod
    def log_proba(self, logits: ArrayLike) -> Floats:
        """:meth:`predict_log_proba`, without a warning."""

    @abstractmethod
    def objective(self, logits: ArrayLike, labels: ArrayLike) -> tuple[float, Floats]:
        """The objective of :meth:`fit` [nats] on these data, and its gradient, ``(num_free,)``.

        After a fit no entry of the gradient exceeds 1e-8, unless the status states that there is no optimum.
        """

    def to_fields(self) -> dict[str, Any]:
        """All parameters, as JSON types: the fields of the dataclass (:mod:`belief.codec`)."""
        return to_fields(self)

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Self:
        """The calibration of fields from :meth:`to_fields`."""
        return from_fields(cls, fields)


def no_probs(logits: ArrayLike) -> Floats:
    """Logits as float64, with a UserWarning at the caller's caller if they look like probabilities."""
    found = as_real(logits, "logits")
    warn_of_probs(found, "logits", "take the logarithms of probabilities")
    return np.asarray(found, np.float64)


def logits_from_probs(probs: ArrayLike, floor: float = 1e-12) -> Floats:
    """Logits, for :meth:`Calibration.fit` and :class:`~belief.Touch`, of a classifier that gives probabilities.

    Args:
        probs: ``(..., K)``, rows that sum to one; or ``(n,)`` or ``(n, 1)``, the probability of the second of two
            shapes, as from a sigmoid. Sums may be off by 2e-3: divide rounded probabilities by their sum.
        floor: smaller probabilities count as this, in (0, 0.5); zeros have no finite logarithm. Of a forest of 100
            trees, 0.005 is half of the least step.

    Returns:
        Logarithms, ``(..., K)``, or ``(n, 2)``.

    Raises:
        ValueError: a number outside [0, 1], a row that does not sum to one, or a floor out of range.

    >>> logits_from_probs([[0.5, 0.5], [1.0, 0.0]], floor=1e-3).round(2).tolist()
    [[-0.69, -0.69], [0.0, -6.91]]
    >>> logits_from_probs([0.9]).round(2).tolist()
    [[-2.3, -0.11]]
    """
    require_rule("floor", floor, Within(0.0, 0.5, open_low=True, open_high=True))
    p = np.asarray(as_real(probs, "probs"), np.float64)
    if p.ndim == 1 or (p.ndim == 2 and p.shape[1] == 1):
        p = np.stack([1.0 - p.reshape(-1), p.reshape(-1)], axis=1)
    return np.log(np.maximum(normalise_probs(p), floor))
