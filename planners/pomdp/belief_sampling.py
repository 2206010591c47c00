"""Beliefs that simulated searches reach, at which the solver improves its policy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from belief.validation import Floats
from planners.pomdp.alpha_vectors import AlphaVectors
from planners.pomdp.stages import StagedProblem

_MOST_TOUCHES = 40
_PROBE_PROB = 0.75  # of one more probe by the random policy
_RANDOM_PRIORS = 0.2  # fraction of one-object tests that start from a random belief, so that policies hold for it too


def sample_beliefs(
    problem: StagedProblem,
    vectors: Sequence[AlphaVectors] | None,
    rng: np.random.Generator,
    num_searches: int,
    exploration: float = 0.1,
) -> list[list[Floats]]:
    """Beliefs ``(B, n)`` of simulated searches, by stage and by number of touches in the stage.

    The searches follow the policy of ``vectors``, one set per stage, but for a fraction ``exploration`` of random
    actions; all actions are random without it.
    """
    beliefs = np.tile(problem.initial, (num_searches, 1))
    if len(problem.stages) == 1:
        from_random = rng.random(num_searches) < _RANDOM_PRIORS
        from_random[0] = False
        possible = problem.initial > 0.0
        drawn = rng.dirichlet(np.full(int(possible.sum()), 0.7), size=int(from_random.sum()))
        beliefs[np.ix_(from_random, possible)] = drawn
    found = []
    for number, stage in enumerate(problem.stages):
        some = None if vectors is None else vectors[number]
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
    vectors: AlphaVectors | None,
    beliefs: Floats,
    rng: np.random.Generator,
    exploration: float,
) -> tuple[list[Floats], Floats]:
    """Beliefs by number of touches, and those at which the object is rejected."""
    num_poses = len(problem.outcome_probs)
    likelihoods = problem.likelihoods(number)
    levels, left = [beliefs], []
    for _ in range(_MOST_TOUCHES):
        actions = _actions(vectors, beliefs, num_poses, rng, exploration)
        # Some confirmed objects count as rejected too, so that later stages are solved for beliefs after an error.
        left.append(beliefs[(actions > num_poses) | ((actions == num_poses) & (rng.random(len(beliefs)) < 0.3))])
        probing = actions < num_poses
        if not probing.any():
            break
        beliefs = _touched(beliefs[probing], likelihoods[actions[probing]], rng)
        levels.append(beliefs)
    rejected = np.concatenate(left)
    return levels, rejected if len(rejected) else levels[0]


def _actions(
    vectors: AlphaVectors | None, beliefs: Floats, num_poses: int, rng: np.random.Generator, exploration: float
) -> NDArray[np.int64]:
    if vectors is None:
        poses = rng.integers(num_poses, size=len(beliefs))
        return np.where(rng.random(len(beliefs)) < _PROBE_PROB, poses, num_poses + 1)
    planned = vectors.actions[vectors.best(beliefs)]
    at_random = rng.integers(num_poses + 2, size=len(beliefs))
    return np.where(rng.random(len(beliefs)) < exploration, at_random, planned)


def _touched(beliefs: Floats, likelihoods: Floats, rng: np.random.Generator) -> Floats:
    """Posteriors of beliefs ``(B, n)`` after an outcome drawn from ``likelihoods (B, n, M)``."""
    joint = beliefs[:, :, None] * likelihoods
    chances = joint.sum(axis=1)  # (B, M)
    drawn = rng.random((len(chances), 1)) * chances.sum(axis=1, keepdims=True)
    # Bounded by the last possible outcome, so that rounding never draws an impossible one.
    last = chances.shape[1] - 1 - (chances[:, ::-1] > 0.0).argmax(axis=1)
    outcomes = np.minimum((chances.cumsum(axis=1) <= drawn).sum(axis=1), last)
    posterior = joint[np.arange(len(joint)), :, outcomes]
    return np.asarray(posterior / posterior.sum(axis=1, keepdims=True))
