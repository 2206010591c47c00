"""The misfit of a touch relative to that of objects whose shape was known as well before the touch.

A touch tells more about an object that is little known, and then fits its earlier touches less well. A search goes on
with objects that are little known, so their misfits must be compared with those of others like them.

>>> rng = np.random.default_rng(0)
>>> certainties = rng.uniform(size=(1000, 2))
>>> misfits = (1.0 - certainties) * rng.exponential(size=(1000, 2))
>>> usual = UsualMisfit.fit(misfits, certainties)
>>> [round(float(usual.standardised(1, 0.5, certainty)), 1) for certainty in (0.05, 0.95)]
[-0.2, 4.7]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from belief.frozen import FrozenArrays
from belief.validation import Floats

_MOST_GROUPS = 6
_IN_A_GROUP = 50  # objects, at least
_HIGH = 0.8  # quantile; its distance from the median is the width
_LEAST_WIDTH = 1e-2  # nats
_WIDEST = 1e3  # nats


@dataclass(frozen=True, eq=False)
class UsualMisfit(FrozenArrays):
    """Median and width of the misfit after equally many touches, in G groups by the certainty of the shape.

    Attributes:
        edges: certainties between the groups, increasing, ``(T, G - 1)``.
        medians: nats, ``(T, G)``.
        widths: from the median to the 80 % quantile, nats, ``(T, G)``.
    """

    edges: Floats
    medians: Floats
    widths: Floats

    @classmethod
    def fit(cls, misfits: Floats, certainties: Floats) -> UsualMisfit:
        """Fit to S sequences of T touches, rounded to single precision.

        Args:
            misfits: of each touch to the earlier ones, ``(S, T)``.
            certainties: largest posterior of a shape before each touch, in [0, 1], ``(S, T)``.
        """
        number, length = misfits.shape
        groups = min(_MOST_GROUPS, max(1, number // _IN_A_GROUP))
        limited = np.clip(misfits, -_WIDEST, _WIDEST)
        edges = np.quantile(certainties, np.arange(1, groups) / groups, axis=0).T.astype(np.float32)
        medians, widths = np.empty((length, groups)), np.empty((length, groups))
        for step in range(length):
            group = edges[step].searchsorted(certainties[:, step], side="right")
            for one in range(groups):
                some = limited[group == one, step] if (group == one).any() else limited[:, step]
                medians[step, one], high = np.quantile(some, [0.5, _HIGH])
                widths[step, one] = max(high - medians[step, one], _LEAST_WIDTH)
        return cls(*(array.astype(np.float32).astype(np.float64) for array in (edges, medians, widths)))

    def standardised(self, step: int, misfit: Floats | float, certainty: Floats | float) -> Floats:
        """Misfits less the median of their group, in its widths.

        Args:
            step: number of earlier touches of the object, below T.
            misfit: of some touches, ``(...)``.
            certainty: largest posterior of a shape before each touch, ``(...)``.
        """
        group = self.edges[step].searchsorted(certainty, side="right")
        limited = np.minimum(np.maximum(misfit, -_WIDEST), _WIDEST)
        return np.asarray((limited - self.medians[step][group]) / self.widths[step][group])
