r"""Bayes' rule and information, as pure functions of arrays; any leading axes are batch.

    log p(y | o) = log p(y) + log p(o | y) - log p(o),    log p(o) = logsumexp over y of the first two terms.

Everything stays in logarithms, so a likelihood of 1e-300 or a logit of 1e4 is an ordinary number.

    >>> import numpy as np
    >>> log_prior = np.log([0.5, 0.5])
    >>> log_posterior, log_evidence = update(log_prior, np.log([0.8, 0.2]))
    >>> np.exp(log_posterior).round(3), np.exp(log_evidence).round(3)
    (array([0.8, 0.2]), np.float64(0.5))
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import entr

from belief.errors import ImpossibleObservation
from belief.problem import Floats

_SUM_TOLERANCE = 2e-3  # a row of probabilities in float16 sums to one within this


def update(log_prior: ArrayLike, log_likelihood: ArrayLike) -> tuple[Floats, Floats]:
    """Posterior over shapes, and the evidence, in logarithms.

    Args:
        log_prior: log p(y), ``(..., K)``; every row's probabilities sum to one (float16 rows are renormalised).
        log_likelihood: log p(o | y), ``(..., K)``; any finite value or -inf.

    Returns:
        log p(y | o), ``(..., K)``, and log p(o), ``(...,)``.

    Raises:
        ValueError: NaN, +inf, an empty array, shapes that do not fit, a prior that does not sum to one.
        ImpossibleObservation: some row has likelihood zero for every shape its prior still believes in.
    """
    prior, likelihood = np.asarray(log_prior, np.float64), np.asarray(log_likelihood, np.float64)
    prior, likelihood = _broadcast(prior, likelihood)
    _require(~np.isnan(likelihood) & (likelihood != np.inf), likelihood, "log_likelihood", "NaN or +inf")
    prior = normalise_log_probs(prior, "log_prior")
    believed = prior > -np.inf
    # Shifting by the best believed shape keeps the sums finite for log-likelihoods up to the largest float.
    best = np.max(np.where(believed, likelihood, -np.inf), axis=-1, keepdims=True)
    impossible = np.isneginf(best[..., 0])
    if impossible.any():
        row = tuple(int(i) for i in np.argwhere(impossible)[0])
        raise ImpossibleObservation(
            f"the observation{_at(row)} has zero likelihood under every shape still believed in: "
            f"prior {np.exp(prior[row]).round(6).tolist()}, log-likelihood {likelihood[row].tolist()}. "
            "A smoothed observation model never assigns zero."
        )
    with np.errstate(over="ignore"):  # a difference beyond the largest float is -inf, which is right
        joint = prior + np.where(believed, likelihood - best, -np.inf)
    log_evidence = np.logaddexp.reduce(joint, axis=-1, keepdims=True)
    return joint - log_evidence, (log_evidence + best)[..., 0]


def entropy(probs: ArrayLike, axis: int = -1) -> Floats:
    """Entropy of distributions along an axis, in nats; in ``[0, log K]``."""
    return np.asarray(entr(np.asarray(probs, np.float64)).sum(axis=axis))


def expected_information_gain(belief: ArrayLike, outcome_probs: ArrayLike) -> Floats:
    """Mutual information between the shape and the outcome, for each pose, in nats.

    I(y; o | pose) = H(o | pose) - sum_k b_k H(o | pose, y = k)          # Cover & Thomas, section 2.4

    Args:
        belief: b, ``(..., K)``, sums to one.
        outcome_probs: p(o | pose, y), ``(P, K, M)``, sums to one over the last axis.

    Returns:
        ``(..., P)``, each in ``[0, H(belief)]``; zero for a pose whose outcome ignores the shape.
    """
    b, table = np.asarray(belief, np.float64), np.asarray(outcome_probs, np.float64)
    predictive = np.einsum("...k,pkm->...pm", b, table)  # (..., P, M)
    gain = entropy(predictive) - np.einsum("...k,pk->...p", b, entropy(table))
    return np.maximum(gain, 0.0)  # rounding can leave -1e-17


def target_information_gain(belief: ArrayLike, outcome_probs: ArrayLike, target: int) -> Floats:
    """Mutual information between "this is the target" and the outcome, for each pose, in nats.

    The search needs to know one bit, not which of the other shapes it is touching.

    Args:
        belief: b, ``(..., K)``, sums to one.
        outcome_probs: p(o | pose, y), ``(P, K, M)``.
        target: index of the shape sought.

    Returns:
        ``(..., P)``, each in ``[0, log 2]`` and at most the gain about the full shape.
    """
    b, table = np.asarray(belief, np.float64), np.asarray(outcome_probs, np.float64)
    joint = b[..., None, :, None] * table  # (..., P, K, M)
    hit = joint[..., target, :]  # (..., P, M)
    miss = joint.sum(axis=-2) - hit
    miss = np.maximum(miss, 0.0)
    bit = np.stack([b[..., target], 1.0 - b[..., target]], axis=-1)  # (..., 2)
    # I = H(bit) + H(o) - H(bit, o)
    gain = entropy(bit)[..., None] + entropy(hit + miss) - entropy(hit) - entropy(miss)
    return np.maximum(gain, 0.0)


def normalise_log_probs(log_probs: Floats, name: str = "log_probs") -> Floats:
    """Log probabilities whose rows sum to one exactly, from rows that nearly do.

    Raises:
        ValueError: NaN, a positive logarithm, or a row that does not sum to one within float16's rounding.
    """
    _require(~np.isnan(log_probs) & (log_probs < _SUM_TOLERANCE), log_probs, name, "NaN or a probability above one")
    log_total = np.logaddexp.reduce(log_probs, axis=-1, keepdims=True)
    near_one = np.abs(np.expm1(log_total)) <= _SUM_TOLERANCE
    _require(np.broadcast_to(near_one, log_probs.shape), log_probs, name, "probabilities that do not sum to one")
    return np.asarray(log_probs - log_total)


def _broadcast(prior: Floats, likelihood: Floats) -> tuple[Floats, Floats]:
    if prior.ndim == 0 or likelihood.ndim == 0 or prior.shape[-1] != likelihood.shape[-1] or prior.size == 0:
        raise ValueError(
            f"log_prior and log_likelihood need the same, non-empty last axis of shapes, got {prior.shape} "
            f"and {likelihood.shape}"
        )
    wide_prior, wide_likelihood = np.broadcast_arrays(prior, likelihood)
    if wide_prior.size == 0:
        raise ValueError(f"nothing to update: log_prior is {prior.shape}, log_likelihood {likelihood.shape}")
    return wide_prior, wide_likelihood


def _require(valid: np.ndarray, values: Floats, name: str, cause: str) -> None:
    if not valid.all():
        row = tuple(int(i) for i in np.argwhere(~valid)[0][:-1])
        raise ValueError(f"{name}{_at(row)} holds {cause}: {values[row].tolist()}")


def _at(row: tuple[int, ...]) -> str:
    return f" in row {row[0] if len(row) == 1 else row}" if row else ""
