"""Evidence for each shape from several touches of one body, from log likelihoods of the touches under many bodies.

A body is an orientation at rest and a size. Given the body, touches are independent, so the joint evidence of the first
n touches for a shape is the mean over its bodies of the product of n likelihoods. The independent evidence is the
product of n means: it forgets that all touches are of one body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Log evidence of M objects' touches for each of K shapes, up to a constant that all shapes share.

    Attributes:
        joint: of the first n touches in order, all of one body, n from 1 to T, ``(M, T, K)``.
        single: of the touch in each pose alone, ``(M, P, K)``.
    """

    joint: NDArray[np.float64]
    single: NDArray[np.float64]

    def independent(self, orders: Ints) -> NDArray[np.float64]:
        """Log evidence of the first n touches as if each were of another body of the shape, ``(M, T, K)``.

        Args:
            orders: pose of each touch, ``(M, T)``.
        """
        return np.asarray(np.cumsum(np.take_along_axis(self.single, orders[:, :, None], axis=1), axis=1))

    @classmethod
    def of_shapes(cls, parts: Sequence[Evidence]) -> Evidence:
        """The evidence for all shapes from that for each."""
        return cls(*(np.concatenate(some, axis=2) for some in _columns(parts)))

    @classmethod
    def pooled(cls, parts: Sequence[Evidence]) -> Evidence:
        """The evidence of a bank from that of parts of it, of equally many bodies each."""
        return cls(*(_log_mean(np.stack(some), axis=0) for some in _columns(parts)))


def _columns(parts: Sequence[Evidence]) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    return [part.joint for part in parts], [part.single for part in parts]


def joint_log_likelihoods(log_likelihoods: Floats, orders: Ints) -> Evidence:
    """Evidence from the log likelihood of every touch under every body.

    Args:
        log_likelihoods: log p(touch in pose | body), up to a constant for each touch, ``(M, P, K, N)``.
        orders: pose of each touch, first to last, ``(M, T)``.
    """
    in_order = np.take_along_axis(log_likelihoods, orders[:, :, None, None], axis=1)
    return Evidence(_log_mean(np.cumsum(in_order, axis=1, dtype=np.float64)), _log_mean(log_likelihoods))


def _log_mean(logs: Floats, axis: int = -1) -> NDArray[np.float64]:
    """Log of the mean of exponentials; -inf where all are."""
    highest = logs.max(axis=axis, keepdims=True)
    highest = np.where(np.isfinite(highest), highest, 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.exp(logs - highest).mean(axis=axis)) + highest.squeeze(axis), dtype=float)


def log_posterior(log_likelihood: Floats) -> Floats:
    """Log posteriors ``(..., K)`` under a uniform prior over shapes."""
    return log_likelihood - np.logaddexp.reduce(log_likelihood, axis=-1, keepdims=True)
