"""Validation of arguments: a ValueError names the argument, the row and the cause."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from numbers import Integral
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.constraints import FRACTION, MOST_COUNT, Choice, Within, require_rule
from belief.errors import InvalidArgument
from belief.naming import shown

Floats: TypeAlias = NDArray[np.float64]
SUM_TOLERANCE = 2e-3
"""Tolerance for sums of probabilities: twice the rounding error of a dozen probabilities in float16."""
MOST_REPEATED = 10**7
"""Largest count of what takes time or memory for each one, such as resamples, simulations or the objects of a scene."""
LARGEST_VALUE = 1e150  # sums of a million larger ones, or their squares, overflow
_MOST_POSES = 1000  # or the number of touches, if that is larger
_ROUNDING, _NORMAL = 1e-12, 1e-9  # of sums of what was computed, and of rows as users give them
_NEAR_ONE = 1e-5  # sums of rows that were meant as probabilities


def as_real(values: ArrayLike, name: str) -> NDArray[np.floating]:
    """An array of floats; a float type of at most 64 bits is kept, all others become float64."""
    array = unmasked(values, name)
    if array.dtype.kind not in "fiu":
        raise InvalidArgument(f"{name} must hold real numbers, got an array of {array.dtype}")
    if array.dtype.kind == "f" and array.itemsize <= 8:
        return array
    with np.errstate(over="ignore"):  # a number beyond float64 becomes infinite
        return array.astype(np.float64)


def warn_of_probs(values: NDArray[np.floating], name: str, instead: str, callers: int = 3) -> None:
    """A UserWarning, so many callers up, about logarithms ``(..., K)`` that look like probabilities or percentages."""
    if values.ndim == 0 or values.size == 0 or values.shape[-1] < 2:
        return
    rows = values.reshape(-1, values.shape[-1])
    near = SUM_TOLERANCE if values.itemsize < 4 else _NEAR_ONE if len(rows) > 1 else _NEAR_ONE / 20
    for total, words in ((1.0, "one, as probabilities"), (100.0, "100, as percentages")):
        if all(_sums_to(total, some, near) for some in (rows[:1], rows)):  # one row usually tells
            warnings.warn(f"{name} has no negative number and sums to {words} do; {instead}", stacklevel=1 + callers)


def _sums_to(total: float, rows: NDArray[np.floating], near: float) -> bool:
    """Whether rows have no negative number and sum to a total, or do so before rounding to two to four decimals."""
    with np.errstate(over="ignore", invalid="ignore"):
        if not (rows.min() >= 0.0 and rows.max() <= 2.0 * total):
            return False
        parts = rows.astype(np.float64) / total
        off = np.abs(parts.sum(axis=1) - 1.0).max()
        return off <= near or any(
            off < 0.499 * rows.shape[1] / step and np.abs(parts * step - np.round(parts * step)).max() < 1e-3
            for step in (100.0, 1_000.0, 10_000.0)
        )


def warn_of_one_shape(labels: NDArray[np.integer], num_shapes: int, callers: int = 2) -> None:
    """A UserWarning, so many callers up, about labels that are all the same."""
    if num_shapes > 1 and labels.size and (labels == labels[0]).all():
        warnings.warn(
            f"all {labels.size} labels are {labels[0]}: touches of one shape tell nothing about the other "
            f"{num_shapes - 1}; add touches of these",
            stacklevel=1 + callers,
        )


def as_logs(name: str, logs: ArrayLike | None, keyword: str, plain: ArrayLike | None) -> Floats:
    """Logarithms ``(..., K)``, given as such or as the ``plain`` numbers, finite and not negative; zero becomes -inf.

    Non-negative rows that sum to one and are given as logarithms cause a UserWarning: they look like probabilities.
    """
    if (logs is None) == (plain is None):
        given = "neither" if logs is None else "both"
        raise InvalidArgument(f"either {name} or {keyword}=... must be given, got {given}")
    if plain is None:
        given_logs = as_real(np.asarray([]) if logs is None else logs, name)
        warn_of_probs(given_logs, name, f"pass probabilities as {keyword}=...")
        return np.asarray(given_logs, np.float64)
    values = np.asarray(as_real(plain, keyword), np.float64)
    require(np.isfinite(values) & (values >= 0.0), np.atleast_1d(values), keyword, "NaN, infinity or a negative number")
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(values))


def unmasked(values: ArrayLike, name: str) -> NDArray[Any]:
    """An array of any type; raises InvalidArgument for a masked entry."""
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        place = np.argwhere(np.ma.getmaskarray(values))[0].tolist()
        raise InvalidArgument(f"{name} must not be masked, got a masked entry at {place}")
    return np.asarray(values)


def checked_indices(name: str, values: ArrayLike, size: int) -> NDArray[np.int64]:
    """Integers in [0, size), ``(n,)``, as int64."""
    indices = unmasked(values, name)
    if not np.issubdtype(indices.dtype, np.integer):
        hint = "; np.unique(names, return_inverse=True) numbers names" if indices.dtype.kind in "OSU" else ""
        raise InvalidArgument(f"{name} must be integers in [0, {size}), got {indices.dtype}{hint}")
    wrong = (indices < 0) | (indices >= size)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InvalidArgument(f"{name} must be integers in [0, {size}), got {indices[row]}{at((row,))}")
    return indices.astype(np.int64)


def require_count(name: str, value: Any, least: int = 1, most: int = MOST_COUNT) -> None:
    """Raise InvalidArgument unless an argument is an integer in [least, most]."""
    require_rule(name, value, Within(least, most))


def are_finite(*values: Any) -> bool:
    """Whether values are numbers that are finite as floats, which NaN and integers beyond the largest float are not."""
    try:
        return all(map(math.isfinite, values))
    except (OverflowError, TypeError):
        return False


def require_index(name: str, value: object, size: int) -> None:
    """Raise InvalidArgument unless an argument is an integer in [0, size)."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not 0 <= int(value) < size:
        raise InvalidArgument(f"{name} must be an integer in [0, {size}), got {shown(value)}")


