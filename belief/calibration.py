r"""Calibrate a classifier: make "90 % sure" right nine times out of ten.

Temperature scaling (Guo et al. 2017) divides the logits by one number T, fitted by maximum likelihood. In the inverse
temperature β = 1/T the loss is convex with derivative

    d/dβ mean NLL = mean over rows of  E_{p_β}[z] - z_label,        p_β = softmax(β z),

which rises from "mean logit minus label logit" at β = 0 to its limit at β → ∞. Its sign at the two ends tells
whether an optimum exists at all; what is found is stated in :attr:`TemperatureScaling.status`.

    >>> logits = np.array([[4.0, 0.0], [4.0, 0.0], [4.0, 0.0], [0.0, 4.0]])
    >>> fitted = TemperatureScaling().fit(logits, np.array([0, 0, 1, 1]))    # sure at 98 %, right at 75 %
    >>> fitted.status, fitted.predict_proba(logits)[0].round(3).tolist()
    ('ok', [0.75, 0.25])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import log_softmax, softmax

from belief.problem import Floats

Status: TypeAlias = Literal["unfitted", "ok", "separable", "uninformative", "anti_informative"]
_ROUNDING = 1e-12  # of a slope, the logits being at most one in size
_MAX_LOG = 700.0  # exp of more overflows
_EXTREME = 1e6  # ratio of the fallback temperatures to the scale of the logits


@dataclass(frozen=True)
class TemperatureScaling:
    """Divide logits by a fitted temperature.

    Attributes:
        temperature: T > 0, in units of the logits.
        status: ``ok``; ``separable``: every label already has the largest logit, T → 0; ``uninformative``: the
            logits say nothing about the labels, T → ∞ (1 where all are equal); ``anti_informative``: labels tend to
            have small logits, T → ∞.
        floor: probability mass spread evenly over all shapes, so that no prediction is ever zero; 1/(n + 2) when
            the status is ``separable`` (n right out of n does not prove that the next is right), else 0.
    """

    temperature: float = 1.0
    status: Status = "unfitted"
    floor: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.temperature < np.inf or not 0.0 <= self.floor < 1.0:
            raise ValueError(
                f"need a finite temperature > 0 and a floor in [0, 1), got {self.temperature} and {self.floor}"
            )

    def fit(self, logits: ArrayLike, labels: ArrayLike) -> TemperatureScaling:
        """The temperature that maximises the likelihood of the labels; returns a new, fitted object.

        Args:
            logits: ``(n, K)``, any float type, finite.
            labels: true shape indices, ``(n,)``.

        Raises:
            ValueError: empty input, NaN or infinite logits, labels out of range, shapes that do not fit.
        """
        half, y = _half_logits(logits, labels)
        scale = float(np.abs(half).max())
        if scale == 0.0:
            return TemperatureScaling(1.0, "uninformative")
        z = half / scale  # rows lie in [-1, 0]: sums neither overflow nor vanish
        label_logit = z[np.arange(len(y)), y]

        def slope(log_beta: float) -> float:
            probs = softmax(np.exp(log_beta) * z, axis=1)
            return float(np.mean((probs * z).sum(axis=1) - label_logit))

        flat_slope = float(np.mean(z.mean(axis=1) - label_logit))  # at β = 0
        if flat_slope >= -_ROUNDING:
            status: Status = "uninformative" if flat_slope <= _ROUNDING else "anti_informative"
            return TemperatureScaling(_largest(2 * scale * _EXTREME), status)
        if label_logit.max() == label_logit.min() == 0.0:
            return TemperatureScaling(_largest(2 * scale / _EXTREME), "separable", 1.0 / (len(y) + 2))
        low, high = -1.0, 1.0
        while slope(low) > 0.0 and low > -_MAX_LOG:
            low = max(2.0 * low, -_MAX_LOG)
        while slope(high) < 0.0 and high < _MAX_LOG:
            high = min(2.0 * high, _MAX_LOG)
        if slope(high) < 0.0 or slope(low) > 0.0:  # the optimum lies beyond what a float can hold
            log_beta = high if slope(high) < 0.0 else low
            return TemperatureScaling(_largest(2 * scale * np.exp(-log_beta)), "ok")
        log_beta = brentq(slope, low, high, xtol=1e-14, rtol=8.9e-16)
        return TemperatureScaling(_largest(2 * scale * np.exp(-log_beta)), "ok")

    def predict_log_proba(self, logits: ArrayLike) -> Floats:
        """Calibrated log probabilities, ``(..., K)``, of logits ``(..., K)``."""
        z = np.asarray(logits, np.float64)
        if z.size == 0:
            raise ValueError(f"logits are empty: {z.shape}")
        if not np.isfinite(z).all():
            raise ValueError(f"logits must be finite, got {z[~np.isfinite(z)][:3].tolist()} among them")
        z = z / 2 - z.max(axis=-1, keepdims=True) / 2  # halves: the difference of ±1e308 stays finite
        with np.errstate(over="ignore"):
            log_probs = log_softmax(np.maximum(z / (self.temperature / 2), -np.finfo(float).max), axis=-1)
        if self.floor == 0.0:
            return np.asarray(log_probs)
        return np.logaddexp(np.log1p(-self.floor) + log_probs, np.log(self.floor / z.shape[-1]))

    def predict_proba(self, logits: ArrayLike) -> Floats:
        """Calibrated probabilities, ``(..., K)``, of logits ``(..., K)``."""
        return np.exp(self.predict_log_proba(logits))


def _largest(temperature: float) -> float:
    return float(min(temperature, np.finfo(float).max))


def _half_logits(logits: ArrayLike, labels: ArrayLike) -> tuple[Floats, np.ndarray]:
    """Half the logits with each row's largest at zero (the difference of ±1e308 stays finite), and the labels."""
    z, y = np.asarray(logits, np.float64), np.asarray(labels)
    if z.ndim != 2 or z.size == 0 or y.shape != (len(z),):
        raise ValueError(f"need logits (n, K) and labels (n,) with n ≥ 1, got {z.shape} and {y.shape}")
    if not np.isfinite(z).all():
        row = int(np.argmin(np.isfinite(z).all(axis=1)))
        raise ValueError(f"logits in row {row} are not finite: {z[row].tolist()}")
    if not np.issubdtype(y.dtype, np.integer) or y.min() < 0 or y.max() >= z.shape[1]:
        raise ValueError(f"labels must be integers in [0, {z.shape[1]}), got {y.dtype} from {y.min()} to {y.max()}")
    return z / 2 - z.max(axis=1, keepdims=True) / 2, y
