"""The evidence about one rigid body: a weight for every hypothesis of shape, orientation and size.

Two touches that fit the second hypothesis of the mug, and none of the cup:

>>> from belief.observation_model import FixedHypotheses, RigidBodyModel
>>> embed = FixedHypotheses(np.array([[[[3.0, 0.0], [0.0, 3.0]], [[-3.0, 0.0], [0.0, -3.0]]]], np.float32))
>>> one = np.ones((1, 1, 2))
>>> model = RigidBodyModel(("mug", "cup"), 2, 1.0, references=one, reference_logits=one, hypotheses=embed)
>>> evidence: RigidBodyEvidence = model.start()
>>> for _ in range(2):
...     evidence = evidence.update(Touch(0, features=np.array([0.2, 1.0])))
>>> evidence.log_likelihood.round(1).tolist(), evidence.diagnostics.effective_hypotheses.round(2).tolist()
([-0.7, -7.9], [1.02, 1.02])
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from belief.conflict import MOST_TOUCHES, ON_MISFIT, ObjectConflict, log_conflict
from belief.errors import InvalidArgument
from belief.frozen import Kind, frozen
from belief.observation_model.evidence import ObjectEvidence
from belief.observation_model.outcome_mixture import (
    OutcomeMixture,
    SharedMixture,
    largest_posterior,
    log_means,
    misfit,
    some_hypotheses,
)
from belief.observation_model.repeat_discount import drift_share, effective_touches, new_shares
from belief.problem import Touch
from belief.validation import Floats, require_count

Floats32 = NDArray[np.float32]
SumsByPlace = Mapping[int | tuple[float, ...], tuple[int, Floats]]
"""Number of touches in every pose, or other place, and the sum of their scores, ``(..., K, N)``."""


class Diagnostics(NamedTuple):
    """How well the hypotheses cover the touches of an object.

    Attributes:
        effective_hypotheses: effective sample size of each shape's hypotheses, ``(K,)``, between 1 and N. Near 1, the
            posterior is narrower than the hypotheses are dense.
        most_likely: index of each shape's most likely hypothesis, ``(K,)``.
        p_values: p-values of the novelty and of the misfit of the last touch, ``(2,)``; ones without a test.
        log_conflict: log e-value of all touches of the object against "they come from the world that the model was
            fitted to"; 0.0 without a test.
    """

    effective_hypotheses: Floats
    most_likely: NDArray[np.int64]
    p_values: Floats
    log_conflict: float


class _Felt(NamedTuple):
    """A touch that the conflict test has not counted yet: its embedding and scores, and the log mean weights before."""

    embedding: Floats
    scores: NDArray[Any]
    before: Floats
    after: Floats


@dataclass(frozen=True, eq=False)
class RigidBodyEvidence:
    """The log weight of every hypothesis about one body: a frozen value, of which an update makes a new one.

    Attributes:
        log_weights: log p(all touches | hypothesis) up to a constant, ``(K, N)``, read-only; the largest is 0.
        log_likelihood: log p(all touches | shape) up to the same constant, ``(K,)``, read-only.
        in_pose: number of touches in every pose or other place, and the sum of their scores, ``(K, N)`` up to a
            constant; empty where the model discounts neither repeats nor drift.
        tested: conflict test of the first touches; None if the model has none.
        waiting: later touches, which are tested when :attr:`conflict` is read, because few deciders read it.
        constant: what was subtracted from both logarithms.
    """

    model: Any
    log_weights: Floats
    log_likelihood: Floats
    num_touches: int = 0
    in_pose: SumsByPlace = field(default_factory=dict)
    tested: ObjectConflict | None = None
    waiting: tuple[_Felt, ...] = ()
    constant: float = 0.0

    def untested(self) -> RigidBodyEvidence:
        """The same evidence without the conflict test."""
        return replace(self, tested=None)

    def update(self, touch: Touch) -> RigidBodyEvidence:
        """The evidence with one more touch; costs K N D multiplications."""
        embedding = self.model.embedding_of(touch)
        return self.with_scores(touch, embedding, self.model.scores_of(touch, embedding))

    def with_scores(self, touch: Touch, embedding: Floats, scores: NDArray[Any]) -> RigidBodyEvidence:
        """The evidence with one more touch, of ``embedding (1, D)`` and ``scores (K, N)``."""
        log_weights, log_likelihood, largest = relative(self.log_weights + scores)
        constant, tested, waiting = self.constant + float(largest), self.tested, self.waiting
        if tested is not None:
            if "conflict" in vars(self) or len(waiting) == MOST_TOUCHES:
                tested, waiting = self.conflict, ()
            waiting = (*waiting, _Felt(embedding[0], scores, self.log_likelihood, log_likelihood + largest))
        in_pose, discounted = with_touch(self.in_pose, touch, scores, self.model.correlation, self.model.drift)
        if discounted is not None:
            log_weights, log_likelihood, constant = relative(discounted)
        number = self.num_touches + 1
        return RigidBodyEvidence(
            self.model, log_weights, log_likelihood, number, in_pose, tested, waiting, float(constant)
        )

    @cached_property
    def conflict(self) -> ObjectConflict | None:
        """Test that the touches come from the world that the model was fitted to; None if the model has none."""
        if (found := self.tested) is None:
            return None
        for felt in self.waiting:
            surprise = float(misfit(felt.scores, felt.before, felt.after))
            found = found.update(felt.embedding, surprise, float(largest_posterior(felt.before)))
        return found

    @property
    def log_bets(self) -> Floats | None:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        return None if self.conflict is None else self.conflict.log_bets

    @cached_property
    def log_unlisted(self) -> float:
        """See :class:`~belief.observation_model.evidence.WeighsStrangers`.

        A stranger looks familiar from each side, but its sides do not fit one body. So the likelihood ratio of an
        unlisted shape is the e-value of the bets of the conflict test on a high misfit alone (decision 0107).
        """
        if self.conflict is None:
            raise InvalidArgument(
                "this observation model has no conflict test, by which it would tell whether an object has none of the "
                "shapes; leave out unlisted"
            )
        if not self.num_touches:
            return 0.0
        mean = float(scipy.special.logsumexp(self.log_likelihood)) - np.log(len(self.log_likelihood))
        return mean + log_conflict([self.conflict.log_bets[ON_MISFIT]])

    def outcome_mixture(self, num_outcomes: int, num_hypotheses: int) -> OutcomeMixture | SharedMixture:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`; outcomes are the model's reference touches.

        Hypotheses are resampled without chance. Where touches are discounted, the last outcome is "nothing new".
        """
        key = num_outcomes, num_hypotheses
        if key not in self._mixtures:
            require_count("num_outcomes", num_outcomes)
            require_count("num_hypotheses", num_hypotheses)
            views, new = self.model.views, self._new if self.in_pose else None
            if views is None:
                chosen, weights = some_hypotheses(self.log_weights, num_hypotheses)
                self._mixtures[key] = OutcomeMixture(weights, self.model.outcomes.of(chosen, num_outcomes), new)
            else:
                outcomes = self.model.outcomes.shared(num_outcomes)
                self._mixtures[key] = SharedMixture(self.log_weights, num_hypotheses, outcomes, views, new)
        return self._mixtures[key]

    @property
    def _new(self) -> Floats:
        """Increase of the effective number of touches by one more touch in each pose, ``(P,)``."""
        number = self.model.num_poses
        elsewhere = [many for place, (many, _) in self.in_pose.items() if isinstance(place, tuple)]
        counts = np.concatenate([np.zeros(number), elsewhere])
        for pose, (many, _) in self.in_pose.items():
            if not isinstance(pose, tuple):
                counts[pose] = many
        return new_shares(counts, self.model.correlation, self.model.drift)[:number]

    @cached_property
    def _mixtures(self) -> dict[tuple[int, int], OutcomeMixture | SharedMixture]:
        return {}

    @cached_property
    def diagnostics(self) -> Diagnostics:
        """See :class:`Diagnostics`."""
        shares = np.exp(self.log_weights - self.log_weights.max(axis=1, keepdims=True))
        effective = shares.sum(axis=1) ** 2 / np.square(shares).sum(axis=1)
        most_likely, conflict = frozen(self.log_weights.argmax(axis=1)), self.conflict
        if conflict is None:
            return Diagnostics(frozen(effective), most_likely, frozen(np.ones(2)), 0.0)
        log_e_value = log_conflict([conflict.log_bets])
        return Diagnostics(frozen(effective), most_likely, conflict.p_values, log_e_value)


