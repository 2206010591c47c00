r"""How many touches telling two shapes apart takes, whatever the decider: bounds from the table alone.

To tell shape a from shape b with error rate ε each way, however poses are chosen and whenever one stops, the expected
number of touches is at least (Wald 1945; the data processing inequality)

    E_a[touches] ≥ d(ε) / max_pose KL(p(· | pose, a) ‖ p(· | pose, b)),     d(ε) = (1 - 2ε) log((1 - ε) / ε)

The Chernoff information C = max_pose max_s -log ∑_o p(o | a)^s p(o | b)^(1-s) is the rate of a fixed number of touches
in one pose: its error falls like exp(-C n). Where it is zero in every pose, no number of touches tells the two apart.

Touches are taken for independent given the shape, as in the table; repeats in one pose tell less, so that the bounds
hold for them all the more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import rel_entr

from belief.observation_model import OutcomeTable
from belief.problem import Floats

_SAME = 1e-12  # nats of divergence below which rounding makes all the difference
_EXPONENTS = np.linspace(0.0, 1.0, 201)


@dataclass(frozen=True, eq=False)
class TouchLimits:
    """Bounds for every pair of shapes.

    Attributes:
        error: ε, for which ``least_touches`` holds.
        least_touches: on average, of any decider, if the shape is the first of the pair, ``(K, K)``; infinite where no
            pose tells the two apart, zero where one touch can decide and the diagonal.
        best_poses: whose divergence sets the bound, ``(K, K)``; -1 where none has any.
        chernoff: information of the best pose [nats a touch], ``(K, K)``, symmetric; infinite where one touch tells.
    """

    error: float
    least_touches: Floats
    best_poses: Floats
    chernoff: Floats

    @property
    def indistinguishable(self) -> list[tuple[int, int]]:
        """Pairs of shapes that no pose tells apart, the lower index first."""
        first, second = np.nonzero(np.triu(self.best_poses < 0, k=1))
        return list(zip(first.tolist(), second.tolist(), strict=True))


def touch_limits(table: OutcomeTable, error: float = 0.01) -> TouchLimits:
    """Bounds on telling any two shapes apart.

    Args:
        table: p(outcome | pose, shape).
        error: ε, of taking either for the other, in (0, 1/2).

    Raises:
        ValueError: the error is out of range.

    A pose that is right nine times in ten tells 0.8 log 9 = 1.76 nats a touch, and 1 % error takes 4.50:

    >>> limits = touch_limits(OutcomeTable(np.array([[[0.9, 0.1], [0.1, 0.9]], [[0.5, 0.5], [0.5, 0.5]]])))
    >>> limits.least_touches.round(2).tolist(), limits.best_poses.tolist()
    ([[0.0, 2.56], [2.56, 0.0]], [[-1, 0], [0, -1]])
    >>> limits.chernoff.round(3).tolist(), limits.indistinguishable
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
    return TouchLimits(error, least, np.where(tells, divergence.argmax(axis=0), -1), chernoff)


def _chernoff(table: OutcomeTable) -> Floats:
    """Of the best pose for each pair, ``(K, K)``."""
    best = np.zeros((table.num_shapes, table.num_shapes))
    for probs in table.probs:  # (K, M)
        for exponent in _EXPONENTS:
            # 0 to the power 0 is taken for 0: an outcome that one of the two cannot give does not count.
            first = np.where(probs > 0.0, probs**exponent, 0.0)
            second = np.where(probs > 0.0, probs ** (1.0 - exponent), 0.0)
            with np.errstate(divide="ignore"):
                np.maximum(best, -np.log(np.minimum(first @ second.T, 1.0)), out=best)
    return best
