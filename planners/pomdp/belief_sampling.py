"""Which beliefs searches come to: where it is worth planning well."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from belief.problem import Floats
from planners.pomdp.alpha_vectors import Plans
from planners.pomdp.stages import StagedProblem

_MOST_TOUCHES = 40
_GOING_ON = 0.75  # chance to probe once more while there are no plans
_ANYWHERE = 0.2  # share of one-object beginnings that are any belief, so that a policy is sound away from its prior too


def reached_beliefs(
    problem: StagedProblem,
    plans: Sequence[Plans] | None,
    rng: np.random.Generator,
    num_searches: int,
    exploration: float = 0.1,
) -> list[list[Floats]]:
    """Beliefs that simulated searches have, by stage and by number of touches in it.

    Args:
        problem: what is searched.
        plans: followed, one set a stage; random actions without.
        rng: of actions and outcomes.
        num_searches: how many.
        exploration: share of actions taken at random instead of as planned.

    Returns:
        For each stage, for each number of touches from 0, beliefs ``(B, n)``.
    """
    beliefs = np.tile(problem.initial, (num_searches, 1))
    if len(problem.stages) == 1:
        anywhere = rng.random(num_searches) < _ANYWHERE
        anywhere[0] = False
        possible = problem.initial > 0.0
        drawn = rng.dirichlet(np.full(int(possible.sum()), 0.7), size=int(anywhere.sum()))
        beliefs[np.ix_(anywhere, possible)] = drawn
    found = []
    for number, stage in enumerate(problem.stages):
        some = None if plans is None else plans[number]
        levels, rejected = _one_stage(problem, number, some, beliefs, rng, exploration)
        found.append(levels)
        if stage.moves is not None:
            after = rejected @ stage.moves
            beliefs = after / after.sum(axis=1, keepdims=True)
            missing = num_searches // 2 - len(beliefs)
            if missing > 0:
                beliefs = np.concatenate([beliefs, beliefs[rng.integers(len(beliefs), size=missing)]])
    return found


def _one_stage(
    problem: StagedProblem,
    number: int,
    plans: Plans | None,
    beliefs: Floats,
    rng: np.random.Generator,
    exploration: float,
) -> tuple[list[Floats], Floats]:
    """Beliefs by number of touches, and those at which the object is left."""
    num_poses = len(problem.outcome_probs)
    likelihoods = problem.likelihoods(number)
    levels, left = [beliefs], []
    for _ in range(_MOST_TOUCHES):
        actions = _actions(plans, beliefs, num_poses, rng, exploration)
        # Some of the confirmed are left too: plans for what follows must not fail where a decider errs.
        left.append(beliefs[(actions > num_poses) | ((actions == num_poses) & (rng.random(len(beliefs)) < 0.3))])
        probing = actions < num_poses
        if not probing.any():
            break
        beliefs = _touched(beliefs[probing], likelihoods[actions[probing]], rng)
        levels.append(beliefs)
    rejected = np.concatenate(left)
    return levels, rejected if len(rejected) else levels[0]


def _actions(
    plans: Plans | None, beliefs: Floats, num_poses: int, rng: np.random.Generator, exploration: float
) -> NDArray[np.int64]:
    if plans is None:
        poses = rng.integers(num_poses, size=len(beliefs))
        return np.where(rng.random(len(beliefs)) < _GOING_ON, poses, num_poses + 1)
    planned = plans.actions[plans.best(beliefs)]
    at_random = rng.integers(num_poses + 2, size=len(beliefs))
    return np.where(rng.random(len(beliefs)) < exploration, at_random, planned)


def _touched(beliefs: Floats, likelihoods: Floats, rng: np.random.Generator) -> Floats:
    """Posteriors of beliefs ``(B, n)`` after an outcome drawn from ``likelihoods (B, n, M)``."""
    joint = beliefs[:, :, None] * likelihoods
    chances = joint.sum(axis=1)  # (B, M)
    drawn = rng.random((len(chances), 1)) * chances.sum(axis=1, keepdims=True)
    # The last outcome that has any chance bounds the draw, so that rounding picks no impossible one.
    last = chances.shape[1] - 1 - (chances[:, ::-1] > 0.0).argmax(axis=1)
    outcomes = np.minimum((chances.cumsum(axis=1) <= drawn).sum(axis=1), last)
    posterior = joint[np.arange(len(joint)), :, outcomes]
    return np.asarray(posterior / posterior.sum(axis=1, keepdims=True))
