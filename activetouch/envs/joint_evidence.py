"""The joint belief of many episodes on a touch bank: shape, and what the next touch tells."""

from __future__ import annotations

from functools import lru_cache
from itertools import islice

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.envs.running_evidence import RecomputedBankEvidence
from activetouch.envs.touch_bank import TouchBank
from belief.observation_model.log_weights import log_means, some_hypotheses
from belief.observation_model.model import ArrayModel
from belief.observation_model.outcome_mixture import information, target_shares
from belief.observation_model.repeat_discount import new_shares
from belief.observation_model.rigid_body import joint_model
from belief.policy_state import GAIN_HYPOTHESES, GAIN_OUTCOMES, NoGains
from belief.touch_batch import TouchBatch

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_BYTES = 1 << 28
"""Size of the outcome tables that are kept at most; after that, the oldest are computed again where they are needed."""
_AT_ONCE = 32  # objects whose hypotheses are weighed at a time; they fit the cache


class WeighedTouches:
    """What sets of touches of a bank's objects say by a joint model; each set is weighed once, until it is forgotten.

    It is what :class:`~belief.observation_model.rigid_body_evidence.RigidBodyEvidence` says, up to rounding.

    Args:
        bank: the touches, with features.
        model: the joint model, with its hypotheses.

    Raises:
        NoGains: the model is no joint model, or the bank has no features.
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
        probs = joint.outcome_probs(np.tile(np.arange(number), (num_shapes, 1)), GAIN_OUTCOMES)  # (P, K, N, M)
        self._outcomes = np.moveaxis(probs, 0, 2).reshape(num_shapes * number, -1)  # (K N, P M)
        untouched = np.zeros((1, num_shapes, number), np.float32)
        self.untouched: NDArray[np.float16] = self._tables_of(untouched)[0]
        """p(outcome of the first touch | pose, shape), ``(P, K, M)``."""
        self._known: dict[bytes, tuple[Floats, NDArray[np.float16]]] = {}  # the oldest first
        self._most_known = MOST_BYTES // self.untouched.nbytes

    def of(self, objects: Ints, rounds: Ints, poses: Ints) -> tuple[Floats, NDArray[np.float16]]:
        """Log-likelihoods of the shapes, ``(n, K)``, and outcome tables of the next touch, ``(n, P, K, M)``.

        Args:
            objects: of the bank, ``(n,)``.
            rounds: of their touches, as many for each, ``(n, t)``.
            poses: of their touches, ``(n, t)``.
        """
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
            (shares.astype(np.float32).ravel(), columns.ravel(), ends), shape=(len(ends) - 1, len(self._outcomes))
        )
        found = (means @ self._outcomes).reshape(count, num_shapes, self.model.num_poses, -1)
        return np.ascontiguousarray(found.swapaxes(1, 2), np.float16)


@lru_cache(maxsize=2)
def weighed_touches(bank: TouchBank, model: ArrayModel) -> WeighedTouches:
    """The weighed touches of a bank, shared by all episodes on it."""
    return WeighedTouches(bank, model)


class JointBankEvidence(RecomputedBankEvidence):
    """Evidence about one rigid body, with the gain of each pose.

    Args:
        bank: the touches, with features.
        model: the joint model, with its hypotheses.
        num_envs: B.
        touch_limit: maximum number of touches of a row.

    Raises:
        NoGains: the model is no joint model, or the bank has no features.
    """

    def __init__(self, bank: TouchBank, model: ArrayModel, num_envs: int, touch_limit: int) -> None:
        super().__init__(bank, model, num_envs, touch_limit)
        self._weighed = weighed_touches(bank, model)
        self._tables = np.repeat(self._weighed.untouched[None], num_envs, axis=0)

    def _compute(self, rows: Ints, objects: Ints, rounds: Ints, poses: Ints) -> None:
        self._found[rows], self._tables[rows] = self._weighed.of(objects[:, 0], rounds, poses)

    def forget(self, rows: Ints) -> None:
        """See :class:`~activetouch.envs.running_evidence.BankEvidence`."""
        super().forget(rows)
        self._tables[rows] = self._weighed.untouched

    def gains(self, rows: Ints, log_probs: Floats, targets: Ints) -> Floats:
        """Expected information of the next touch of these rows about their targets [nats], ``(n, P)``.

        Args:
            rows: of the batch, ``(n,)``.
            log_probs: their log posteriors, ``(n, K)``.
            targets: index of each row's target, ``(n,)``.
        """
        body, inside = self._weighed.model, np.arange(self._touched.shape[2]) < self._counts[rows, None]
        poses = np.where(inside, self._touched[2, rows], -1)
        uses = (poses[:, :, None] == np.arange(body.num_poses)).sum(axis=1)
        new = new_shares(uses, body.correlation, body.drift)
        shares = target_shares(np.exp(log_probs), targets)[:, None]
        return information(shares @ self._tables[rows].astype(np.float64)) * new
