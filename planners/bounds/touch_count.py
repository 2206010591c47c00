r"""Lower bounds on the number of touches that any decider needs to distinguish two shapes.

For any choice of poses and any stopping rule with error rate ε for both shapes a and b, the expected number of touches
is at least (Wald 1945; the data processing inequality)

    E_a[touches] ≥ d(ε) / max_pose KL(p(· | pose, a) ‖ p(· | pose, b)),     d(ε) = (1 - 2ε) log((1 - ε) / ε)

The Chernoff information C = max_pose max_s -log ∑_o p(o | a)^s p(o | b)^(1-s) is the rate of a fixed number of touches
in one pose: its error falls like exp(-C n). Where it is zero in every pose, the two shapes cannot be distinguished.

The bounds assume that touches are independent given the shape, as in the table. Repeated touches in one pose give less
information, so the bounds also hold for them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import rel_entr

from belief.observation_model.outcome_table import OutcomeTable
from belief.validation import Floats

_SAME = 1e-12  # nats of divergence below which rounding makes all the difference
_EXPONENTS = np.linspace(0.0, 1.0, 201)


@dataclass(frozen=True, eq=False)
class TouchCountBounds:
    """Lower bounds for every pair of shapes.

    Attributes:
        error: ε.
        least_touches: lower bound on the mean number of touches if the shape is the first of the pair, ``(K, K)``;
            infinite where no pose distinguishes the two, zero on the diagonal and where one touch can decide.
        best_poses: pose with the largest divergence, ``(K, K)``; -1 where all divergences are zero.
        chernoff: information of the best pose [nats per touch], ``(K, K)``, symmetric; infinite where one touch
            decides.
    """

    error: float
    least_touches: Floats
    best_poses: Floats
    chernoff: Floats

    @property
    def indistinguishable(self) -> list[tuple[int, int]]:
        """Pairs of shapes that no pose distinguishes, the lower index first."""
        first, second = np.nonzero(np.triu(self.best_poses < 0, k=1))
        return list(zip(first.tolist(), second.tolist(), strict=True))


def touch_count_bounds(table: OutcomeTable, error: float = 0.01) -> TouchCountBounds:
    """Lower bounds on the number of touches that distinguish any two shapes.

    Args:
        table: p(outcome | pose, shape).
        error: ε, probability of mistaking either shape for the other, in (0, 1/2).

    Raises:
        ValueError: the error is out of range.

    A pose that is right nine times in ten has a divergence of 0.8 log 9 = 1.76 nats per touch. An error of 1 %
    needs 4.50 nats:

    >>> bounds = touch_count_bounds(OutcomeTable(np.array([[[0.9, 0.1], [0.1, 0.9]], [[0.5, 0.5], [0.5, 0.5]]])))
    >>> bounds.least_touches.round(2).tolist(), bounds.best_poses.tolist()
    ([[0.0, 2.56], [2.56, 0.0]], [[-1, 0], [0, -1]])
    >>> bounds.chernoff.round(3).tolist(), bounds.indistinguishable
    ([[0.0, 0.511], [0.511, 0.0]], [])
    """
    if not 0.0 < error < 0.5:
        raise ValueError(f"error must be in (0, 1/2), got {error}")
    divergence = rel_entr(table.probs[:, :, None], table.probs[:, None]).sum(axis=3)  # (P, K, K)
    best = divergence.max(axis=0)
    tells = best > _SAME
    needed = (1.0 - 2.0 * error) * np.log((1.0 - error) / error)
    least = np.where(tells, needed / np.where(tells, best, 1.0), np.inf)
    np.fill_diagonal(least, 0.0)
    chernoff = np.where(tells | tells.T, _chernoff(table), 0.0)
    return TouchCountBounds(error, least, np.where(tells, divergence.argmax(axis=0), -1), chernoff)


def _chernoff(table: OutcomeTable) -> Floats:
    """Chernoff information of the best pose for each pair, ``(K, K)``."""
    best = np.zeros((table.num_shapes, table.num_shapes))
    for probs in table.probs:  # (K, M)
        for exponent in _EXPONENTS:
            # 0 to the power 0 counts as 0: an outcome that one of the two shapes cannot give is left out.
            first = np.where(probs > 0.0, probs**exponent, 0.0)
            second = np.where(probs > 0.0, probs ** (1.0 - exponent), 0.0)
            with np.errstate(divide="ignore"):
                np.maximum(best, -np.log(np.minimum(first @ second.T, 1.0)), out=best)
    return best
