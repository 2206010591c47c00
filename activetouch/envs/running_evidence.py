"""Running log-likelihoods ``(B, K)`` of many episodes on a touch bank."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.envs.touch_bank import TouchBank
from belief.observation_model.model import ArrayModel
from belief.touch_batch import TouchBatch

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class BankEvidence(Protocol):
    """Log-likelihoods of the objects of B episodes, touch by touch."""

    def add(self, rows: Ints, objects: Ints, rounds: Ints, poses: Ints) -> None:
        """Add a touch of the bank to each of some rows; all arguments ``(n,)``."""

    def forget(self, rows: Ints) -> None:
        """Remove all touches of these rows."""

    def log_likelihoods(self) -> Floats:
        """Log p(touches | shape) of every row, ``(B, K)``, up to a constant of the row."""


def evidence_of(bank: TouchBank, model: ArrayModel, num_envs: int, touch_limit: int) -> BankEvidence:
    """The fastest evidence for an observation model.

    Args:
        bank: the touches.
        model: the observation model; its ``weights_of_sums`` decides the class.
        num_envs: B.
        touch_limit: maximum number of touches of a row.
    """
    weights = model.weights_of_sums(np.arange(touch_limit + 1))
    if weights is None:
        return RecomputedBankEvidence(bank, model, num_envs, touch_limit)
    return SummedBankEvidence(bank, model, num_envs, weights)


class SummedBankEvidence:
    """Evidence of models whose log-likelihood is a weighted sum, over poses, of the sum over a pose's touches.

    ``weights``, ``(n,)``, are those of sums of 0, 1, … touches
    (:meth:`belief.observation_model.ArrayModel.weights_of_sums`); see :func:`evidence_of` for the other arguments.
    """

    def __init__(self, bank: TouchBank, model: ArrayModel, num_envs: int, weights: Floats) -> None:
        num_poses, num_shapes = bank.logits.shape[2:]
        poses = np.broadcast_to(np.arange(num_poses), bank.logits.shape[:3]).reshape(-1, 1)
        read = None if bank.features is None else np.asarray(bank.features).reshape(len(poses), 1, -1)
        alone = TouchBatch(poses, np.asarray(bank.logits, np.float64).reshape(-1, 1, num_shapes), read)
        self._single, self._weights = model.log_likelihood_batch(alone).reshape(bank.logits.shape), weights
        self._sums = np.zeros((num_envs, num_poses, num_shapes))
        self._counts = np.zeros((num_envs, num_poses), np.int64)

    def add(self, rows: Ints, objects: Ints, rounds: Ints, poses: Ints) -> None:
        """See :class:`BankEvidence`."""
        self._sums[rows, poses] += self._single[objects, rounds, poses]
        self._counts[rows, poses] += 1

    def forget(self, rows: Ints) -> None:
        """See :class:`BankEvidence`."""
        self._sums[rows] = 0.0
        self._counts[rows] = 0

    def log_likelihoods(self) -> Floats:
        """See :class:`BankEvidence`."""
        weights = self._weights[self._counts]
        return np.asarray((weights[:, None, :] @ self._sums)[:, 0])


class RecomputedBankEvidence:
    """Evidence of any model: the likelihood of all touches of a row is computed again after each touch.

    See :func:`evidence_of` for the arguments.
    """

    def __init__(self, bank: TouchBank, model: ArrayModel, num_envs: int, touch_limit: int) -> None:
        self._bank, self._model = bank, model
        self._touched = np.zeros((3, num_envs, touch_limit), np.int64)  # object, round, pose
        self._counts = np.zeros(num_envs, np.int64)
        self._found = np.zeros((num_envs, bank.logits.shape[3]))

    def add(self, rows: Ints, objects: Ints, rounds: Ints, poses: Ints) -> None:
        """See :class:`BankEvidence`."""
        self._touched[:, rows, self._counts[rows]] = objects, rounds, poses
        self._counts[rows] += 1
        for number in np.unique(self._counts[rows]).tolist():
            some = rows[self._counts[rows] == number]
            self._compute(some, *self._touched[:, some, :number])

    def _compute(self, rows: Ints, objects: Ints, rounds: Ints, poses: Ints) -> None:
        """Set what is known of rows from all their touches, ``(n, t)`` each."""
        index = objects, rounds, poses
        features = None if self._bank.features is None else np.asarray(self._bank.features[index])
        batch = TouchBatch(poses, np.asarray(self._bank.logits[index], np.float64), features)
        self._found[rows] = self._model.log_likelihood_batch(batch)

    def forget(self, rows: Ints) -> None:
        """See :class:`BankEvidence`."""
        self._counts[rows] = 0
        self._found[rows] = 0.0

    def log_likelihoods(self) -> Floats:
        """See :class:`BankEvidence`."""
        return self._found.copy()
