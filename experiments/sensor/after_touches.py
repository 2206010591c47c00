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
        accuracy: share of sequences of touches whose likeliest shape is the true one.
        accuracy_interval: Wilson, of as many answers as there are objects. It is too wide rather than too narrow where
            objects have several sequences.
        nll: mean negative log posterior of the true shape [nats].
        nll_interval: bootstrap.
        stated: mean posterior of the likeliest shape.
        gap: stated minus accuracy.
        gap_interval: bootstrap.
    """

    touches: int
    accuracy: float
    accuracy_interval: tuple[float, float]
    nll: float
    nll_interval: tuple[float, float]
    stated: float
    gap: float
    gap_interval: tuple[float, float]


def after_touches(
    log_probs: NDArray[np.float64], shapes: NDArray[np.int64], objects: NDArray[np.int64], touches: int, seed: int
) -> AfterTouches:
    """How good posteriors are.

    Args:
        log_probs: log posteriors after S sequences of touches, ``(S, K)``.
        shapes: true shape of each, ``(S,)``.
        objects: which object each is of, ``(S,)``.
        touches: of each sequence; only noted.
        seed: of the bootstrap.
    """
    right, stated = log_probs.argmax(axis=1) == shapes, np.exp(log_probs.max(axis=1))
    number, num_objects = np.arange(len(shapes)), len(np.unique(objects))
    nll, *nll_interval = cluster_bootstrap(-log_probs[number, shapes], objects, np.random.default_rng(seed))
    gap, *gap_interval = cluster_bootstrap(stated - right, objects, np.random.default_rng(seed))
    return AfterTouches(
        touches,
        float(right.mean()),
        wilson_interval(round(right.mean() * num_objects), num_objects),
        nll,
        (nll_interval[0], nll_interval[1]),
        float(stated.mean()),
        gap,
        (gap_interval[0], gap_interval[1]),
    )
