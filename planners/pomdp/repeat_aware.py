"""Value iteration that accounts for repeated touches: one set of alpha vectors per number of touches of an object.

There are few poses. A touch in a pose that was used before gives less information than a new one. A policy that ignores
this touches for too long. Here the t-th touch gives an outcome with probability w_t and nothing otherwise; after T
touches only CONFIRM and REJECT are left:

    W_T = max(CONFIRM, REJECT)
    W_t(b) = max(CONFIRM, REJECT, max_p -λ + w_t ∑_o p(o | b, p) W_{t+1}(b_o) + (1 - w_t) W_{t+1}(b))
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from belief.validation import Floats
from planners.pomdp.alpha_vectors import AlphaVectors
from planners.pomdp.belief_sampling import sample_beliefs
from planners.pomdp.solver import backup, different, improving, stopping_vectors
from planners.pomdp.stages import StagedProblem

_NUM_SEARCHES = 200
_EXPLORATION = 0.2
_NUM_BELIEFS = 250
_LEAST_GAIN = 1e-6


def repeat_aware_vectors(
    problem: StagedProblem, vectors: Sequence[AlphaVectors], weights: Floats, rng: np.random.Generator
) -> tuple[tuple[AlphaVectors, ...], ...]:
    """Alpha vectors for every stage, by number of touches of its object, from 0 to T.

    Args:
        problem: to be solved.
        vectors: solution without repeats; searches that follow it are simulated to sample beliefs.
        weights: w_1 … w_T, ``(T,)``, each in [0, 1].
        rng: of those searches.
    """
    sampled = sample_beliefs(problem, vectors, rng, _NUM_SEARCHES, _EXPLORATION)
    found: list[tuple[AlphaVectors, ...]] = []
    for number in reversed(range(len(problem.stages))):
        beliefs = _some(different(np.concatenate(sampled[number])), rng)
        following = found[-1][0] if found else None
        stops = stopping_vectors(problem, problem.stages[number], following, beliefs)
        likelihoods = np.ascontiguousarray(np.moveaxis(problem.likelihoods(number), 2, 1))  # (P, M, n)
        by_touches = [stops]
        for weight in weights[::-1]:
            probing = backup(problem, likelihoods, by_touches[-1], beliefs, float(weight))
            by_touches.append(stops.joined(improving(probing, beliefs, stops, _LEAST_GAIN)))
        found.append(tuple(by_touches[::-1]))
    return tuple(found[::-1])


def _some(beliefs: Floats, rng: np.random.Generator) -> Floats:
    """At most 250 of the beliefs; the first one, with which the stage begins, is always kept."""
    if len(beliefs) <= _NUM_BELIEFS:
        return beliefs
    chosen = 1 + rng.choice(len(beliefs) - 1, _NUM_BELIEFS - 1, replace=False)
    return beliefs[np.concatenate([[0], np.sort(chosen)])]
