"""The interface of calibrations: fit, predict, objective, and serialisation."""

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
    """Turns a classifier's logits into probabilities that can be believed.

    Calibrations are immutable: :meth:`fit` returns a new one. An unfitted calibration is the plain softmax. A constant
    added to all logits of a row changes nothing; logits may have any scale that a float can hold.

    To add one, write a class with these members and enter it in :data:`belief.calibration.CALIBRATIONS`.

    Attributes:
        name: what it is called in files and tables.

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
        """What fitting found, see :class:`~belief.calibration.TemperatureScaling`."""

    @property
    @abstractmethod
    def num_shapes(self) -> int | None:
        """K; None if it takes any number."""

    @abstractmethod
    def fit(self, logits: ArrayLike, labels: ArrayLike) -> Self:
        """The calibration that makes the labels most likely, penalties included; a new object.

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
            ValueError: empty, NaN or infinite logits, or a K that was not fitted.
        """

    def predict_proba(self, logits: ArrayLike) -> Floats:
        """Calibrated probabilities, ``(..., K)``, of logits ``(..., K)``; raises as :meth:`predict_log_proba`."""
        with np.errstate(under="ignore"):
            return np.exp(self.predict_log_proba(logits))

    @abstractmethod
    def objective(self, logits: ArrayLike, labels: ArrayLike) -> tuple[float, Floats]:
        """What :meth:`fit` minimises [nats], on these data with these parameters, and its gradient, ``(num_free,)``.

        At the end of a fit no entry of the gradient exceeds 1e-8, unless the status says that there is no optimum.
        """

    @abstractmethod
    def to_fields(self) -> dict[str, Any]:
        """Everything that makes this object, as JSON types."""

    @classmethod
    @abstractmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Self:
        """The object from :meth:`to_fields`."""

    def to_json(self, shape_labels: Sequence[str]) -> str:
        """The calibration as JSON text, exact to the last bit, with the names of the shapes it is for."""
        return write_json(self, shape_labels)

    @classmethod
    def from_json(cls, text: str, shape_labels: Sequence[str]) -> Self:
        """The calibration from :meth:`to_json`.

        Args:
            text: the JSON text.
            shape_labels: names of the shapes, in the order of the logits it will be given.

        Raises:
            ValueError: the text is no such calibration, or one for other shapes or another order of them.
        """
        return read_json(text, {cls.name: cls.from_fields}, shape_labels)
