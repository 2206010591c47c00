"""The base class of calibrations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from belief.errors import InvalidArgument
from belief.files import sealed_json, unsealed_json
from belief.validation import Floats, as_logs, normalise_probs

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

    def fit(
        self, logits: ArrayLike | None = None, labels: ArrayLike | None = None, *, probs: ArrayLike | None = None
    ) -> Self:
        """A calibration that minimises :meth:`objective` on these data.

        Logits that look like probabilities, non-negative rows that sum to one, cause a UserWarning.

        Args:
            logits: ``(n, K)``, any float type, finite.
            labels: true shape indices, ``(n,)``.
            probs: the classifier's probabilities in place of its logits, ``(n, K)``.

        Raises:
            ValueError: empty input, NaN or infinite logits, labels out of range, shapes that do not fit; or not exactly
                one of logits and probabilities.
        """
        return self.fit_logits(given_logits(logits, probs), given("labels", labels))

    def predict_log_proba(self, logits: ArrayLike | None = None, *, probs: ArrayLike | None = None) -> Floats:
        """Calibrated log probabilities, ``(..., K)``, of logits or probabilities ``(..., K)``; finite.

        Warns as :meth:`fit`.

        Raises:
            ValueError: empty, NaN or infinite logits, another K than in the fit, or not exactly one of the two.
        """
        return self.log_proba_of(given_logits(logits, probs))

    def predict_proba(self, logits: ArrayLike | None = None, *, probs: ArrayLike | None = None) -> Floats:
        """Calibrated probabilities, ``(..., K)``; arguments and errors are those of :meth:`predict_log_proba`."""
        return self.proba_of(given_logits(logits, probs))

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

    def to_json(self, shape_labels: Sequence[str]) -> str:
        """The calibration as exact JSON text, with the names of its shapes."""
        if self.num_shapes not in (None, len(shape_labels)):
            raise ValueError(f"fitted for {self.num_shapes} shapes, got the names {list(shape_labels)}")
        return sealed_json({"calibration": self.name, "shape_labels": list(shape_labels), **self.to_fields()})

    @classmethod
    def from_json(cls, text: str, shape_labels: Sequence[str]) -> Self:
        """The calibration from :meth:`to_json`, for shapes in the order of the logits; errors as :func:`read_json`."""
        return read_json(text, {cls.name: cls}, shape_labels)


CalibrationT = TypeVar("CalibrationT", bound=Calibration)


def read_json(text: str, kinds: Mapping[str, type[CalibrationT]], shape_labels: Sequence[str]) -> CalibrationT:
    """The calibration in a JSON text, whose class is in ``kinds`` by its name.

    Raises:
        ValueError: the text is not such a calibration, was changed, or is for other shapes or another order.

    >>> read_json("[]", {}, ["cube"])
    Traceback (most recent call last):
    ...
    ValueError: not the calibration that was asked for: it is list, not a JSON object
    """
    try:
        fields = unsealed_json(text)
        if fields["calibration"] not in kinds:
            raise ValueError(f"expected {' or '.join(kinds)}, found {fields['calibration']!r}")
        if list(fields["shape_labels"]) != list(shape_labels):
            raise ValueError(f"it is for the shapes {fields['shape_labels']}, not for {list(shape_labels)}")
        calibration = kinds[fields["calibration"]].from_fields(fields)
        if calibration.num_shapes not in (None, len(shape_labels)):
            raise ValueError(f"it has parameters for {calibration.num_shapes} shapes, and names {len(shape_labels)}")
    except ValueError as error:
        raise ValueError(f"not the calibration that was asked for: {error}") from error
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(f"not a calibration: {error!r}") from error
    return calibration


def given_logits(logits: ArrayLike | None, probs: ArrayLike | None) -> Floats:
    """Logits, or the logarithms of probabilities, of which those below the least normal float count as that.

    Raises:
        ValueError: both or none are given, or probabilities that are none; the message names their row.

    >>> given_logits(None, probs=[0.5, 0.5]).round(2).tolist()
    [-0.69, -0.69]
    """
    found = as_logs("logits", logits, "probs", None if probs is None else normalise_probs(probs), stacklevel=4)
    return found if probs is None else np.maximum(found, np.log(np.finfo(np.float64).tiny))


def given(name: str, values: ArrayLike | None) -> ArrayLike:
    """An argument that may follow an optional one; raises InvalidArgument for None.

    >>> given("labels", [0, 1])
    [0, 1]
    """
    if values is None:
        raise InvalidArgument(f"{name} must be given")
    return values
