"""Upper bound for one object of many shapes: a searcher who is told beforehand which few it can have.

Grids over many shapes are coarse. Here all shapes but one are put in groups, and before the first touch the searcher
hears the name of a group: the one that the object's shape is in, or, if it has the shape left out, any, by their
chances. Who is told more can only do better, and then has to tell few shapes apart. Shapes that feel most like the one
left out share groups, so that telling which group it is helps little.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from belief.problem import Floats
from planners.solve.bounds import ObjectBound
from planners.solve.terms import TouchTerms

_MOST_SHAPES = 6  # that one grid is for
_GROUP = 3


class GroupedBound:
    """Upper bounds for one object, whatever it pays to stop.

    Args:
        likelihoods: p(outcome | pose, shape), ``(P, K, M)``.
        shapes: indices of those it can have, increasing.
        apart: index of the shape that is in no group: of the target, for a bound that is tight.
        terms: on which it can be touched.
        rng: samples where grids are fine; any grid gives a bound.
    """

    def __init__(
        self,
        likelihoods: Floats,
        shapes: NDArray[np.int64],
        apart: int,
        terms: TouchTerms,
        rng: np.random.Generator,
    ) -> None:
        self._apart = apart
        others = shapes[shapes != apart]
        alike = np.sqrt(likelihoods[:, [apart]] * likelihoods[:, others]).sum(axis=2).mean(axis=0)
        size = _GROUP if len(shapes) > _MOST_SHAPES else len(shapes)
        ranked = others[np.argsort(-alike, kind="stable")]
        self._groups = [ranked[first : first + size] for first in range(0, len(ranked), size)]
        self._bounds = [
            ObjectBound(likelihoods, np.sort(np.append(group, apart)), terms, rng) for group in self._groups
        ]

    def __call__(self, belief: Floats, confirm: Floats, reject: Floats) -> float:
        """A number that no policy is worth more than at a belief; all by shape, ``(K,)``."""
        total = belief.sum() - belief[self._apart]
        if total <= 0.0:
            return float(max(confirm[self._apart], reject[self._apart]))
        worth = 0.0
        for group, bound in zip(self._groups, self._bounds, strict=True):
            told = np.zeros_like(belief)
            told[group] = belief[group]
            told[self._apart] = belief[self._apart] * belief[group].sum() / total
            chance = told.sum()
            if chance > 0.0:
                worth += chance * bound(told / chance, confirm, reject)
        return worth
