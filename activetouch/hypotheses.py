"""Evenly spread hypotheses of an object's orientation and size: low-discrepancy sequences, the same on every machine.

>>> rotations(1000).shape, bool(np.allclose(rotations(1000).mean(axis=0), 0.0, atol=0.01))   # as Haar measure has it
((1000, 3, 3), True)
>>> sizes(4, 0.9, 1.1).round(3).tolist()
[1.0, 0.924, 1.047, 0.971]
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_PHI = np.sqrt(2.0)
_PSI = 1.533751168755204288118041  # the root of ψ⁴ = ψ + 4 (Alexa 2022)
_GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0


def quaternions(num: int) -> Floats:
    """Unit quaternions ``wxyz`` that cover all orientations evenly, ``(num, 4)``: super-Fibonacci spirals.

    M. Alexa: Super-Fibonacci Spirals: Fast, Low-Discrepancy Sampling of SO(3). CVPR 2022.

    Args:
        num: how many; all change with it.

    Raises:
        ValueError: ``num`` is less than 1.
    """
    if num < 1:
        raise ValueError(f"num must be at least 1, got {num}")
    place = np.arange(num) + 0.5
    inner, outer = np.sqrt(place / num), np.sqrt(1.0 - place / num)
    alpha, beta = 2.0 * np.pi * place / _PHI, 2.0 * np.pi * place / _PSI
    return np.stack([inner * np.sin(alpha), inner * np.cos(alpha), outer * np.sin(beta), outer * np.cos(beta)], axis=1)


def rotations(num: int) -> Floats:
    """The rotation matrices of :func:`quaternions`, ``(num, 3, 3)``."""
    w, x, y, z = quaternions(num).T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1),
        ],
        axis=1,
    )


def sizes(num: int, low: float, high: float) -> Floats:
    """Sizes that cover ``[low, high]`` evenly, ``(num,)``: multiples of the golden ratio, modulo 1.

    Args:
        num: how many; the first are the same for every ``num``.
        low: smallest size.
        high: largest size.

    Raises:
        ValueError: ``low`` exceeds ``high``.
    """
    if not low <= high:
        raise ValueError(f"low must not exceed high, got {low} and {high}")
    return low + (high - low) * ((0.5 + _GOLDEN * np.arange(num)) % 1.0)
