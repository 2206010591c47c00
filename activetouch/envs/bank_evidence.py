"""Evidence of touches of a bank about the objects of B episodes: log-likelihoods, and gains of poses."""

from __future__ import annotations

from functools import lru_cache
from itertools import islice

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.envs.touch_bank import TouchBank
from belief.observation_model.model import ArrayModel
from belief.observation_model.outcome_mixture import information, log_means, some_hypotheses, target_shares
from belief.observation_model.repeat_discount import new_shares
from belief.observation_model.rigid_body import joint_model
from belief.policy_state import GAIN_HYPOTHESES, GAIN_OUTCOMES, NoGains
from belief.touch_batch import TouchBatch

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_BYTES = 1 << 28
"""Largest size of the outcome tables that are kept; the oldest are dropped, and recomputed where they are needed."""
_AT_ONCE = 32  # objects whose hypotheses are weighed at a time; they fit the cache


class BankEvidence:
    """Log-likelihoods of B episodes by any model, ``(B, K)``, up to a constant of the row, recomputed at each touch."""

    def __init__(self, bank: TouchBank, model: ArrayModel, num_envs: int, touch_limit: int) -> None:
        self._bank, self._model = bank, model
        self._touched = np.zeros((3, num_envs, touch_limit), np.int64)  # object, round, pose
        self._counts = np.zeros(num_envs, np.int64)
        self.log_likelihoods = np.zeros((num_envs, bank.logits.shape[3]))

    def add(self, rows: Ints, objects: Ints, rounds: Ints, poses: Ints) -> None:
        """Add a touch of the bank to each of some rows; all arguments ``(n,)``."""
        self._touched[:, rows, self._counts[rows]] = objects, rounds, poses
        self._counts[rows] += 1
        for number in np.unique(self._counts[rows]).tolist():
            some = rows[self._counts[rows] == number]
            self._compute(some, *self._touched[:, some, :number])

    def _compute(self, rows: Ints, objects: Ints, rounds: Ints, poses: Ints) -> None:
        """Set what is known of rows from all their touches, ``(n, t)`` each."""
        self.log_likelihoods[rows] = self._model.log_likelihood_batch(self._bank.batch(objects, rounds, poses))

    def forget(self, rows: Ints) -> None:
        """Remove all touches of these rows."""
        self._counts[rows] = 0
        self.log_likelihoods[rows] = 0.0


class SummedEvidence(BankEvidence):
    """Faster evidence for models whose log-likelihood is a weighted sum, over poses, of the sum over a pose's touches.

    ``weights[t]`` is the weight of a sum of t touches (:meth:`belief.observation_model.ArrayModel.weights_of_sums`).
    """

    def __init__(self, bank: TouchBank, model: ArrayModel, num_envs: int, weights: Floats) -> None:
        super().__init__(bank, model, num_envs, 0)
        every = np.indices(bank.logits.shape[:3]).reshape(3, -1, 1)
        self._single = model.log_likelihood_batch(bank.batch(*every)).reshape(bank.logits.shape)
        self._weights, self._sums = weights, np.zeros((num_envs, *bank.logits.shape[2:]))
        self._uses = np.zeros(self._sums.shape[:2], np.int64)

    def add(self, rows: Ints, objects: Ints, rounds: Ints, poses: Ints) -> None:
        """See :class:`BankEvidence`."""
        self._sums[rows, poses] += self._single[objects, rounds, poses]
        self._uses[rows, poses] += 1
        self.log_likelihoods = (self._weights[self._uses][:, None, :] @ self._sums)[:, 0]

    def forget(self, rows: Ints) -> None:
        """See :class:`BankEvidence`."""
        self._sums[rows], self._uses[rows], self.log_likelihoods[rows] = 0.0, 0, 0.0


def evidence_of(bank: TouchBank, model: ArrayModel, num_envs: int, touch_limit: int) -> BankEvidence:
    """The fastest evidence for an observation model; arguments as of :class:`BankEvidence`."""
    weights = model.weights_of_sums(np.arange(touch_limit + 1))
    if weights is None:
        return BankEvidence(bank, model, num_envs, touch_limit)
    return SummedEvidence(bank, model, num_envs, weights)


