"""What calibrations accept: finite logits of any scale, and integer labels; everything else is named and refused."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.problem import Floats


def finite_logits(logits: ArrayLike) -> Floats:
    """Logits as float64, ``(..., K)``.

    Raises:
        ValueError: they are empty, or one is NaN or infinite; the message names its row.

    >>> finite_logits([[1, 2]])
    array([[1., 2.]])
    """
    with np.errstate(over="ignore"):  # a long double may become infinite, and is then refused
        z = np.asarray(logits, np.float64)
    if z.ndim == 0 or z.size == 0:
        raise ValueError(f"need logits (..., K), none of the axes empty; got shape {z.shape}")
    if not (np.isfinite(z.max()) and np.isfinite(z.min())):
        row = tuple(np.argwhere(~np.isfinite(z))[0, :-1].tolist())
        where = f" in row {row[0] if len(row) == 1 else row}" if row else ""
        raise ValueError(f"logits{where} are not finite: {z[row].tolist()}")
    return z


def labelled_logits(logits: ArrayLike, labels: ArrayLike) -> tuple[Floats, NDArray[np.intp]]:
    """Logits ``(n, K)`` and labels ``(n,)``, checked.

    Raises:
        ValueError: empty input, NaN or infinite logits, labels out of range, shapes that do not fit.

    >>> labelled_logits([[1.0, 2.0]], [1])
    (array([[1., 2.]]), array([1]))
    """
    shape, y = np.shape(logits), np.asarray(labels)
    if len(shape) != 2 or 0 in shape or y.shape != shape[:1]:
        raise ValueError(f"need logits (n, K) and labels (n,) with n ≥ 1, got {shape} and {y.shape}")
    z = finite_logits(logits)
    if not np.issubdtype(y.dtype, np.integer):
        raise ValueError(f"labels must be integers in [0, {shape[1]}), got {y.dtype}")
    if y.min() < 0 or y.max() >= shape[1]:
        row = int(np.argmax((y < 0) | (y >= shape[1])))
        raise ValueError(f"labels must be integers in [0, {shape[1]}), got {y[row]} in row {row}")
    return z, y.astype(np.intp, copy=False)
