"""Outcome tables of the next touch of an object, given the touches so far; and sums over log weights of hypotheses.

The weights are ``(..., K, N)``: N hypotheses of each of K shapes. Largest terms are subtracted first, so nothing
overflows. Sums over many hypotheses are in single precision where that is twice as fast and an error of 1e-6 does not
matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from belief.frozen import FrozenArrays
from belief.observation_model.outcome_table import OutcomeTable
from belief.validation import SUM_TOLERANCE, Floats

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


_NEGLIGIBLE = 1e-10  # below the rounding of single precision; products of smaller numbers would be slow


class Outcomes(Protocol):
    """The outcomes of the next touches of an object, given the touches so far."""

    @property
    def new(self) -> Floats | None:
        """Information of the next touch in each pose as a fraction of a first touch's, ``(P,)``; None if all are 1."""

    @property
    def table(self) -> OutcomeTable:
        """p(outcome | pose, shape); unless :attr:`new` is None, the last outcome is "nothing new"."""

    def one_touch(self, factors: Floats) -> NDArray[Any]:
        """See :meth:`OutcomeMixture.one_touch`."""

    def payoffs_after(self, payoffs: Floats, belief: Floats) -> tuple[Floats, Floats]:
        """Sums over shapes of payoffs ``(J, K)`` times p(shape, outcome of the next touch | pose), ``(J, P, M)``.

        And p(outcome | pose), ``(P, M)``. The belief about the shape is ``(K,)``; see :attr:`new` for the last outcome.
        """

    def two_touches(self, pose: int, factors: Floats) -> NDArray[np.float32]:
        """See :meth:`OutcomeMixture.two_touches`."""


def payoffs_by_table(table: OutcomeTable, payoffs: Floats, belief: Floats) -> tuple[Floats, Floats]:
    """See :meth:`Outcomes.payoffs_after`, by p(outcome | pose, shape)."""
    joint = belief[:, None] * table.probs  # (P, K, M)
    return np.einsum("jk,pkm->jpm", payoffs, joint), joint.sum(axis=1)


@dataclass(frozen=True, eq=False)
class OutcomeMixture(FrozenArrays):
    """p(outcome of the next touch | pose, shape, touches so far), as a mixture over H hypotheses of each shape.

    Given a hypothesis, touches are independent, so the mixture also holds the joint distribution of several touches.
    ``weights (K, H)`` are p(hypothesis | shape, touches so far); ``probs (P, K, H, M)`` are p(outcome | pose, shape,
    hypothesis) of first touches; for ``new`` see :class:`Outcomes`.

    A shape has two equally probable hypotheses, and each determines the outcome. A repeat gives the same outcome:

    >>> mixture = OutcomeMixture(np.array([[0.5, 0.5]]), np.eye(2)[None, None])
    >>> mixture.table.probs.tolist()
    [[[0.5, 0.5]]]
    >>> mixture.two_touches(0, np.ones((1, 1)))[0, :, 0].round(3).tolist()
    [[0.5, 0.0], [0.0, 0.5]]
    """

    weights: Floats
    probs: NDArray[np.floating]
    new: Floats | None = None

    def __post_init__(self) -> None:
        if self.probs.ndim != 4 or self.probs.size == 0 or self.weights.shape != self.probs.shape[1:3]:
            raise ValueError(
                f"probs must be (P, K, H, M) with no axis empty and weights (K, H), got {self.probs.shape} and "
                f"{self.weights.shape}"
            )
        for name, rows in (("weights", self.weights), ("probs", self.probs)):
            if not (rows.min() >= 0.0 and (np.abs(rows.sum(axis=-1) - 1.0) <= SUM_TOLERANCE).all()):  # NaN fails
                raise ValueError(f"each row of {name} must be probabilities that sum to one")
        self.freeze()

    @cached_property
    def table(self) -> OutcomeTable:
        """p(outcome | pose, shape), averaged over the hypotheses."""
        return OutcomeTable(self._means if self.new is None else with_nothing_new(self._means, self.new))

    @cached_property
    def _means(self) -> NDArray[Any]:
        """p(outcome of a first touch | pose, shape), ``(P, K, M)``."""
        return np.asarray((self.weights.astype(self.probs.dtype)[:, None] @ self.probs)[:, :, 0])

    def information(self, belief: Floats) -> Floats:
        """Mutual information of the outcome of a first touch with shape and hypothesis [nats], ``(P,)``."""
        joint = (belief[:, None] * self.weights)[..., None] * self.probs  # (P, K, H, M)
        return information(joint.reshape(len(joint), -1, joint.shape[3]))

    def one_touch(self, factors: Floats) -> NDArray[Any]:
        """Sums over shapes of ``factors (J, K)`` ≥ 0 times p(outcome | pose, shape) of a first touch, ``(P, J, M)``.

        With the belief on the diagonal as factors, it is the joint probability of shape and outcome.
        """
        return np.asarray(factors @ self._means)

    def payoffs_after(self, payoffs: Floats, belief: Floats) -> tuple[Floats, Floats]:
        """See :class:`Outcomes`."""
        return payoffs_by_table(self.table, payoffs, belief)

    def two_touches(self, pose: int, factors: Floats) -> NDArray[np.float32]:
        """Sums over shapes of ``factors (J, K)`` times p(outcomes of the next two touches | shape), ``(J, M, P, M)``.

        The last axes are the outcome of the first touch, in ``pose``, then pose and outcome of the second.
        """
        num_poses, num_outcomes = len(self.probs), self._weighted.shape[2] // len(self.probs)
        first = slice(pose * num_outcomes, (pose + 1) * num_outcomes)
        found = np.zeros((len(factors), num_outcomes, num_poses * num_outcomes), np.float32)
        largest = np.abs(factors).max(axis=0)
        for shape in np.flatnonzero(largest > _NEGLIGIBLE * largest.max()):
            rows = self._weighted[shape]
            both = rows[:, first].T @ rows
            for total, factor in zip(found, factors[:, shape].tolist(), strict=True):
                total += np.float32(factor) * both
        return found.reshape(len(factors), num_outcomes, num_poses, num_outcomes)

    @cached_property
    def _weighted(self) -> NDArray[np.float32]:
        """Outcome probabilities times the root of the weight, ``(K, H, P M)``, in single precision."""
        num_shapes, num_hypotheses = self.weights.shape
        of_next = self.probs if self.new is None else with_nothing_new(self.probs, self.new)
        rows = of_next.astype(np.float32).transpose(1, 2, 0, 3).reshape(num_shapes, num_hypotheses, -1)
        rows *= np.sqrt(self.weights)[..., None].astype(np.float32)
        rows[rows < _NEGLIGIBLE] = 0.0
        return rows


