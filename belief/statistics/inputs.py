"""Validation of the arguments of :mod:`belief.statistics` and :mod:`belief.metrics`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from belief.errors import InvalidArgument
from belief.problem import Floats
from belief.validation import unmasked

LARGEST_VALUE = 1e150  # sums of a million larger ones, or their squares, overflow


def checked_values(name: str, values: ArrayLike) -> Floats:
    """Numbers of any shape as float64, each finite and at most 1e150 in size.

    Raises:
        ValueError: masked, not numbers, NaN, infinite or beyond ±1e150; the message names the first such place.

    >>> checked_values("costs", [1, 2]).tolist()
    [1.0, 2.0]
    """
    x = unmasked(values, name)
    if x.dtype.kind not in "fiub":
        raise InvalidArgument(f"{name} must be numbers, got an array of {x.dtype}")
    x = x.astype(np.float64, copy=False)
    bad = ~(np.abs(x) <= LARGEST_VALUE)
    if bad.any():
        place = tuple(np.argwhere(bad)[0].tolist())
        raise ValueError(f"{name} must be finite and within ±{LARGEST_VALUE:g}, got {x[place]} at {list(place)}")
    return x


def checked_outcomes(name: str, outcomes: ArrayLike) -> NDArray[np.bool_]:
    """Outcomes of n ≥ 1 episodes as booleans, from booleans or numbers 0 and 1, ``(n,)``.

    Raises:
        ValueError: empty, not one-dimensional, or other values than 0 and 1; the message names the first such row.

    >>> checked_outcomes("first", [1, 0]).tolist()
    [True, False]
    """
    x = unmasked(outcomes, name)
    if x.dtype.kind not in "fiub":
        raise InvalidArgument(f"{name} must be right (1) or wrong (0), got an array of {x.dtype}")
    if x.ndim != 1 or x.size == 0:
        raise ValueError(f"{name} must hold one outcome per episode, at least one; got shape {x.shape}")
    bad = ~((x == 0) | (x == 1))
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(f"{name} must be right (1) or wrong (0), got {x[row]} in row {row}")
    return x.astype(np.bool_)


def require_fraction(name: str, value: float) -> None:
    """Check that an argument lies strictly between 0 and 1.

    Raises:
        InvalidArgument: it does not, such as a confidence in percent.

    >>> require_fraction("confidence", 95)
    Traceback (most recent call last):
    belief.errors.InvalidArgument: confidence must lie in (0, 1), got 95
    """
    if not isinstance(value, int | float | np.number) or not 0.0 < value < 1.0:
        raise InvalidArgument(f"{name} must lie in (0, 1), got {value!r}")


def normal_quantile(confidence: float) -> float:
    """The z for which a standard normal variable lies in [-z, z] with the probability ``confidence``.

    It is finite for any confidence below one.

    >>> round(normal_quantile(0.95), 2), round(normal_quantile(1 - 1e-16), 2)
    (1.96, 8.29)
    """
    upper = 0.5 + 0.5 * confidence
    return float(ndtri(upper)) if upper < 1.0 else -float(ndtri((1.0 - confidence) / 2.0))
