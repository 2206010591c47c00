"""How good the posterior of an object is after a number of touches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from belief.statistics import cluster_bootstrap, wilson_interval


@dataclass(frozen=True)
class AfterTouches:
    """How good a model is after some touches of an object, with 95 % intervals over objects.

    Attributes:
        touches: how many.
        accuracy: share of objects whose likeliest shape is the true one.
        accuracy_interval: Wilson.
        nll: mean negative log posterior of the true shape [nats].
        nll_interval: bootstrap.
        stated: mean posterior of the likeliest shape.
    """

    touches: int
    accuracy: float
    accuracy_interval: tuple[float, float]
    nll: float
    nll_interval: tuple[float, float]
    stated: float


def after_touches(log_probs: NDArray[np.float64], shapes: NDArray[np.int64], touches: int, seed: int) -> AfterTouches:
    """How good posteriors of objects are.

    Args:
        log_probs: log posteriors of objects, ``(M, K)``.
        shapes: true shapes, ``(M,)``.
        touches: of each object; only noted.
        seed: of the bootstrap.
    """
    number = np.arange(len(shapes))
    right = log_probs.argmax(axis=1) == shapes
    nll, *interval = cluster_bootstrap(-log_probs[number, shapes], number, np.random.default_rng(seed))
    return AfterTouches(
        touches,
        float(right.mean()),
        wilson_interval(int(right.sum()), len(right)),
        nll,
        (interval[0], interval[1]),
        float(np.exp(log_probs.max(axis=1)).mean()),
    )