class WeighedTouches:
    """Log-likelihoods and outcome tables of sets of a bank's touches by a joint model, kept until a set is forgotten.

    They equal those of :class:`~belief.observation_model.rigid_body_evidence.RigidBodyEvidence` up to rounding.
    """

    def __init__(self, bank: TouchBank, model: ArrayModel) -> None:
        joint = joint_model(model)
        if joint is None or bank.features is None:
            found = "without" if bank.features is None else "with"
            raise NoGains(
                "the gain of each pose needs a sensor whose belief is about one rigid body, and a bank with features "
                f"that its reader wrote; got a {type(model).__name__} and a bank {found} features"
            )
        self.model, self._features, self._num_rounds = joint, bank.features, bank.num_rounds
        num_shapes, number = len(joint.shape_labels), joint.num_hypotheses
        probs = joint.outcomes.of(np.tile(np.arange(number), (num_shapes, 1)), GAIN_OUTCOMES)  # (P, K, N, M)
        self.outcomes = np.moveaxis(probs, 0, 2).reshape(num_shapes * number, -1)  # (K N, P M)
        untouched = np.zeros((1, num_shapes, number), np.float32)
        self.untouched: NDArray[np.float16] = self._tables_of(untouched)[0]
        """p(outcome of the first touch | pose, shape), ``(P, K, M)``."""
        self._known: dict[bytes, tuple[Floats, NDArray[np.float16]]] = {}  # the oldest first
        self._most_known = MOST_BYTES // self.untouched.nbytes

    def of(self, objects: Ints, rounds: Ints, poses: Ints) -> tuple[Floats, NDArray[np.float16]]:
        """Log-likelihoods ``(n, K)`` and tables of the next touch ``(n, P, K, M)``; rounds and poses are ``(n, t)``."""
        places = np.sort(poses * self._num_rounds + rounds, axis=1)  # the order of touches does not matter
        keys = [row.tobytes() for row in np.concatenate([objects[:, None], places], axis=1)]
        new = list({key: row for row, key in enumerate(keys) if key not in self._known}.values())
        for first in range(0, len(new), _AT_ONCE):
            block = np.array(new[first : first + _AT_ONCE])
            found = self._weigh(objects[block], rounds[block], poses[block])
            self._known |= zip((keys[row] for row in block), zip(*found, strict=True), strict=True)
        log_likelihoods, tables = zip(*(self._known[key] for key in keys), strict=True)
        for key in [*islice(self._known, max(0, len(self._known) - self._most_known))]:
            del self._known[key]
        return np.stack(log_likelihoods), np.stack(tables)

    def _weigh(self, objects: Ints, rounds: Ints, poses: Ints) -> tuple[Floats, NDArray[np.float16]]:
        batch = TouchBatch(poses, features=self._features[objects[:, None], rounds, poses])
        weights = self.model.log_weights(batch, np.float32)
        weights -= weights.max(axis=(1, 2), keepdims=True)
        return log_means(weights.astype(np.float64)), self._tables_of(weights)

    def _tables_of(self, log_weights: NDArray[np.float32]) -> NDArray[np.float16]:
        count, num_shapes, number = log_weights.shape
        some = [some_hypotheses(row, GAIN_HYPOTHESES) for row in log_weights]
        chosen, shares = (np.stack(column) for column in zip(*some, strict=True))  # (n, K, H) each
        columns = chosen + number * np.arange(num_shapes)[:, None]
        ends = np.arange(0, chosen.size + 1, chosen.shape[2])
        means = scipy.sparse.csr_array(
            (shares.astype(np.float32).ravel(), columns.ravel(), ends), shape=(len(ends) - 1, len(self.outcomes))
        )
        found = (means @ self.outcomes).reshape(count, num_shapes, self.model.num_poses, -1)
        return np.ascontiguousarray(found.swapaxes(1, 2), np.float16)


@lru_cache(maxsize=2)
def weighed_touches(bank: TouchBank, model: ArrayModel) -> WeighedTouches:
    """The weighed touches of a bank, shared by all episodes on it."""
    return WeighedTouches(bank, model)


class JointEvidence(BankEvidence):
    """Evidence about one rigid body, with the gain of each pose."""

    def __init__(self, bank: TouchBank, model: ArrayModel, num_envs: int, touch_limit: int) -> None:
        super().__init__(bank, model, num_envs, touch_limit)
        self._weighed = weighed_touches(bank, model)
        self._tables = np.repeat(self._weighed.untouched[None], num_envs, axis=0)

    def _compute(self, rows: Ints, objects: Ints, rounds: Ints, poses: Ints) -> None:
        self.log_likelihoods[rows], self._tables[rows] = self._weighed.of(objects[:, 0], rounds, poses)

    def forget(self, rows: Ints) -> None:
        """See :class:`BankEvidence`."""
        super().forget(rows)
        self._tables[rows] = self._weighed.untouched

    def gains(self, rows: Ints, log_probs: Floats, targets: Ints, uses: Ints) -> Floats:
        """Expected information of the next touch in each pose about the target of each row [nats], ``(n, P)``.

        ``log_probs (n, K)`` are log posteriors, ``uses (n, P)`` numbers of touches in each pose; the rest is ``(n,)``.
        """
        shares = target_shares(np.exp(log_probs), targets)[:, None]
        new = new_shares(uses, self._weighed.model.correlation, self._weighed.model.drift)
        return information(shares @ self._tables[rows].astype(np.float64)) * new
