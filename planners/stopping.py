"""Stopping rules on the posterior probability of the target: fixed thresholds, and Wald's sequential test.

The paper's rule, which uses single classifier outputs, is in :mod:`planners.threshold_rule`.
"""

from __future__ import annotations

from dataclasses import dataclass

from belief.errors import InvalidArgument
from belief.problem import Confirm, Reject
from belief.validation import require_count
from planners.decider import Decision, InformationState

_LOW_PRIOR = 1.0 / 12.0  # below it thresholds of rejection fall with the prior; the lowest prior of the named scenes


@dataclass(frozen=True)
class PosteriorThresholds:
    """Confirm or reject when the posterior of the target passes a threshold.

    The last object is confirmed without a touch if some object must be a target, because rejecting it always fails.

    A low prior alone rejects nothing (decision 0075): what rejects an object is evidence, in its own touches or in
    those of other objects.

    Attributes:
        confirm: posterior at or above which to confirm.
        reject: posterior at or below which to reject, if the prior of the target in the problem is at least 1/12. A
            lower prior lowers it in proportion, and it is at most half the prior (:meth:`reject_at`).
        max_touches: touches of one object after which the more probable decision is taken.
    """

    confirm: float = 0.99
    reject: float = 0.01
    max_touches: int = 12

    def __post_init__(self) -> None:
        if not 0.0 <= self.reject < self.confirm <= 1.0:
            raise InvalidArgument(f"need 0 ≤ reject < confirm ≤ 1, got {self.reject} and {self.confirm}")
        require_count("max_touches", self.max_touches)

    def reject_at(self, prior_prob: float) -> float:
        """Posterior of the target at or below which an object is rejected, for a prior of the problem.

        >>> [round(PosteriorThresholds(reject=0.01).reject_at(prior), 6) for prior in (0.25, 1 / 12, 0.001)]
        [0.01, 0.01, 0.00012]
        """
        return min(self.reject * share_of_threshold(prior_prob), prior_prob / 2.0)

    def stop(self, info: InformationState) -> Decision | None:
        """See :class:`planners.decider.StoppingRule`."""
        reject = self.reject_at(float(info.problem.prior_probs[info.target]))
        return _beyond(info, self.confirm, reject, self.max_touches)


@dataclass(frozen=True)
class SequentialTest:
    """Wald's (1945) sequential probability ratio test of "the target" against "another shape", for given error rates.

    An object is confirmed when its touches have multiplied the odds of the target by ``(1 - β) / α``, and rejected when
    they have multiplied them by ``β / (1 - α)``. For the prior odds of the problem these are thresholds on the
    posterior (decision 0030). For a correct observation model and without ``max_touches``:

    - a confirmation is wrong with probability at most ``1 - confirm``, and a rejection with probability at most
      ``reject`` (:meth:`thresholds`), for every object of a search and any poses;
    - another shape is confirmed with probability at most ``α / (1 - β)``, the target is rejected with probability at
      most ``β / (1 - α)``, and their sum is at most α + β. This holds for objects with the prior odds, in a search
      among distinct shapes only for the first one.

    Attributes:
        false_confirm: α, in (0, 1).
        false_reject: β, in (0, 1); α + β < 1.
        max_touches: touches of one object after which the more probable decision is taken.

    Raises:
        InvalidArgument: a rate or ``max_touches`` is out of range.

    >>> [round(float(prob), 4) for prob in SequentialTest(0.01, 0.05).thresholds(0.25)]
    [0.0166, 0.9694]
    """

    false_confirm: float = 0.01
    false_reject: float = 0.01
    max_touches: int = 12

    def __post_init__(self) -> None:
        alpha, beta = self.false_confirm, self.false_reject
        if not (0.0 < alpha < 1.0 and 0.0 < beta < 1.0 and alpha + beta < 1.0):
            raise InvalidArgument(
                f"need false_confirm and false_reject in (0, 1) with a sum below 1, got {alpha}, {beta}"
            )
        require_count("max_touches", self.max_touches)

    def thresholds(self, prior_prob: float) -> tuple[float, float]:
        """Posteriors of the target at or below which to reject, and at or above which to confirm, for a prior.

        Raises:
            InvalidArgument: ``prior_prob`` is not a probability.
        """
        if not 0.0 <= prior_prob <= 1.0:
            raise InvalidArgument(f"prior_prob must be a probability, in [0, 1], got {prior_prob!r}")
        if prior_prob in (0.0, 1.0):
            return 0.0, 1.0
        alpha, beta, other_prob = self.false_confirm, self.false_reject, 1.0 - prior_prob
        rejected, confirmed = prior_prob * beta, prior_prob * (1.0 - beta)
        return rejected / (rejected + other_prob * (1.0 - alpha)), confirmed / (confirmed + other_prob * alpha)

    def stop(self, info: InformationState) -> Decision | None:
        """See :class:`planners.decider.StoppingRule`."""
        reject, confirm = self.thresholds(float(info.problem.prior_probs[info.target]))
        return _beyond(info, confirm, reject, self.max_touches)


def share_of_threshold(prior_prob: float) -> float:
    """Factor of a threshold of rejection for a low prior of the target, in [0, 1] (decision 0075)."""
    return min(prior_prob / _LOW_PRIOR, 1.0)


def _beyond(info: InformationState, confirm: float, reject: float, max_touches: int) -> Decision | None:
    """The decision beyond one of two thresholds on the posterior, or at the last touch; None before."""
    prob = info.target_prob
    scores = {"target_prob": prob}
    must_be_here = info.num_left == 1 and info.problem.prior_absent_probs[info.target] == 0.0
    if prob >= confirm or (must_be_here and prob > 0.0):
        return Decision(Confirm(), scores)
    if prob <= reject:
        return Decision(Reject(), scores)
    if len(info.history) >= max_touches:
        return Decision(Confirm() if prob >= 0.5 else Reject(), scores)
    return None