def require_number(name: str, value: Any, least: float, most: float) -> None:
    """Raise InvalidArgument unless an argument is a real number in [least, most]."""
    require_rule(name, value, Within(float(least), float(most)))


def require_choice(name: str, value: object, choices: Sequence[str]) -> None:
    """Raise InvalidArgument unless an argument is one of several strings."""
    require_rule(name, value, Choice(tuple(choices)))


def require(
    valid: NDArray[np.bool_], values: NDArray[np.floating], name: str, cause: str, row: tuple[int, ...] = ()
) -> None:
    """Raise InvalidArgument with the cause and the first row that is not valid, if there is one.

    ``valid`` is a mask of the numbers ``(..., K)`` or of the rows ``(..., 1)``; ``row`` is the index of ``values`` in
    the argument ``name``.
    """
    if not valid.all():
        first = tuple(int(i) for i in np.argwhere(~valid)[0][:-1])
        raise InvalidArgument(f"{name}{at(row + first)} holds {cause}: {values[first].tolist()}")


def at(row: tuple[int, ...]) -> str:
    """Words for an index: " in row 3 (from 0)", " in row (3, 1) (from 0)", or an empty string for the index ()."""
    return f" in row {row[0] if len(row) == 1 else row} (from 0)" if row else ""


def renormalised(probs: Floats) -> Floats:
    """Checked probabilities ``(..., K)``, of which each row is divided by its sum unless that is one up to rounding.

    Probabilities that are read from a file therefore keep their last bit.
    """
    totals = probs.sum(axis=-1, keepdims=True)
    off = np.abs(totals - 1.0) > _ROUNDING
    return probs / np.where(off, totals, 1.0) if off.any() else probs


