"""What the functions of this package, and of :mod:`belief.metrics`, accept: checked once, in the same words."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.problem import Floats

LARGEST_VALUE = 1e150  # sums of a million larger ones, or their squares, overflow


def checked_values(name: str, values: ArrayLike) -> Floats:
    """The values as float64, if each is finite and at most 1e150 in size.

    Args:
        name: what an error calls them.
        values: numbers, of any shape.

    Raises:
        ValueError: NaN, infinite or beyond ±1e150; names the first such place.

    >>> checked_values("costs", [1, 2]).tolist()
    [1.0, 2.0]
    """
    x = np.asarray(values, np.float64)
    bad = ~(np.abs(x) <= LARGEST_VALUE)
    if bad.any():
        place = tuple(np.argwhere(bad)[0].tolist())
        raise ValueError(f"{name} must be finite and within ±{LARGEST_VALUE:g}, got {x[place]} at {list(place)}")
    return x


def checked_outcomes(name: str, outcomes: ArrayLike) -> NDArray[np.bool_]:
    """Right or wrong, one an episode, as booleans; numbers that are all 0 or 1 will do.

    Args:
        name: what an error calls them.
        outcomes: ``(n,)``, n ≥ 1.

    Raises:
        ValueError: empty, not one-dimensional, or something other than 0 and 1; names the first such row.

    >>> checked_outcomes("first", [1, 0]).tolist()
    [True, False]
    """
    x = np.asarray(outcomes)
    if x.ndim != 1 or x.size == 0:
        raise ValueError(f"{name} must hold one outcome an episode, at least one; got shape {x.shape}")
    bad = ~((x == 0) | (x == 1))
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(f"{name} must be right (1) or wrong (0), got {x[row]} in row {row}")
    return x.astype(np.bool_)


def require_fraction(name: str, value: float) -> None:
    """Refuse what does not lie strictly between 0 and 1, such as a confidence given in percent.

    Raises:
        ValueError: names the value.

    >>> require_fraction("confidence", 95)
    Traceback (most recent call last):
    ValueError: confidence must lie in (0, 1), got 95
    """
    if not 0.0 < value < 1.0:
        raise ValueError(f"{name} must lie in (0, 1), got {value}")


def require_resamples(num_resamples: int) -> None:
    """Refuse a number of resamples that is no positive integer.

    Raises:
        ValueError: names the number.

    >>> require_resamples(0)
    Traceback (most recent call last):
    ValueError: num_resamples must be an integer ≥ 1, got 0
    """
    if not isinstance(num_resamples, int | np.integer) or num_resamples < 1:
        raise ValueError(f"num_resamples must be an integer ≥ 1, got {num_resamples}")
