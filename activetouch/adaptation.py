"""Adaptation of a sensor to the world that it is in, by touches made there: stiffness, and how far to trust touches.

    touches of some objects in this world  →  stiffness of pad and skin  →  hypotheses about bodies of this stiffness
                                           →  temperature of the ratios, where the shapes of the objects are known

The reader stays as it is. Those that were trained on a randomised scene (:mod:`activetouch.randomisation`) know
stiffness: one set-up has one stiffness, which all its touches tell together. For other readers only the temperature is
fitted: where touches tell less than the sensor takes them to tell, the belief becomes more modest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp

from activetouch.distributions import Constant, LogUniform
from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.sensor import TactileSensor
from belief.errors import InvalidArgument
from belief.observation_model.rigid_body import RigidBodyModel
from belief.touch_batch import TouchBatch

Floats = NDArray[np.float64]

GRID = np.geomspace(0.35, 2.8, 25)
"""Factors on the stiffness that are compared, relative to the pad's."""
_BODIES = 512  # hypotheses of each shape at every stiffness
_TAIL = 0.025  # of the posterior on either side of the range


@dataclass(frozen=True, eq=False)
class StiffnessPosterior:
    """What touches tell about the stiffness of a set-up, from equal probabilities of the values of :data:`GRID`.

    Attributes:
        log_probs: of each value, ``(G,)``.
    """

    log_probs: Floats

    @property
    def mode(self) -> float:
        """The most probable value."""
        return float(GRID[self.log_probs.argmax()])

    @property
    def interval(self) -> tuple[float, float]:
        """The range that holds 95 % of the probability, and the spacing of the grid on either side."""
        cumulative = np.exp(self.log_probs).cumsum()
        low, high = np.searchsorted(cumulative, (_TAIL, 1.0 - _TAIL))
        step = float(np.sqrt(GRID[1] / GRID[0]))
        return float(GRID[low]) / step, float(GRID[high]) * step


def stiffness_posterior(
    sensor: TactileSensor, touches: TouchBatch, shapes: ArrayLike | None = None
) -> StiffnessPosterior:
    """What touches tell about the stiffness.

    Args:
        sensor: with a joint model and a reader that knows stiffness.
        touches: of S objects, one sequence each.
        shapes: index of the shape of each object, ``(S,)``; None where nobody knows them.

    Raises:
        InvalidArgument: the sensor cannot tell, or there are no objects.
    """
    model = require_adaptable(sensor)
    if not sensor.reader.card.knows_stiffness:
        raise InvalidArgument(
            "touches read by this reader do not tell stiffness; it takes one trained on a collection of "
            "collect --randomised. With known shapes, the temperature can be adapted"
        )
    if not len(touches) or touches.features is None:
        raise InvalidArgument("adaptation needs touches with embeddings of at least one object")
    found = np.array([_log_likelihood(sensor, model, touches, shapes, value) for value in GRID])
    return StiffnessPosterior(found - logsumexp(found))


def adapted(
    sensor: TactileSensor, touches: TouchBatch, shapes: ArrayLike | None = None
) -> tuple[TactileSensor, StiffnessPosterior | None]:
    """A sensor whose hypotheses have the stiffness of this world; with known shapes, its temperature is refitted too.

    Args:
        sensor: with a joint model.
        touches: of S objects, one sequence each.
        shapes: index of the shape of each object, ``(S,)``; None where nobody knows them.

    Returns:
        The sensor, and what the touches told about the stiffness; None for a reader that does not know stiffness.

    Raises:
        InvalidArgument: the sensor cannot adapt, there are no objects, or their shapes are unknown and the reader does
            not know stiffness.
    """
    model, found = require_adaptable(sensor), None
    if sensor.reader.card.knows_stiffness or shapes is None:
        found = stiffness_posterior(sensor, touches, shapes)
        model = model.with_hypotheses(HypothesisTable(sensor.reader, sensor.scene, LogUniform(*found.interval)))
    if shapes is not None:
        model = model.refitted(touches, shapes)
    return replace(sensor, model=model), found


def require_adaptable(sensor: TactileSensor) -> RigidBodyModel:
    """The joint model of a sensor that can adapt.

    Raises:
        InvalidArgument: it cannot.
    """
    if not isinstance(sensor.model, RigidBodyModel):
        raise InvalidArgument(
            f"this sensor cannot adapt: its observation model is {sensor.model.name!r}, and it takes 'rigid body'"
        )
    return sensor.model


def _log_likelihood(
    sensor: TactileSensor, model: RigidBodyModel, touches: TouchBatch, shapes: ArrayLike | None, stiffness: float
) -> float:
    """Log likelihood of a stiffness, up to a constant."""
    model = model.with_hypotheses(HypothesisTable(sensor.reader, sensor.scene, Constant(stiffness)), _BODIES)
    assert touches.features is not None, "checked by the caller"
    sums = np.zeros((len(touches), len(model.shape_labels), _BODIES))
    for step in range(touches.num_touches):
        for pose in np.unique(touches.poses[:, step]).tolist():
            rows = np.flatnonzero(touches.poses[:, step] == pose)
            sums[rows] += model.scores(pose, np.asarray(touches.features[rows, step]))
    of_shapes = logsumexp(sums, axis=2)
    if shapes is None:
        return float(logsumexp(of_shapes, axis=1).sum())
    return float(of_shapes[np.arange(len(touches)), np.asarray(shapes)].sum())
