"""A world sampled from an observation model: for tests, examples and planning without physics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from belief.observation_model import ObservationModel
from belief.problem import Composition, SearchProblem, Touch


def sample_arrangement(problem: SearchProblem, rng: np.random.Generator) -> tuple[int, ...]:
    """True shapes of a table of objects, drawn as the problem's composition says."""
    if problem.composition is Composition.DISTINCT:
        shapes = rng.permutation(problem.num_shapes)[: problem.num_objects]
    else:
        shapes = rng.integers(problem.num_shapes, size=problem.num_objects)
    return tuple(int(shape) for shape in shapes)


class SyntheticWorld:
    """Objects whose touches are drawn from an observation model, so that its beliefs are exactly right.

    Args:
        model: what touches are drawn from.
        arrangement: true shape of every object, in order of visit.
    """

    def __init__(self, model: ObservationModel, arrangement: Sequence[int]) -> None:
        self._model = model
        self.arrangement = tuple(arrangement)
        self._current = 0

    def touch(self, pose: int, rng: np.random.Generator) -> Touch:
        """Touch the current object."""
        return self._model.sample(self.arrangement[self._current], [pose], rng)[0]

    def advance(self) -> None:
        """Bring the next object."""
        self._current += 1