def innermost(value: Any) -> Any:
    """What evidence, or a model, says if sensor and bodies are as described: its nominal part, or the value itself."""
    while (nominal := getattr(value, "nominal", None)) is not None:
        value = nominal
    return value


def joint_evidence(evidence: ObjectEvidence) -> RigidBodyEvidence | None:
    """The evidence, or its nominal one, if it is about one rigid body; otherwise None."""
    found = innermost(evidence)
    return found if isinstance(found, RigidBodyEvidence) else None


def relative(log_weights: Floats) -> tuple[Floats, Floats, float]:
    """Log weights ``(..., K, N)`` and log mean weights ``(..., K)``, both less the largest log weight, and this.

    Overwrites the log weights and makes them read-only.
    """
    largest = log_weights.max()
    log_weights -= largest
    return _read_only(log_weights), _read_only(log_means(log_weights)), largest


def with_touch(
    sums: SumsByPlace, touch: Touch, scores: NDArray[Any], correlation: float, drift: float
) -> tuple[SumsByPlace, Floats | None]:
    """Sums by place after one more touch, and log weights ``(..., K, N)``, or None where every touch counts in full."""
    if not (correlation or drift):
        return sums, None
    place = int(touch.pose) if touch.elsewhere is None else touch.elsewhere.place
    number, before = sums.get(place, (0, 0.0))
    total = np.add(before, scores, dtype=np.float64) if number else scores
    sums = {**sums, place: (number + 1, _read_only(total))}
    if not (number or drift):
        return sums, None
    shares = effective_touches([n for n, _ in sums.values()], correlation)
    shares = shares * drift_share(shares.sum(), drift)
    return sums, sum(m / n * one for m, (n, one) in zip(shares, sums.values(), strict=True))


def _read_only(array: NDArray[Kind]) -> NDArray[Kind]:
    """The array itself, which nobody else holds, made read-only: a copy would cost a tenth of an update."""
    array.flags.writeable = False
    return array
