"""Synthetic worlds and random observation models, for tests, examples and planning without physics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import softmax

from belief.calibration import TemperatureScaling
from belief.constraints import FINITE, require_rule
from belief.errors import InvalidArgument
from belief.naming import Name, index_of
from belief.observation_model.confusion import ConfusionModel
from belief.observation_model.model import ObservationModel
from belief.problem import Touch
from belief.seeding import sample_arrangement
from belief.validation import require_count

__all__ = ["SyntheticWorld", "random_model", "sample_arrangement"]


def random_model(
    rng: np.random.Generator, num_shapes: int = 4, num_poses: int = 3, sharpness: float = 2.0
) -> ConfusionModel:
    """A per-pose confusion model with random positive entries; a larger ``sharpness`` gives a better sensor.

    >>> for sharpness in (0.0, 4.0):
    ...     table = random_model(np.random.default_rng(0), sharpness=sharpness).outcome_table()
    ...     print(table.probs.shape, float(table.information().mean().round(1)))
    (3, 4, 4) 0.1
    (3, 4, 4) 1.1
    """
    for name, number in (("num_shapes", num_shapes), ("num_poses", num_poses)):
        require_count(name, number, most=1000)
    require_rule("sharpness", sharpness, FINITE)
    scores = rng.normal(size=(num_poses, num_shapes, num_shapes)) + sharpness * np.eye(num_shapes)
    labels = tuple(f"shape_{k}" for k in range(num_shapes))
    return ConfusionModel(labels, softmax(scores, axis=2), TemperatureScaling(1.0, "ok"))


class SyntheticWorld:
    """Objects whose touches are drawn from an observation model, for which that model is exact.

    Args:
        model: source of the touches.
        arrangement: true shape of every object, by label or index, in order of visit.

    >>> world = SyntheticWorld(random_model(np.random.default_rng(0), sharpness=9.0), arrangement=[2, 0])
    >>> rng = np.random.default_rng(1)
    >>> first = world.touch(0, rng)
    >>> world.advance()
    >>> int(first.logits.argmax()), int(world.touch(0, rng).logits.argmax())
    (2, 0)
    """

    def __init__(self, model: ObservationModel, arrangement: Sequence[Name]) -> None:
        self._model = model
        self.arrangement = tuple(index_of("shape", model.shape_labels, shape) for shape in arrangement)
        self._current = 0

    def touch(self, pose: int, rng: np.random.Generator) -> Touch:
        """Touch the current object."""
        return self._model.sample(self.arrangement[self._current], [pose], rng)[0]

    def advance(self) -> None:
        """Go to the next object; raises InvalidArgument after the last."""
        if self._current + 1 >= len(self.arrangement):
            raise InvalidArgument(f"there is no object after the last of {len(self.arrangement)}")
        self._current += 1

    def reset(self) -> None:
        """Go to the first object."""
        self._current = 0