def normalise_log_probs(log_probs: ArrayLike, name: str = "log_probs", row: tuple[int, ...] = ()) -> Floats:
    """Log probabilities ``(..., K)``, normalised where the probabilities sum to one within :data:`SUM_TOLERANCE`.

    ``name`` and ``row`` are the argument and the index of these rows in it, for the error.
    """
    values = np.asarray(as_real(log_probs, name), np.float64)
    require(~np.isnan(values) & (values < SUM_TOLERANCE), values, name, "NaN or a probability above one", row)
    log_total = np.logaddexp.reduce(values, axis=-1, keepdims=True)
    near_one = np.abs(np.expm1(log_total)) <= SUM_TOLERANCE
    require(near_one, values, name, "probabilities that do not sum to one", row)
    return np.asarray(values - np.where(np.abs(log_total) > _NORMAL, log_total, 0.0))


def normalise_probs(probs: ArrayLike, name: str = "probs", axis: int = -1, row: tuple[int, ...] = ()) -> Floats:
    """Probabilities, normalised along an axis where they sum to one within :data:`SUM_TOLERANCE`.

    Those that sum to one within 1e-9 are left as they are: rounding would move 0.4 across the edge of a bin.
    """
    values = np.asarray(as_real(probs, name), np.float64)
    if values.ndim == 0 or values.size == 0:
        raise InvalidArgument(f"{name} needs at least one axis, none of them empty, got shape {values.shape}")
    with np.errstate(over="ignore", invalid="ignore"):
        totals = np.add.reduce(values, axis=axis, keepdims=True)
        off = np.abs(totals - 1.0)
    if not (np.maximum.reduce(off, axis=None) <= SUM_TOLERANCE and np.minimum.reduce(values, axis=None) >= 0.0):
        last = np.moveaxis(values, axis, -1)
        require(last >= 0.0, last, name, "NaN or a probability below zero", row)
        unequal = "probabilities that do not sum to one (divide rounded ones by their sum)"
        require(np.moveaxis(off, axis, -1) <= SUM_TOLERANCE, last, name, unequal, row)
    return np.minimum(values / np.where(off > _NORMAL, totals, 1.0), 1.0)


def pose_count(poses: NDArray[np.integer], num_poses: int | None) -> int:
    """P: as given, or one more than the largest of one or more poses."""
    largest, most = int(poses.max()), max(_MOST_POSES, poses.size)
    if num_poses is not None:
        require_count("num_poses", num_poses, most=most)
    if poses.min() < 0 or largest >= (most if num_poses is None else num_poses):
        touch = int(poses.argmin() if poses.min() < 0 else poses.argmax())
        known = f"{poses.size} touches are fitted in at most {most} poses"
        if num_poses is not None:
            known = f"num_poses is {num_poses}"
        raise InvalidArgument(f"touch {touch} has pose {poses[touch]}, {known}")
    return largest + 1 if num_poses is None else int(num_poses)


def finite_logits(logits: ArrayLike) -> Floats:
    """Logits as float64, ``(..., K)``."""
    with np.errstate(over="ignore"):  # a long double may become infinite, which is an error
        z = np.asarray(as_real(logits, "logits"), np.float64)
    if z.ndim == 0 or z.size == 0:
        raise InvalidArgument(f"need logits (..., K), none of the axes empty; got shape {z.shape}")
    if not (np.isfinite(z.max()) and np.isfinite(z.min())):
        row = tuple(np.argwhere(~np.isfinite(z))[0, :-1].tolist())
        raise InvalidArgument(f"logits{at(row)} are not finite: {z[row].tolist()}")
    return z


def log_sum(logs: Floats, axis: int | None = None) -> Floats:
    """Log of the sum of exponentials along an axis, or of all; faster than ``scipy.special.logsumexp``."""
    top = logs.max(axis=axis, keepdims=True)
    top[top == -np.inf] = 0.0
    with np.errstate(divide="ignore", over="ignore"):
        scaled = logs - top
        return np.asarray(np.log(np.exp(scaled, out=scaled).sum(axis=axis)) + top.squeeze(axis))


