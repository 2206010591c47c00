"""Outcomes of actions, given the class and a hidden context of the case: from arrays, or fitted to a table of cases.

Given class and context, the outcomes of different actions are independent; the context explains why they depend on each
other within a class. An action is a pose, its outcome the only feature of a touch; -1 is an outcome that is missing,
which is no evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.constraints import Within, check
from belief.errors import InvalidArgument
from belief.frozen import frozen
from belief.observation_model.model import ArrayModel, Reads
from belief.observation_model.outcome_mixture import OutcomeMixture
from belief.observation_model.outcome_table import OutcomeTable, merged, require_distributions
from belief.problem import Touch
from belief.touch_batch import TouchBatch
from belief.validation import SUM_TOLERANCE, Floats, as_real, renormalised

MISSING = -1
"""Outcome of an action that could not be carried out, or was not recorded."""


@dataclass(frozen=True, eq=False)
class ContextModel(ArrayModel):
    """p(outcome | action, class, context), and how frequent each context is in each class.

    A second try of an action has the outcome of the first one, unless the model says that tries are independent.

    Attributes:
        shape_labels: names of the K classes.
        probs: p(outcome | action, class, context), ``(P, K, H, M)``; without contexts ``(P, K, M)``. The last axis sums
            to one. An action with fewer than M outcomes gives the others probability zero.
        weights: p(context | class), ``(K, H)``; equal by default.
        sharpness: factor of all log-likelihoods, in (0, 1]; below 1 where outcomes depend on each other even within a
            context, so that stated probabilities are too large with 1.
        is_repeatable: whether another try of an action is independent given class and context, as a new reading is.

    Raises:
        ValueError: arrays that do not fit each other, or hold no probabilities.

    >>> model = ContextModel(("ill", "well"), np.array([[[0.9, 0.1], [0.2, 0.8]]]))     # one test, two outcomes
    >>> model.log_likelihood([Touch(0, features=np.array([0.0]))]).round(2).tolist()
    [-0.11, -1.61]
    >>> model.start().update(Touch(0, features=np.array([-1.0]))).log_likelihood.tolist()        # a missing outcome
    [0.0, 0.0]
    """

    name: ClassVar[str] = "context"
    reads: ClassVar[Reads] = "embeddings"
    last_in_file: ClassVar = ("probs",)

    shape_labels: tuple[str, ...]
    probs: Floats
    weights: Floats | None = None
    sharpness: Annotated[float, Within(0.0, 1.0, open_low=True)] = 1.0
    is_repeatable: bool = False

    def __post_init__(self) -> None:
        check(self)
        probs = np.array(as_real(self.probs, "probs"), np.float64)
        probs = probs[:, :, None] if probs.ndim == 3 else probs
        number = len(self.shape_labels)
        if probs.ndim != 4 or probs.size == 0 or probs.shape[1] != number:
            raise ValueError(
                f"probs of {number} classes must be (P, {number}, H, M) with no axis empty, got {probs.shape}"
            )
        has_contexts = probs.shape[2] > 1
        require_distributions(
            probs, lambda a, k, h: f"action {a}, class {self.shape_labels[k]!r}" + f", context {h}" * has_contexts
        )
        equal = np.full(probs.shape[1:3], 1.0 / probs.shape[2])
        weights = equal if self.weights is None else np.array(as_real(self.weights, "weights"), np.float64)
        if weights.shape != probs.shape[1:3] or not (weights.min() >= 0.0 and _sum_to_one(weights)):
            raise ValueError(
                f"weights must be probabilities of contexts in each class {probs.shape[1:3]}, got {weights}"
            )
        object.__setattr__(self, "probs", renormalised(probs))
        object.__setattr__(self, "weights", renormalised(weights))
        self.freeze()

    @property
    def num_poses(self) -> int:
        """P."""
        return self.probs.shape[0]

    def start(self) -> ContextEvidence:
        """See :class:`ArrayModel`."""
        return ContextEvidence(self, self._log_weights)

    def log_likelihood(self, touches: Sequence[Touch]) -> Floats:
        """See :class:`ArrayModel`."""
        evidence = self.start()
        for touch in touches:
            evidence = evidence.update(touch)
        return evidence.log_likelihood.copy()

    def log_likelihoods_of(self, cases: ArrayLike) -> Floats:
        """Log p(outcomes of a case | class), ``(n, K)``, of outcomes ``(n, P)``; -1 where missing.

        >>> model = ContextModel(("ill", "well"), np.array([[[0.9, 0.1], [0.2, 0.8]]]))
        >>> np.exp(model.log_likelihoods_of([[1], [-1]])).round(2).tolist()
        [[0.1, 0.8], [1.0, 1.0]]
        """
        return np.logaddexp.reduce(self._log_weights + log_products(self._log_probs, self.outcomes_of(cases)), axis=2)

    def outcomes_of(self, cases: ArrayLike) -> NDArray[np.int64]:
        """Outcomes of cases ``(n, P)``, checked."""
        found = np.asarray(cases)
        if found.ndim != 2 or found.shape[1] != self.num_poses or not np.isin(found, np.arange(-1, self._most)).all():
            raise InvalidArgument(
                f"outcomes of cases must be integers (n, {self.num_poses}), at most {self._most - 1}, -1 where missing"
            )
        return found.astype(np.int64)

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        """See :class:`ArrayModel`."""
        return np.stack([self.log_likelihood(batch.sequence(row)) for row in range(len(batch))])

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """See :class:`ArrayModel`; one context for each case."""
        weights = self._weights[shape]
        contexts = rng.choice(len(weights), len(poses), p=weights)
        cumulative = self.probs[poses, shape, contexts[:, None]].cumsum(axis=-1)  # (S, n, M)
        outcomes = (cumulative <= rng.random(poses.shape)[..., None] * cumulative[..., -1:]).sum(axis=-1)
        if not self.is_repeatable:
            first = (poses[:, :, None] == poses[:, None, :]).argmax(axis=2)
            outcomes = np.take_along_axis(outcomes, first, axis=1)
        return TouchBatch(poses, features=outcomes[..., None].astype(np.float64))

    @property
    def default_outcomes(self) -> int:
        """M."""
        return self._most

    @property
    def _most(self) -> int:
        return self.probs.shape[3]

    @property
    def _weights(self) -> Floats:
        assert self.weights is not None, "set at construction"
        return self.weights

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :class:`ArrayModel`; averaged over contexts."""
        return merged(OutcomeTable(np.einsum("kh,pkhm->pkm", self._weights, self.probs)), num_outcomes, rng)

    @cached_property
    def _log_weights(self) -> Floats:
        with np.errstate(divide="ignore"):
            return frozen(np.log(self._weights))

    @cached_property
    def _log_probs(self) -> Floats:
        """Log-likelihoods of outcomes; the last one is that of a missing outcome, ``(P, K, H, M + 1)``."""
        with np.errstate(divide="ignore"):
            logs = self.sharpness * np.log(self.probs)
        return frozen(np.concatenate([logs, np.zeros((*logs.shape[:3], 1))], axis=3))

    def logs_of(self, touch: Touch) -> Floats:
        """Log p(outcome | class, context), ``(K, H)``, of one touch; raises ValueError if it does not fit."""
        values = touch.features
        if values is None or values.shape != (1,) or touch.pose >= self.num_poses:
            raise ValueError(f"the model reads one outcome of one of {self.num_poses} actions, got {touch}")
        if values[0] not in range(MISSING, self._most):
            raise ValueError(f"an outcome is an integer below {self._most}, or -1 where it is missing, got {values[0]}")
        return np.asarray(self._log_probs[touch.pose, :, :, int(values[0])])


