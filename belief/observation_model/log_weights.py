"""Sums over the log weights of hypotheses, which are ``(..., K, N)``: N hypotheses of each of K shapes.

Largest terms are subtracted first, so nothing overflows. Sums over many hypotheses are in single precision where that
is twice as fast and an error of 1e-6 does not matter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from belief.validation import Floats

Floats32 = NDArray[np.float32]

_LEAST_LOG = -60.0  # of an outcome's probability relative to the largest; smaller numbers would be slow


def log_means(log_weights: Floats) -> Floats:
    """Log mean weight over the hypotheses of each shape, ``(..., K)``."""
    largest = log_weights.max(axis=-1, keepdims=True)
    shares = log_weights - largest
    return np.asarray(largest[..., 0] + np.log(np.exp(shares, out=shares).sum(axis=-1) / shares.shape[-1]))


def misfit(scores: NDArray[np.floating], before: Floats, after: Floats) -> Floats:
    """How much better a touch predicts itself than the weights before it do, ``(...)`` [nats].

    That is log Σ_i p(i | o) p(o | i) - log Σ_i p(i | before) p(o | i) over all hypotheses i, from the touch's
    ``scores (..., K, N)`` and the log mean weights ``(..., K)`` of each shape before it and with its scores added.
    """
    flat = scores.reshape(*scores.shape[:-2], -1)
    most = flat.max(axis=-1)
    shares = np.exp(flat - most[..., None])
    alone = np.log(np.square(shares).sum(axis=-1)) - np.log(shares.sum(axis=-1)) + most
    return np.asarray(alone - _log_total(after) + _log_total(before))


def largest_posterior(log_likelihood: Floats) -> Floats:
    """Largest posterior of a shape under a uniform prior: over the last axis of log likelihoods ``(..., K)``."""
    return np.asarray(np.exp(log_likelihood.max(axis=-1) - _log_total(log_likelihood)))


def bounded_softmax(scores: Floats32) -> Floats32:
    """Probabilities over the last axis; small ones are limited, which keeps sums with them fast."""
    scores = scores - scores.max(axis=-1, keepdims=True)
    np.exp(np.maximum(scores, _LEAST_LOG, out=scores), out=scores)
    scores /= scores.sum(axis=-1, keepdims=True)
    return scores


def log_sums(scores: Floats32) -> Floats32:
    """Log of the sum of exponentials of scores ``(n, K, N)``, ``(n,)``; overwrites the scores."""
    largest = scores.max(axis=(1, 2))
    scores -= largest[:, None, None]
    np.exp(np.maximum(scores, _LEAST_LOG, out=scores), out=scores)
    return np.asarray(largest + np.log(scores.sum(axis=(1, 2))))


def some_hypotheses(log_weights: Floats, number: int) -> tuple[NDArray[np.int64], Floats]:
    """Indices and weights of at most ``number`` hypotheses of each shape, ``(K, H)`` each.

    These are all if there are no more; otherwise, by systematic resampling, a hypothesis of weight w appears ``number``
    times w times, rounded up or down.

    >>> chosen, weights = some_hypotheses(np.log([[0.5, 0.25, 0.25]]), 2)
    >>> chosen.tolist(), weights.tolist()
    ([[0, 1]], [[0.5, 0.5]])
    """
    probs = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
    num_shapes, num_hypotheses = probs.shape
    if num_hypotheses <= number:
        chosen = np.tile(np.arange(num_hypotheses), (num_shapes, 1))
        return chosen, probs / probs.sum(axis=1, keepdims=True)
    cumulative = probs.cumsum(axis=1)
    places = (np.arange(number) + 0.5) / number
    chosen = np.stack([row.searchsorted(places * row[-1]) for row in cumulative])
    return chosen, np.full(chosen.shape, 1.0 / number)


def _log_total(logs: Floats) -> Floats:
    """Log of the sum of exponentials over the last axis."""
    largest = logs.max(axis=-1)
    return np.asarray(largest + np.log(np.exp(logs - largest[..., None]).sum(axis=-1)))
