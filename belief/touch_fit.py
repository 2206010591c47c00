"""How well the touches of a search fit the world of their sensor, in two numbers that an alarm compares.

Four touches of one object that fit one hypothesis, and four that do not fit each other:

>>> from belief.observation_model import FixedHypotheses, RigidBodyModel
>>> one = np.ones((1, 1, 2))
>>> embed = FixedHypotheses(np.array([[[[3.0, 0.0]], [[0.0, 3.0]]]], np.float32))
>>> model = RigidBodyModel(("mug", "cup"), 1, 1.0, one, one, hypotheses=embed)
>>> alike = [Touch(0, features=np.array([1.0, 0.0])) for _ in range(4)]
>>> mixed = [Touch(0, features=np.roll([1.0, 0.0], turn)) for turn in range(4)]
>>> [round(number, 1) for touches in (alike, mixed) for number in touch_fit(model, [touches])]
[-0.1, -2.8, 3.0, -1.5]
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from belief.observation_model.evidence import start
from belief.observation_model.model import ObservationModel
from belief.observation_model.outcome_mixture import log_means, misfit
from belief.observation_model.rigid_body import joint_model
from belief.observation_model.sensor_health import SensorHealthModel
from belief.problem import Touch
from belief.validation import require_index


def touch_fit(model: ObservationModel, objects: Iterable[Sequence[Touch]], world: int = 0) -> tuple[float, float]:
    """Misfit and strangeness of the touches of some objects.

    The *misfit* of a touch after the first of an object is by how much it predicts itself better than the earlier
    touches predict it [nats]. The sum over n touches is divided by √n, so that it grows where every touch fits badly,
    but little with their number. It is 0 for models of independent touches. The *strangeness* is minus the log evidence
    per touch that the objects have known shapes, against the background. It is 0 where the state of the sensor is
    inferred, because usual evidence differs from world to world.
    """
    health = model if isinstance(model, SensorHealthModel) else None
    joint = joint_model(model if health is None else health.nominal)
    require_index("world", world, 1 if health is None else 1 + len(health.world_labels))
    surprise, evidence, number, later = 0.0, 0.0, 0, 0
    for touches in objects:
        number += len(touches)
        total, after = np.zeros((len(model.shape_labels), 1)), np.zeros(len(model.shape_labels))
        if joint is None and len(touches):
            known = start(model)
            for touch in touches:
                known = known.update(touch)
            after = np.asarray(known.log_likelihood)
        for place, touch in enumerate(touches if joint is not None else ()):
            assert joint is not None, "there are no touches otherwise"
            embedding = joint.embedding_of(touch)
            if world and health is not None:
                scores = health.scores_of(touch, embedding, np.array([world - 1]))[0]
            else:
                scores = joint.scores_of(touch, embedding)
            total, before = total + scores, after
            after = log_means(total)
            if place:
                surprise, later = surprise + float(misfit(scores, before, after)), later + 1
        evidence += float(np.logaddexp.reduce(after)) - np.log(len(after))
    strangeness = 0.0 if health is not None else float(-evidence / max(number, 1))
    return surprise / max(later, 1) ** 0.5, strangeness
