"""The base class of calibrations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from belief.calibration.serialisation import read_json, write_json
from belief.problem import Floats

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
        >>> text = calibration.to_json(["cube", "cone"])
        >>> TemperatureScaling.from_json(text, ["cube", "cone"]) == calibration
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

    @abstractmethod
    def fit(self, logits: ArrayLike, labels: ArrayLike) -> Self:
        """A calibration that minimises :meth:`objective` on these data.

        Args:
            logits: ``(n, K)``, any float type, finite.
            labels: true shape indices, ``(n,)``.

        Raises:
            ValueError: empty input, NaN or infinite logits, labels out of range, shapes that do not fit.
        """

    @abstractmethod
    def predict_log_proba(self, logits: ArrayLike) -> Floats:
        """Calibrated log probabilities, ``(..., K)``, of logits ``(..., K)``; finite.

        Raises:
            ValueError: empty, NaN or infinite logits, or another K than in the fit.
        """

    def predict_proba(self, logits: ArrayLike) -> Floats:
        """Calibrated probabilities, ``(..., K)``, of logits ``(..., K)``; raises as :meth:`predict_log_proba`."""
        with np.errstate(under="ignore"):
            return np.exp(self.predict_log_proba(logits))

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

    def to_json(self, shape_labels: Sequence[str]) -> str:
        """The calibration as exact JSON text, with the names of its shapes."""
        return write_json(self, shape_labels)

    @classmethod
    def from_json(cls, text: str, shape_labels: Sequence[str]) -> Self:
        """The calibration from :meth:`to_json`.

        Args:
            text: the JSON text.
            shape_labels: names of the shapes, in the order of the logits.

        Raises:
            ValueError: the text is not such a calibration, or is for other shapes or another order.
        """
        return read_json(text, {cls.name: cls.from_fields}, shape_labels)
