"""The base class of calibrations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from belief.validation import Floats, as_real, warn_of_probs

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

    def fit(self, logits: ArrayLike, labels: ArrayLike) -> Self:
        """A calibration that minimises :meth:`objective` on these data.

        Logits that look like probabilities, non-negative rows that sum to one, cause a UserWarning: give the logarithms
        of probabilities.

        Args:
            logits: ``(n, K)``, any float type, finite.
            labels: true shape indices, ``(n,)``.

        Raises:
            ValueError: empty input, NaN or infinite logits, labels out of range, shapes that do not fit.
        """
        return self.fit_logits(no_probs(logits), labels)

    def predict_log_proba(self, logits: ArrayLike) -> Floats:
        """Calibrated log probabilities, ``(..., K)``, of logits ``(..., K)``; finite. Warns as :meth:`fit`.

        Raises:
            ValueError: empty, NaN or infinite logits, or another K than in the fit.
        """
        return self.log_proba_of(no_probs(logits))

    def predict_proba(self, logits: ArrayLike) -> Floats:
        """Calibrated probabilities, ``(..., K)``; arguments and errors are those of :meth:`predict_log_proba`."""
        return self.proba_of(no_probs(logits))

    @abstractmethod
    def fit_logits(self, logits: ArrayLike, labels: ArrayLike) -> Self:
        """:meth:`fit` to logits, without a warning."""

    @abstractmethod
    def log_proba_of(self, logits: ArrayLike) -> Floats:
        """:meth:`predict_log_proba` of logits, without a warning."""

    def proba_of(self, logits: ArrayLike) -> Floats:
        """:meth:`predict_proba` of logits, without a warning."""
        with np.errstate(under="ignore"):
            return np.exp(self.log_proba_of(logits))

    @abstractmethod
    def objective(self, logits: ArrayLike, labels: ArrayLike) -> tuple[float, Floats]:
        """The objective of :meth:`fit` [nats] on these data, and its gradient, ``(num_free,)``.

        After a fit no entry of the gradient exceeds 1e-8, unless the status states that there is no optimum.
        """

    @abstractmethod
    def to_fields(self) -> dict[str, Any]:
        """All parameters, as JSON types."""

    @classmethod
    @abstractmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Self:
        """The calibration of fields from :meth:`to_fields`."""


def no_probs(logits: ArrayLike) -> Floats:
    """Logits as float64, with a UserWarning at the caller's caller if they look like probabilities.

    >>> no_probs([[2, -1]])
    array([[ 2., -1.]])
    """
    found = as_real(logits, "logits")
    warn_of_probs(found, "logits", "take the logarithms of probabilities")
    return np.asarray(found, np.float64)
