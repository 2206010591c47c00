"""Outcome tables: discrete observation models."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import entr

from belief.bayes import expected_information_gain
from belief.frozen import FrozenArrays
from belief.validation import SUM_TOLERANCE, Floats, as_real, renormalised, require_count


@dataclass(frozen=True, eq=False)
class OutcomeTable(FrozenArrays):
    """A discrete observation model.

    Attributes:
        probs: p(outcome | pose, shape), ``(P, K, M)``; the last axis sums to one.

    Raises:
        ValueError: not real numbers, not three axes, a negative or NaN entry, or a row that does not sum to one.

    Example:
        >>> table = OutcomeTable(np.array([[[0.9, 0.1], [0.1, 0.9]]]))
        >>> table.num_poses, table.num_shapes, table.num_outcomes
        (1, 2, 2)
        >>> table.information().round(3)                  # at most log 2 = 0.693 nats
        array([0.368])
    """

    probs: Floats

    def __post_init__(self) -> None:
        probs = np.array(as_real(self.probs, "probs"), np.float64)
        if probs.ndim != 3 or probs.size == 0:
            raise ValueError(f"probs must be (P, K, M) with no axis empty, got shape {probs.shape}")
        with np.errstate(over="ignore", invalid="ignore"):
            bad = ~((probs >= 0.0).all(axis=2) & (np.abs(probs.sum(axis=2) - 1.0) <= SUM_TOLERANCE))
        if bad.any():
            pose, shape = (int(i) for i in np.argwhere(bad)[0])
            raise ValueError(
                f"probs[pose {pose}, shape {shape}] is no distribution over outcomes: {probs[pose, shape].tolist()}"
            )
        probs = renormalised(probs)
        probs.flags.writeable = False  # already a copy
        object.__setattr__(self, "probs", probs)

    @property
    def num_poses(self) -> int:
        """P."""
        return self.probs.shape[0]

    @property
    def num_shapes(self) -> int:
        """K."""
        return self.probs.shape[1]

    @property
    def num_outcomes(self) -> int:
        """M."""
        return self.probs.shape[2]

    @property
    def sha256(self) -> str:
        """SHA-256 of the table's shape and numbers.

        >>> OutcomeTable([[[0.5, 0.5]]]).sha256[:12]
        '38ffe0147c9c'
        """
        content = np.ascontiguousarray(self.probs, "<f8").tobytes()
        return hashlib.sha256(repr(self.probs.shape).encode() + content).hexdigest()

    def information(self, prior: ArrayLike | None = None) -> Floats:
        """Mutual information of one touch and the shape, in each pose [nats], ``(P,)``; uniform prior by default."""
        belief = np.full(self.num_shapes, 1.0 / self.num_shapes) if prior is None else prior
        return expected_information_gain(belief, self.probs)

    def merged(self, num_outcomes: int) -> OutcomeTable:
        """A table of at most ``num_outcomes`` outcomes, by greedy merging of the pair that loses the least information.

        The information is that about the shape under a uniform prior, averaged over poses. The same outcomes are merged
        in all poses.

        Raises:
            ValueError: ``num_outcomes`` is not an integer ≥ 1.

        >>> table = OutcomeTable(np.array([[[0.7, 0.2, 0.1], [0.1, 0.2, 0.7]]]))
        >>> table.merged(2).probs.round(1).tolist(), table.merged(2).num_outcomes
        ([[[0.9, 0.1], [0.3, 0.7]]], 2)
        """
        require_count("num_outcomes", num_outcomes)
        columns = np.moveaxis(self.probs, 2, 0)  # (M, P, K)
        if len(columns) <= num_outcomes:
            return self
        terms = _info(columns)
        loss = np.stack([terms + mine - _info(columns + column) for mine, column in zip(terms, columns, strict=True)])
        np.fill_diagonal(loss, np.inf)
        while len(columns) > num_outcomes:
            one, other = sorted(int(i) for i in np.unravel_index(int(loss.argmin()), loss.shape))
            both = columns[one] + columns[other]
            columns, terms = np.delete(columns, other, axis=0), np.delete(terms, other)
            loss = np.delete(np.delete(loss, other, axis=0), other, axis=1)
            columns[one], terms[one] = both, _info(both)
            loss[one] = loss[:, one] = terms + terms[one] - _info(columns + both)
            loss[one, one] = np.inf
        return OutcomeTable(np.moveaxis(columns, 0, 2))


def _info(joint: Floats) -> Floats:
    """Contribution of each outcome to the information, ``(...)``, from p(outcome | pose, shape), ``(..., P, K)``."""
    total = np.maximum(joint.sum(axis=-1, keepdims=True), np.finfo(float).smallest_subnormal)
    return np.asarray(-entr(joint / total) * total + joint * np.log(joint.shape[-1])).mean(axis=-1).sum(axis=-1)