def log_softmax(logits: ArrayLike, temperature: float = 1.0) -> Floats:
    """Logarithms of the softmax of logits ``(..., K)``, finite numbers of any size, divided by a temperature."""
    z = finite_logits(logits)
    with np.errstate(over="ignore", under="ignore"):
        scaled = z / 2 - z.max(axis=-1, keepdims=True) / 2  # halves: the difference of ±1e308 stays finite
        scaled /= temperature
        scaled *= 2
        np.maximum(scaled, -np.finfo(float).max, out=scaled)
        scaled -= np.log(np.exp(scaled).sum(axis=-1, keepdims=True))
    return scaled


def labelled_logits(logits: ArrayLike, labels: ArrayLike) -> tuple[Floats, NDArray[np.int64]]:
    """Logits ``(n, K)`` and labels ``(n,)``, checked."""
    shape, num_labels = np.shape(logits), np.shape(labels)
    if len(shape) != 2 or 0 in shape or num_labels != shape[:1]:
        raise InvalidArgument(f"need logits (n, K) and labels (n,) with n ≥ 1, got {shape} and {num_labels}")
    if shape[1] == 1 and set(np.unique(labels).tolist()) == {0, 1}:
        raise InvalidArgument(
            "logits have one column, and labels are 0 and 1: logits_from_probs makes two of a sigmoid's"
        )
    return finite_logits(logits), checked_indices("labels", labels, shape[1])


def checked_probs(probs: ArrayLike) -> Floats:
    """Predicted distributions ``(n, K)`` as float64, renormalised where they sum to one within 2e-3."""
    p = np.asarray(as_real(probs, "probs"), np.float64)
    if p.ndim != 2 or p.size == 0:
        raise InvalidArgument(f"need probs (n, K) with n ≥ 1 and K ≥ 1, got shape {p.shape}")
    return normalise_probs(p)


def checked_pair(probs: ArrayLike, labels: ArrayLike) -> tuple[Floats, NDArray[np.int64]]:
    """Predicted distributions ``(n, K)``, as from :func:`checked_probs`, and true shapes ``(n,)`` as int64."""
    p = checked_probs(probs)
    if np.shape(labels) != (len(p),):
        raise InvalidArgument(f"need probs (n, K) and labels (n,) with n ≥ 1, got {p.shape} and {np.shape(labels)}")
    return p, checked_indices("labels", labels, p.shape[1])


def checked_values(name: str, values: ArrayLike) -> Floats:
    """Numbers of any shape as float64, each finite and at most 1e150 in size."""
    x = unmasked(values, name)
    if x.dtype.kind not in "fiub":
        raise InvalidArgument(f"{name} must be numbers, got an array of {x.dtype}")
    x = x.astype(np.float64, copy=False)
    bad = ~(np.abs(x) <= LARGEST_VALUE)
    if bad.any():
        place = tuple(np.argwhere(bad)[0].tolist())
        raise InvalidArgument(f"{name} must be finite and within ±{LARGEST_VALUE:g}, got {x[place]} at {list(place)}")
    return x


def checked_outcomes(name: str, outcomes: ArrayLike) -> NDArray[np.bool_]:
    """Outcomes of n ≥ 1 episodes as booleans, from booleans or numbers 0 and 1, ``(n,)``."""
    x = unmasked(outcomes, name)
    if x.dtype.kind not in "fiub":
        raise InvalidArgument(f"{name} must be right (1) or wrong (0), got an array of {x.dtype}")
    if x.ndim != 1 or x.size == 0:
        raise InvalidArgument(f"{name} must hold one outcome per episode, at least one; got shape {x.shape}")
    bad = ~((x == 0) | (x == 1))
    if bad.any():
        row = int(np.argmax(bad))
        raise InvalidArgument(f"{name} must be right (1) or wrong (0), got {x[row]}{at((row,))}")
    return x.astype(np.bool_)


def require_fraction(name: str, value: float) -> None:
    """Check that an argument lies strictly between 0 and 1."""
    require_rule(name, value, FRACTION)