@dataclass(frozen=True, eq=False)
class ContextEvidence:
    """The outcomes of one case so far, as log p(outcomes, context | class), ``(K, H)``."""

    model: ContextModel
    log_joint: Floats
    used: frozenset[int] = frozenset()
    num_touches: int = 0

    @property
    def log_bets(self) -> Floats | None:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`; None, as the model has no test."""
        return None

    @cached_property
    def log_likelihood(self) -> Floats:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        return frozen(
            np.logaddexp.reduce(self.log_joint, axis=1) if self.num_touches else np.zeros(len(self.log_joint))
        )

    def update(self, touch: Touch) -> ContextEvidence:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        logs = self.model.logs_of(touch)
        if touch.pose in self.used and not self.model.is_repeatable:
            logs = np.zeros(logs.shape)
        return replace(
            self, log_joint=self.log_joint + logs, used=self.used | {touch.pose}, num_touches=self.num_touches + 1
        )

    def outcome_mixture(self, num_outcomes: int, num_hypotheses: int) -> OutcomeMixture:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`; with all outcomes and contexts."""
        largest = self.log_joint.max(axis=1, keepdims=True)
        shares = np.exp(self.log_joint - np.where(np.isfinite(largest), largest, 0.0))
        shares[~np.isfinite(largest[:, 0])] = 1.0  # of an impossible class
        new = None if self.model.is_repeatable or not self.used else np.ones(self.model.num_poses)
        if new is not None:
            new[list(self.used)] = 0.0
        return OutcomeMixture(shares / shares.sum(axis=1, keepdims=True), self.model.probs, new)


def log_products(log_probs: Floats, cases: NDArray[np.int64]) -> Floats:
    """Sums of log p(outcome | action, class, context) over the actions of cases ``(n, P)``, ``(n, K, H)``.

    ``log_probs`` is ``(P, K, H, M + 1)``, whose last entries are zero for a missing outcome, -1.
    """
    total = np.zeros((len(cases), *log_probs.shape[1:3]))
    for action, outcomes in enumerate(cases.T):
        total += np.moveaxis(log_probs[action], 2, 0)[outcomes]
    return total


def _sum_to_one(weights: Floats) -> bool:
    return bool((np.abs(weights.sum(axis=-1) - 1.0) <= SUM_TOLERANCE).all())