def target_shares(belief: Floats, target: ArrayLike) -> Floats:
    """A belief ``(..., K)`` as factors for the target, one or ``(...)``, and for all other shapes, ``(..., 2, K)``."""
    is_target = (np.asarray(target)[..., None] == np.arange(belief.shape[-1])).astype(np.float64)
    return np.stack([belief * is_target, belief * (1.0 - is_target)], axis=-2)


def information(joint: NDArray[np.floating]) -> Floats:
    """Mutual information of two variables [nats], ``(...)``, from joint probabilities ``(..., J, M)``; unchecked."""
    probs: Floats = joint.astype(np.float64, copy=False)
    columns, rows = probs.sum(axis=-2), probs.sum(axis=-1)
    gain = _x_log_x(probs).sum(axis=(-2, -1)) - _x_log_x(columns).sum(axis=-1) - _x_log_x(rows).sum(axis=-1)
    return np.asarray(np.clip(gain + _x_log_x(rows.sum(axis=-1)), 0.0, np.log(probs.shape[-2])))


def _x_log_x(values: Floats) -> Floats:
    """``x log x`` of numbers in [0, 1], zero at zero; three times as fast as that of SciPy."""
    return values * np.log(np.maximum(values, np.finfo(np.float64).tiny))


def with_nothing_new(probs: NDArray[Any], new: Floats) -> NDArray[Any]:
    """p(outcome | pose, …) of first touches, ``(P, …, M)``, with "nothing new" as one more outcome, the last.

    A touch that tells w times as much as a first one, ``new (P,)``, is a first touch behind a channel that erases it
    with probability 1 - w. It has w times its information, and w times its value.

    >>> with_nothing_new(np.array([[[0.8, 0.2]], [[0.8, 0.2]]]), np.array([1.0, 0.5])).round(2).tolist()
    [[[0.8, 0.2, 0.0]], [[0.4, 0.1, 0.5]]]
    """
    shares = new.reshape(-1, *[1] * (probs.ndim - 1)).astype(probs.dtype)
    return np.concatenate([shares * probs, np.broadcast_to(1.0 - shares, (*probs.shape[:-1], 1))], axis=-1)


_NEGLIGIBLE_FACTOR = 1e-7  # of a factor, relative to the largest: the rounding of single precision


