"""Cost of a belief about one object with an observation model: memory, and time for a touch."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from belief.observation_model.model import ArrayModel
from belief.problem import Touch

_UPDATES = 50


@dataclass(frozen=True)
class BeliefCost:
    """Memory of an observation model's arrays [MB], and time to add a touch and compute all likelihoods [ms]."""

    memory: float
    update: float


def belief_cost(model: ArrayModel, num_features: int) -> BeliefCost:
    """Measure an observation model, which has its hypotheses already if it needs any."""
    rng = np.random.default_rng(0)
    touches = [
        Touch(
            number % model.num_poses,
            rng.normal(size=len(model.shape_labels)),
            rng.normal(size=num_features).astype(np.float32),
        )
        for number in range(_UPDATES)
    ]
    evidence = model.start().update(touches[0])
    started = time.thread_time()
    for touch in touches:
        evidence = evidence.update(touch)
        _ = evidence.log_likelihood
    seconds = (time.thread_time() - started) / _UPDATES
    held = [*vars(model).values(), getattr(model, "table", None)]  # of a joint model, embedded at first use
    arrays = {id(value): value.nbytes for value in held if isinstance(value, np.ndarray)}
    return BeliefCost(sum(arrays.values()) / 1e6, 1e3 * seconds)
