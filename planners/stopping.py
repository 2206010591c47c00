"""Stopping rules on the posterior probability of the target: fixed thresholds, and Wald's sequential test.

The paper's own rule, which looks at single classifier outputs, is in :mod:`planners.threshold_rule`.
"""

from __future__ import annotations

from dataclasses import dataclass

from belief import Confirm, Reject
from belief.errors import InvalidArgument
from belief.validation import require_count
from planners.decider import Decision, InformationState


@dataclass(frozen=True)
class PosteriorThresholds:
    """Confirm or reject when the posterior of the target is beyond a threshold: Wald's sequential test.

    When the target is certainly on the table and only one object is left, it is confirmed untouched: rejecting it
    could only fail.

    Attributes:
        confirm: posterior at or above which to confirm.
        reject: posterior at or below which to reject.
        max_touches: touches of one object after which the likelier decision is taken.
    """

    confirm: float = 0.99
    reject: float = 0.01
    max_touches: int = 12

    def __post_init__(self) -> None:
        if not 0.0 <= self.reject < self.confirm <= 1.0:
            raise InvalidArgument(f"need 0 ≤ reject < confirm ≤ 1, got {self.reject} and {self.confirm}")
        require_count("max_touches", self.max_touches)

    def stop(self, info: InformationState) -> Decision | None:
        """See :class:`planners.decider.StoppingRule`."""
        prob = info.target_prob
        scores = {"target_prob": prob}
        must_be_here = info.num_left == 1 and info.problem.prior_absent_probs[info.target] == 0.0
        if prob >= self.confirm or (must_be_here and prob > 0.0):
            return Decision(Confirm(), scores)
        if prob <= self.reject:
            return Decision(Reject(), scores)
        if len(info.history) >= self.max_touches:
            return Decision(Confirm() if prob >= 0.5 else Reject(), scores)
        return None


@dataclass(frozen=True)
class SequentialTest:
    """Wald's sequential probability ratio test of "the target" against "another shape", for promised error rates.

    An object is confirmed once touches have multiplied the odds of the target by ``(1 - β) / α``, and rejected once
    they have multiplied them by ``β / (1 - α)`` (Wald 1945). Odds before touching are those of any one object of the
    problem, so these are thresholds on the posterior. What that promises of an object tested with that prior, if the
    observation model is right and the test is not cut off:

    - a confirmation is wrong with probability at most ``1 - confirm``, a rejection at most ``reject``
      (:meth:`thresholds`), whatever the poses: these hold for every object of a search;
    - another shape is confirmed with probability at most ``α / (1 - β)``, the target rejected with probability at most
      ``β / (1 - α)``, and the two do not add up to more than α + β. In a coupled search these hold for the first
      object only, as later ones come with odds of their own.

    Attributes:
        false_confirm: α, in (0, 1).
        false_reject: β, in (0, 1); α + β < 1.
        max_touches: touches of one object after which the likelier decision is taken, and the promise is off.

    Raises:
        InvalidArgument: rates out of range, or a number of touches that is none.

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
        """Posteriors of the target at or below which to reject, and at or above which to confirm.

        Args:
            prior_prob: of the target before any touch, in [0, 1]; where it is 0 or 1 there is nothing to test.

        Raises:
            InvalidArgument: it is no probability.
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
        return PosteriorThresholds(confirm, reject, self.max_touches).stop(info)