@dataclass(frozen=True, eq=False)
class Views(FrozenArrays):
    """Which of N hypotheses look alike in different poses.

    An object that lies in any orientation shows in one pose what another one shows in another pose; poses of a group
    share this. ``groups (P,)`` numbers them from 0 in the order of their first poses. Hypothesis ``same[p, i]``,
    ``(P, N)``, looks in the first pose of the group nearly as hypothesis i looks in pose p.
    """

    groups: NDArray[np.int64]
    same: NDArray[np.int64]

    def __post_init__(self) -> None:
        found, first = np.unique(self.groups, return_index=True)
        if not len(found) or found.tolist() != list(range(len(found))) or (np.diff(first) <= 0).any():
            raise ValueError(f"groups must be numbered from 0 in the order of their poses, got {self.groups.tolist()}")
        if self.same.ndim != 2 or len(self.same) != len(self.groups) or not self.same.size:
            raise ValueError(f"same must be ({len(self.groups)}, N), got {self.same.shape}")
        if self.same.min() < 0 or self.same.max() >= self.same.shape[1]:
            raise ValueError(f"same must be indices of {self.same.shape[1]} hypotheses, got {self.same.max()}")
        self.freeze()

    @cached_property
    def first(self) -> NDArray[np.int64]:
        """The first pose of each group, ``(G,)``."""
        return np.unique(self.groups, return_index=True)[1]

    def of_all_poses(self, outcomes: NDArray[np.float32], chosen: NDArray[np.int64]) -> NDArray[np.float32]:
        """p(outcome | pose, hypothesis) of some hypotheses, ``(P, K, H, M)``."""
        shapes = np.arange(len(chosen))[None, :, None]
        return outcomes[self.groups[:, None, None], shapes, self.same[:, chosen]]


@dataclass(frozen=True, eq=False)
class SharedMixture(FrozenArrays):
    """An :class:`OutcomeMixture` of many poses, from one table of outcomes for all poses of a group.

    ``log_weights (K, N)`` are log p(hypothesis | shape, touches so far) up to a constant of each shape; at most
    ``num_hypotheses`` of each shape are used. ``outcomes (G, K, N, M)`` are in the first pose of each group.
    """

    log_weights: Floats
    num_hypotheses: int
    outcomes: NDArray[np.float32]
    views: Views
    new: Floats | None = None

    def __post_init__(self) -> None:
        num_shapes, number = self.outcomes.shape[1:3]
        if self.log_weights.shape != (num_shapes, number) or not np.isfinite(self.log_weights.max(axis=1)).all():
            raise ValueError(f"log weights must be ({num_shapes}, {number}), one in each row finite and none above it")
        if self.views.same.shape[1] != number or len(self.views.first) != len(self.outcomes):
            raise ValueError(f"the views are of {self.views.same.shape[1]} hypotheses, the outcomes of {number}")
        self.freeze()

    @cached_property
    def table(self) -> OutcomeTable:
        """p(outcome | pose, shape), averaged over the hypotheses."""
        found = self.one_touch(np.eye(len(self.log_weights)))
        return OutcomeTable(found if self.new is None else with_nothing_new(found, self.new))

    def one_touch(self, factors: Floats) -> NDArray[Any]:
        """See :meth:`OutcomeMixture.one_touch`; it omits shapes of negligible factor, below K times 2e-6 nats."""
        num_groups, num_shapes, number, num_outcomes = self.outcomes.shape
        num_poses, num_rows = len(self.views.groups), len(factors)
        rows, shapes = np.nonzero(factors > _NEGLIGIBLE_FACTOR * factors.max())
        chosen, shares = some_hypotheses(self.log_weights[shapes], self.num_hypotheses)
        places = chosen + number * np.arange(len(shapes))[:, None]
        once = np.flatnonzero(np.diff(places.ravel(), prepend=-1))  # some are chosen several times, in a row
        weights = np.add.reduceat((factors[rows, shapes, None] * shares).ravel(), once)
        entry, which = np.divmod(places.ravel()[once], number)
        columns = self.views.same[:, which] + number * shapes[entry]
        columns += (num_shapes * number * self.views.groups)[:, None]
        ends = np.tile(np.bincount(rows[entry], minlength=num_rows), num_poses).cumsum()
        means = scipy.sparse.csr_array(
            (np.tile(weights.astype(np.float32), num_poses), columns.ravel(), np.concatenate([[0], ends])),
            shape=(num_poses * num_rows, num_groups * num_shapes * number),
        )
        return np.asarray((means @ self.outcomes.reshape(-1, num_outcomes)).reshape(num_poses, num_rows, -1))

    def payoffs_after(self, payoffs: Floats, belief: Floats) -> tuple[Floats, Floats]:
        """See :class:`Outcomes`."""
        return payoffs_by_table(self.table, payoffs, belief)

    def two_touches(self, pose: int, factors: Floats) -> NDArray[np.float32]:
        """See :meth:`OutcomeMixture.two_touches`."""
        return self._whole.two_touches(pose, factors)

    @cached_property
    def _whole(self) -> OutcomeMixture:
        """The mixture with the outcomes of every pose."""
        chosen, weights = some_hypotheses(self.log_weights, self.num_hypotheses)
        return OutcomeMixture(weights, self.views.of_all_poses(self.outcomes, chosen), self.new)
