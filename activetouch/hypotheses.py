"""Evenly spread hypotheses of an object's orientation, size and proportions: low-discrepancy sequences.

>>> cover = quaternions(1000)
>>> bool(np.allclose(cover.T @ cover / 1000, np.eye(4) / 4, atol=0.01))        # as uniform orientations have it
True
>>> from activetouch.distributions import Uniform
>>> sizes(Uniform(0.9, 1.1), 4).round(2).tolist()
[1.0, 0.92, 1.05, 0.97]
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Distribution

Floats = NDArray[np.float64]

_PHI = np.sqrt(2.0)
_PSI = 1.533751168755204288118041  # the root of ψ⁴ = ψ + 4 (Alexa 2022)
_DRAWN = 4096  # numbers that stand for a distribution
_GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
_PLASTIC_ROOT = 0.7548776662466927  # 1 / ρ with ρ³ = ρ + 1


def quaternions(num: int) -> Floats:
    """Unit quaternions ``wxyz`` that cover all orientations evenly, ``(num, 4)``; all change with ``num``.

    M. Alexa: Super-Fibonacci Spirals: Fast, Low-Discrepancy Sampling of SO(3). CVPR 2022.
    """
    if num < 1:
        raise ValueError(f"num must be at least 1, got {num}")
    place = np.arange(num) + 0.5
    inner, outer = np.sqrt(place / num), np.sqrt(1.0 - place / num)
    alpha, beta = 2.0 * np.pi * place / _PHI, 2.0 * np.pi * place / _PSI
    return np.stack([inner * np.sin(alpha), inner * np.cos(alpha), outer * np.sin(beta), outer * np.cos(beta)], axis=1)


def sizes(distribution: Distribution, num: int) -> Floats:
    """Sizes that cover a distribution evenly, ``(num,)``: quantiles at multiples of the golden ratio, modulo 1."""
    return quantiles(distribution, kronecker(_GOLDEN, num))


def member_shares(num: int) -> Floats:
    """Places of hypotheses in a family of solids, whatever its shape, ``(num,)``, above 0 and below 1.

    They are evenly spread, and independent of :func:`sizes`. :meth:`activetouch.Scene.bodies` gives their solids.

    >>> member_shares(4).tolist()
    [0.625, 0.375, 0.125, 0.875]
    """
    return np.asarray((np.argsort(np.argsort(kronecker(_PLASTIC_ROOT, num))) + 0.5) / num)


def kronecker(step: float, num: int) -> Floats:
    """Numbers that cover [0, 1) evenly, ``(num,)``: multiples of a step, modulo 1; the first is 0.5."""
    return np.asarray((0.5 + step * np.arange(num)) % 1.0)


def roberts_steps(num: int) -> list[float]:
    """Steps of ``num`` sequences of :func:`kronecker` that together fill a box evenly (Roberts 2018).

    >>> np.round(roberts_steps(2), 4).tolist()
    [0.7549, 0.5698]
    """
    root = 1.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (num + 1.0))
    return [root**-power for power in range(1, num + 1)]


def quantiles(distribution: Distribution, shares: Floats) -> Floats:
    """Approximate quantiles of a distribution at ``shares (n,)`` in [0, 1], ``(n,)``."""
    rng = np.random.default_rng(0)
    return np.asarray(np.quantile([distribution.sample(rng) for _ in range(_DRAWN)], shares))


class Bodies(NamedTuple):
    """N hypotheses about an object of any shape.

    ``rests (N, 4)`` are orientations at rest, unit quaternions ``wxyz``; ``sizes (N,)`` are relative to the nominal
    size; ``shares (N,)`` are places in a family of solids (:func:`member_shares`).
    """

    rests: Floats
    sizes: Floats
    shares: Floats

    def take(self, some: slice | NDArray[np.int64]) -> Bodies:
        """Some of the hypotheses."""
        return Bodies(*(part[some] for part in self))
