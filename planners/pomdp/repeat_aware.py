"""Plans for touches that repeat each other: one set for each number of touches an object has had.

Poses are few. Once all were used, a touch tells only a share of what a fresh one would, and a plan that counts on fresh
ones goes on for ever in the hope of them. Here the t-th touch shows an outcome with probability w_t only, else nothing,
and after the last one can but stop:

    W_T = max of the stops,   W_t(b) = max(stops, max_p -λ + w_t ∑_o p(o | b, p) W_{t+1}(b_o) + (1 - w_t) W_{t+1}(b))
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from belief.problem import Floats
from planners.pomdp.alpha_vectors import Plans
from planners.pomdp.belief_sampling import reached_beliefs
from planners.pomdp.solver import backup, different, improving, stopping_plans
from planners.pomdp.stages import StagedProblem

_NUM_SEARCHES = 200
_EXPLORATION = 0.2
_NUM_BELIEFS = 250
_LEAST_GAIN = 1e-6


def limited_plans(
    problem: StagedProblem, plans: Sequence[Plans], weights: Floats, rng: np.random.Generator
) -> list[list[Plans]]:
    """Plans for every stage, by number of touches of its object so far, from 0 to T.

    Args:
        problem: what to solve.
        plans: for touches that are all fresh; searches that follow them show at which beliefs to plan.
        weights: w, of the first touch, the second, and so on, ``(T,)``, each in [0, 1].
        rng: of those searches.
    """
    reached = reached_beliefs(problem, plans, rng, _NUM_SEARCHES, _EXPLORATION)
    found: list[list[Plans]] = []
    for number in reversed(range(len(problem.stages))):
        beliefs = _some(different(np.concatenate(reached[number])), rng)
        following = found[-1][0] if found else None
        stops = stopping_plans(problem, problem.stages[number], following, beliefs)
        likelihoods = np.ascontiguousarray(np.moveaxis(problem.likelihoods(number), 2, 1))  # (P, M, n)
        by_touches = [stops]
        for weight in weights[::-1]:
            probing = backup(problem, likelihoods, by_touches[-1], beliefs, float(weight))
            by_touches.append(stops.joined(improving(probing, beliefs, stops, _LEAST_GAIN)))
        found.append(by_touches[::-1])
    return found[::-1]


def _some(beliefs: Floats, rng: np.random.Generator) -> Floats:
    """At most so many; the first, where the stage begins, is always among them."""
    if len(beliefs) <= _NUM_BELIEFS:
        return beliefs
    chosen = 1 + rng.choice(len(beliefs) - 1, _NUM_BELIEFS - 1, replace=False)
    return beliefs[np.concatenate([[0], np.sort(chosen)])]
