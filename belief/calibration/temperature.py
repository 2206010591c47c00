r"""Temperature scaling (Guo et al. 2017): divide the logits by one number T, fitted by maximum likelihood.

In the inverse temperature β = 1/T the loss is convex with derivative

    d/dβ mean NLL = mean over rows of  E_{p_β}[z] - z_label,        p_β = softmax(β z),

which increases with β. Its signs at β = 0 and β → ∞ show whether an optimum exists; see
:attr:`TemperatureScaling.status`.

    >>> logits = np.array([[4.0, 0.0], [4.0, 0.0], [4.0, 0.0], [0.0, 4.0]])
    >>> fitted = TemperatureScaling().fit(logits, np.array([0, 0, 1, 1]))    # confidence 98 %, accuracy 75 %
    >>> fitted.status, fitted.predict_proba(logits)[0].round(3).tolist()
    ('ok', [0.75, 0.25])
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.calibration.base import Calibration, Status
from belief.constraints import Positive, Within, check
from belief.validation import Floats, labelled_logits, log_softmax

_ROUNDING = 1e-12  # of a slope, in units of the largest logit
_EXTREME = 1e6  # ratio of the fallback temperatures to the scale of the logits
_LARGEST = float(np.finfo(float).max)
_LEAST = 5e-324  # the smallest number above zero
_VANISHING = -750.0  # exp of this is 0
_LOG_BETA = (-700.0, 700.0)  # where e to this power is a float, and so is its inverse
_SHIFT = 2.0**500  # exact factor that brings logits of 1e±300 into a range where β does not overflow
_BLOCK = 8192  # rows at a time, which fit in the cache
_ENOUGH = 1 << 15  # rows whose optimum is a good initial value


@dataclass(frozen=True)
class TemperatureScaling(Calibration):
    """Divide logits by a fitted temperature.

    Attributes:
        temperature: T > 0, in units of the logits.
        status: ``ok``; ``separable``: every label has the largest logit, T → 0; ``uninformative``: the logits do not
            depend on the labels, T → ∞ (1 if all logits are equal); ``anti_informative``: labels tend to have small
            logits, T → ∞.
        floor: probability spread evenly over all shapes; 1/(n + 2) if the status is ``separable``, else 0.

    >>> TemperatureScaling(temperature=2.0, status="ok").predict_proba([2.0, 0.0]).round(3).tolist()
    [0.731, 0.269]
    """

    name: ClassVar[str] = "temperature"

    temperature: Positive = 1.0
    status: Status = "unfitted"
    floor: Annotated[float, Within(0.0, 1.0, open_high=True)] = 0.0

    def __post_init__(self) -> None:
        check(self)

    @property
    def num_shapes(self) -> None:
        """None: it is valid for any number of shapes."""
        return

    def fit_logits(self, logits: ArrayLike, labels: ArrayLike, weights: Floats | None = None) -> TemperatureScaling:
        """See :meth:`Calibration.fit`: the maximum-likelihood temperature, by safeguarded Newton steps in log β.

        The relative error is about 1e-15 for logits of any scale.

        >>> TemperatureScaling().fit([[0.0, 1e-300], [0.0, 1e-300], [0.0, 1e-300]], [1, 1, 0]).status
        'ok'
        """
        z, y = labelled_logits(logits, labels)
        with np.errstate(over="ignore", under="ignore"):
            largest = max(float(z.max()), -float(z.min()))
            factor = _SHIFT if largest < 1.0 / _SHIFT else 0.5  # halves: ±1e308 are 2e308 apart
            factor = 0.5 / _SHIFT if largest > _SHIFT else factor
            gaps = np.multiply(z.T, factor, order="C")
            gaps -= gaps.max(axis=0)
            return _fit(gaps, y, np.ones(len(y)) if weights is None else weights, 1.0 / factor)

    def log_proba(self, logits: ArrayLike) -> Floats:
        """See :meth:`Calibration.log_proba`."""
        scaled = log_softmax(logits, self.temperature)
        if self.floor == 0.0:
            return scaled
        return np.logaddexp(math.log1p(-self.floor) + scaled, math.log(self.floor) - math.log(scaled.shape[-1]))

    def objective(self, logits: ArrayLike, labels: ArrayLike) -> tuple[float, Floats]:
        """See :meth:`Calibration.objective`: mean NLL without the floor, and its derivative in log T.

        >>> scaling = TemperatureScaling(2.0, "ok")
        >>> [np.round(part, 3).tolist() for part in scaling.objective([[2.0, 0.0], [2.0, 0.0]], [0, 1])]
        [0.813, [-0.231]]
        """
        z, y = labelled_logits(logits, labels)
        log_probs = TemperatureScaling(self.temperature, self.status).log_proba(z)
        with np.errstate(over="ignore", under="ignore"):
            at_label = np.take_along_axis(log_probs, y[:, None], axis=1)
            excess = log_probs - at_label  # β (z - z_label)
            slope = (np.exp(log_probs) * np.maximum(excess, -_LARGEST)).sum(axis=1)
            return 0.0 - float(at_label.mean()), np.array([-slope.mean()])


def _fit(gaps: Floats, labels: NDArray[np.intp], weights: Floats, unit: float) -> TemperatureScaling:
    """Fit to gaps ``(K, n)`` of the logits below the largest in their row, in units of ``unit`` logits."""
    num_rows, total = gaps.shape[1], float(weights.sum())
    scale = -float(gaps.min())
    if scale == 0.0:
        return TemperatureScaling(1.0, "uninformative")
    label_gap = float(np.average(gaps[labels, np.arange(num_rows)], weights=weights))
    flat_slope = float(np.average(gaps.mean(axis=0), weights=weights)) - label_gap  # at β = 0
    if flat_slope >= -_ROUNDING * scale:
        status: Status = "uninformative" if flat_slope <= _ROUNDING * scale else "anti_informative"
        return TemperatureScaling(_representable(scale * _EXTREME * unit), status)
    if label_gap == 0.0:
        return TemperatureScaling(_representable(scale / _EXTREME * unit), "separable", 1.0 / (total + 2))
    beta = 1.0 / scale
    if num_rows > 2 * _ENOUGH:
        some = slice(None, None, num_rows // _ENOUGH)
        part = np.ascontiguousarray(gaps[:, some])
        part_gap = np.average(part[labels[some], np.arange(part.shape[1])], weights=weights[some])
        beta = _best_beta(part, weights[some], float(part_gap), beta)
    return TemperatureScaling(_representable(unit / _best_beta(gaps, weights, label_gap, beta)), "ok")


def _best_beta(gaps: Floats, weights: Floats, label_gap: float, beta: float) -> float:
    """The root of the slope, from an initial value; an end of the range if there is no root in it."""
    (low, high), at = _LOG_BETA, math.log(beta)
    before, stride = math.inf, 1.0
    for _ in range(200):
        beta = math.exp(at)
        mean, variance = _moments(gaps, weights, beta)
        excess = beta * label_gap - mean  # -β times the slope
        if excess == 0.0:
            break
        low, high = (at, high) if excess > 0.0 else (low, at)
        step = excess / variance if variance > 0.0 else math.copysign(math.inf, excess)  # relative to β
        step = math.log1p(step) if step > 0.0 else step
        if abs(step) < 1e-9:  # the error is of the order of its square
            return beta * math.exp(step)
        if abs(step) > 0.5 * before or not low < at + step < high:
            if low > _LOG_BETA[0] and high < _LOG_BETA[1]:
                step = 0.5 * (low + high) - at
            else:
                step, stride = math.copysign(stride, excess), 2.0 * stride
        proposal = min(max(at + step, low), high)
        if proposal == at:
            break
        at, before = proposal, abs(step)
    return beta


def _moments(gaps: Floats, weights: Floats, beta: float) -> tuple[float, float]:
    """Weighted mean over rows of E[u] and of Var[u] under the softmax of u = β · gaps."""
    num_shapes, num_rows = gaps.shape
    scaled, powers = np.empty((2, num_shapes, min(num_rows, _BLOCK)))
    total = spread = 0.0
    for first in range(0, num_rows, _BLOCK):
        block = gaps[:, first : first + _BLOCK]
        u, w = scaled[:, : block.shape[1]], powers[:, : block.shape[1]]
        of_row = weights[first : first + _BLOCK]
        np.multiply(block, beta, out=u)
        np.maximum(u, _VANISHING, out=u)
        np.exp(u, out=w)
        sums = w.sum(axis=0)
        w *= u
        mean = w.sum(axis=0)
        w *= u
        mean /= sums
        total += float((mean * of_row).sum())
        square = w.sum(axis=0)
        square /= sums
        mean *= mean
        square -= mean
        spread += float((square * of_row).sum())
    every = float(weights.sum())
    return total / every, spread / every


def _representable(temperature: float) -> float:
    return min(max(temperature, _LEAST), _LARGEST)
