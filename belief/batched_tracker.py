"""Follow what is known about many objects at once, each in its own episode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.bayes import update
from belief.errors import ImpossibleObservation
from belief.impossible_evidence import RAISE, ImpossiblePolicy, warn_of_zero_prior
from belief.problem import Floats
from belief.validation import as_real, normalise_probs

_LARGEST = np.finfo(np.float64).max


class BatchedBeliefTracker:
    """Bayes' filter for B objects that know nothing of each other.

    What :class:`belief.BeliefTracker` is for one object and a model, this is for arrays of log-likelihoods of single
    touches, independent given the shape. All sums are of float64 logarithms: a million touches stay within a milli-nat
    of exact summation, and certainty can be undone by contrary touches. Only a prior of zero is for ever.

    Args:
        prior_probs: belief about each object before the first touch, ``(B, K)``; rows sum to one.
        target: index of the shape sought, one or ``(B,)``, if any; only to warn where it has no chance.
        on_impossible: what to do when a touch contradicts everything still believed in.

    Raises:
        ValueError: the prior is not ``(B, K)``, empty, or no distribution; a target that is no shape.

    >>> tracker = BatchedBeliefTracker([[0.5, 0.5], [0.5, 0.5], [0.9, 0.1]])
    >>> _ = tracker.update(np.log([[0.8, 0.2], [0.3, 0.7]]), rows=[0, 2])      # nobody touched object 1
    >>> tracker.probs.round(3).tolist()
    [[0.8, 0.2], [0.5, 0.5], [0.794, 0.206]]
    >>> np.exp(tracker.log_evidence).round(3).tolist()
    [0.5, 1.0, 0.34]
    """

    def __init__(
        self,
        prior_probs: ArrayLike,
        *,
        target: int | Sequence[int] | NDArray[np.integer] | None = None,
        on_impossible: ImpossiblePolicy = RAISE,
    ) -> None:
        probs = normalise_probs(prior_probs, "prior_probs")
        if probs.ndim != 2:
            raise ValueError(f"prior_probs must be (B, K), got {probs.shape}")
        if target is not None:
            targets = np.broadcast_to(np.asarray(target), len(probs))
            if targets.dtype.kind not in "iu" or targets.min() < 0 or targets.max() >= probs.shape[1]:
                raise ValueError(f"target must be integers in [0, {probs.shape[1]}), got {target}")
            hopeless = np.flatnonzero(np.take_along_axis(probs, targets[:, None].astype(np.intp), axis=1)[:, 0] == 0.0)
            if hopeless.size:
                rows = f"the prior of {hopeless.size} of {len(probs)} rows, the first row {hopeless[0]}"
                warn_of_zero_prior(f"{targets[hopeless[0]]}", rows)
        with np.errstate(divide="ignore"):
            self._log_probs = np.log(probs)
        self._log_evidence = np.zeros(len(probs))
        self._on_impossible = on_impossible

    @property
    def log_probs(self) -> Floats:
        """Log posterior of every object, ``(B, K)``; a copy."""
        return self._log_probs.copy()

    @property
    def probs(self) -> Floats:
        """Posterior of every object, ``(B, K)``."""
        return np.exp(self._log_probs)

    @property
    def log_evidence(self) -> Floats:
        """Log probability of every object's touches so far, ``(B,)``; a copy."""
        return self._log_evidence.copy()

    def update(self, log_likelihood: ArrayLike, rows: ArrayLike | None = None) -> Floats:
        """Take in one touch of each of some objects.

        Args:
            log_likelihood: log p(touch | shape), ``(n, K)``; finite or -inf.
            rows: which objects were touched: ``(n,)`` different indices, or a mask ``(B,)`` with n true; by default
                all.

        Returns:
            Their log posteriors, ``(n, K)``.

        Raises:
            ValueError: NaN, +inf, no touch at all, a row that is none or comes twice, or shapes that do not fit.
            ImpossibleObservation: a touch contradicts everything still believed in, and the policy is to raise; it
                names the row of ``log_likelihood``. No belief has changed then, not in any row.
        """
        index = self._index(rows)
        likelihood = np.asarray(as_real(log_likelihood, "log_likelihood"), np.float64)
        prior = self._log_probs[index]
        if likelihood.shape != prior.shape:
            raise ValueError(f"log_likelihood must be {prior.shape} for these rows, got {likelihood.shape}")
        likelihood = self._on_impossible.temper(likelihood)
        try:
            log_posterior, log_evidence = update(prior, likelihood)
        except ImpossibleObservation as error:
            self._on_impossible.resolve(error)
            log_posterior, log_evidence = _update_what_is_possible(prior, likelihood)
        self._log_probs[index] = log_posterior
        with np.errstate(over="ignore"):
            total = self._log_evidence[index] + log_evidence
        self._log_evidence[index] = np.clip(total, -_LARGEST, _LARGEST)
        return log_posterior

    def _index(self, rows: ArrayLike | None) -> NDArray[np.intp]:
        every = np.arange(len(self._log_probs))
        if rows is None:
            return every
        try:
            index = np.atleast_1d(every[np.asarray(rows)])
        except IndexError as error:
            raise ValueError(f"rows must be indices below {len(every)} or a mask of that length: {error}") from error
        if index.ndim != 1 or len(np.unique(index)) != len(index):
            raise ValueError("rows must be one axis of different indices: two touches of an object are two updates")
        return index


def _update_what_is_possible(log_prior: Floats, log_likelihood: Floats) -> tuple[Floats, Floats]:
    impossible = ((log_prior == -np.inf) | (log_likelihood == -np.inf)).all(axis=1)
    log_posterior, log_evidence = update(log_prior, np.where(impossible[:, None], 0.0, log_likelihood))
    log_posterior[impossible], log_evidence[impossible] = log_prior[impossible], 0.0
    return log_posterior, log_evidence
