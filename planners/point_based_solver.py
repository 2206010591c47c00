r"""Point-based value iteration (Pineau, Gordon & Thrun 2003) on a staged touch problem.

The value of any conditional plan is linear in the belief: an alpha vector. The maximum of several, V(b) = max α·b, is
a lower bound on the optimal value, and the policy of these plans achieves it. A backup at a belief b gives the alpha
vector of the best plan that probes once and continues with a known plan:

    α_p = -λ + γ ∑_o p(o | pose p, ·) ⊙ argmax_α  (b ⊙ p(o | p, ·)) · α

Backups are made at beliefs that simulated searches reach under the current policy. Beliefs after most touches come
first, because the values of the others depend on theirs; one pass in this order replaces many sweeps. Simulation and
backups alternate, in rounds of increasing size. One matrix product serves all beliefs, poses and outcomes.

There are few poses, and a touch in one that was used before gives less information than a new one. A policy that
ignores this touches for too long. A repeat-aware policy has a set of vectors for each number of touches of an object:
the t-th touch gives an outcome with probability w_t and nothing otherwise; after T touches one has to stop:

    W_T = max(CONFIRM, REJECT)
    W_t(b) = max(CONFIRM, REJECT, max_p -λ + w_t ∑_o p(o | b, p) W_{t+1}(b_o) + (1 - w_t) W_{t+1}(b))
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from belief.validation import Floats
from planners.touch_problem import Stage, StagedProblem

_LEAST_GAIN = 1e-5  # in value at its own belief, for a vector to be kept
_BLOCK = 3_000_000  # numbers in the largest array
_MOST_BELIEFS = 6_000  # with a backup, per stage and round
_DECIMALS = 3  # of beliefs; those that differ less count as one
_REPEAT_SEARCHES = 200
_REPEAT_EXPLORATION = 0.2
_REPEAT_GAIN = 1e-6
_NUM_BELIEFS = 250
_MOST_TOUCHES = 40
_PROBE_PROB = 0.75  # of one more probe by the random policy
_RANDOM_PRIORS = 0.2  # fraction of one-object tests that start from a random belief, so that policies hold for it too


@dataclass(frozen=True, eq=False)
class AlphaVectors:
    """Alpha vectors ``(A, n)`` of one stage and their first actions ``(A,)``; the value at a belief b is max α·b.

    An action is a pose, P for CONFIRM, or P + 1 for REJECT.
    """

    alphas: Floats
    actions: NDArray[np.int64]

    def best(self, beliefs: Floats) -> NDArray[np.int64]:
        """Index of the best vector at each belief ``(B, n)``; the first of equally good ones."""
        return np.asarray((beliefs @ self.alphas.T).argmax(axis=1))

    def value(self, beliefs: Floats) -> Floats:
        """Value at each belief ``(B, n)``, normalised or not, ``(B,)``."""
        return np.asarray((beliefs @ self.alphas.T).max(axis=1))

    def useful(self, beliefs: Floats) -> AlphaVectors:
        """Only the vectors that are best at one of the beliefs ``(B, n)``."""
        kept = np.unique(self.best(beliefs))
        return AlphaVectors(self.alphas[kept], self.actions[kept])

    def joined(self, other: AlphaVectors) -> AlphaVectors:
        """These vectors, followed by the others."""
        return AlphaVectors(np.concatenate([self.alphas, other.alphas]), np.concatenate([self.actions, other.actions]))


def point_based_value_iteration(
    problem: StagedProblem, rng: np.random.Generator, rounds: Sequence[int]
) -> list[AlphaVectors]:
    """Alpha vectors for every stage; ``rounds`` are numbers of simulated searches."""
    if problem.touch_cost == 0.0 and problem.discount == 1.0:
        raise ValueError(
            "touch_cost is 0 and discount is 1: touching for ever costs nothing, so no policy is optimal. Give "
            "touches a cost, or a touch limit with finite_horizon_value"
        )
    vectors: list[AlphaVectors] | None = None
    for num_searches in rounds:
        vectors = _backward(problem, sample_beliefs(problem, vectors, rng, num_searches), vectors)
    assert vectors is not None, "there is at least one round"
    return vectors


def _backward(
    problem: StagedProblem, sampled: list[list[Floats]], known: list[AlphaVectors] | None
) -> list[AlphaVectors]:
    """Alpha vectors for all stages, computed from the last to the first; known ones are kept if best at some belief."""
    solved: list[AlphaVectors] = []
    for number in reversed(range(len(problem.stages))):
        beliefs = np.concatenate(sampled[number])
        vectors = stopping_vectors(problem, problem.stages[number], solved[-1] if solved else None, beliefs)
        num_stops = len(vectors.alphas)
        if known is not None:
            old = known[number]
            is_probe = old.actions < len(problem.outcome_probs)
            vectors = vectors.joined(AlphaVectors(old.alphas[is_probe], old.actions[is_probe]))
        likelihoods = np.ascontiguousarray(np.moveaxis(problem.likelihoods(number), 2, 1))  # (P, M, n)
        share = min(1.0, _MOST_BELIEFS / len(beliefs))
        for level in reversed(sampled[number]):
            some = different(level[: ceil(share * len(level))])
            probing = backup(problem, likelihoods, vectors, some)
            vectors = vectors.joined(improving(probing, some, vectors, _LEAST_GAIN))
        kept = np.union1d(
            np.unique(vectors.best(beliefs)), np.arange(min(2, num_stops))
        )  # CONFIRM and REJECT are always kept
        solved.append(AlphaVectors(vectors.alphas[kept], vectors.actions[kept]))
    return solved[::-1]


def repeat_aware_vectors(
    problem: StagedProblem, vectors: Sequence[AlphaVectors], weights: Floats, rng: np.random.Generator
) -> tuple[tuple[AlphaVectors, ...], ...]:
    """Alpha vectors for every stage, by number of touches of its object, from 0 to T; ``weights`` are w_1 … w_T.

    Searches that follow ``vectors``, the solution without repeats, give the beliefs.
    """
    sampled = sample_beliefs(problem, vectors, rng, _REPEAT_SEARCHES, _REPEAT_EXPLORATION)
    found: list[tuple[AlphaVectors, ...]] = []
    for number in reversed(range(len(problem.stages))):
        beliefs = _some(different(np.concatenate(sampled[number])), rng)
        following = found[-1][0] if found else None
        stops = stopping_vectors(problem, problem.stages[number], following, beliefs)
        likelihoods = np.ascontiguousarray(np.moveaxis(problem.likelihoods(number), 2, 1))  # (P, M, n)
        by_touches = [stops]
        for weight in weights[::-1]:
            probing = backup(problem, likelihoods, by_touches[-1], beliefs, float(weight))
            by_touches.append(stops.joined(improving(probing, beliefs, stops, _REPEAT_GAIN)))
        found.append(tuple(by_touches[::-1]))
    return tuple(found[::-1])


def stopping_vectors(
    problem: StagedProblem, stage: Stage, following: AlphaVectors | None, beliefs: Floats
) -> AlphaVectors:
    """Alpha vectors of CONFIRM, and of REJECT followed by each vector of the next stage that is best at some belief."""
    num_poses = len(problem.outcome_probs)
    rejects = stage.reject[None]
    if following is not None:
        assert stage.moves is not None, "only the last stage has no successor"
        rejects = rejects + problem.discount * following.alphas @ stage.moves.T
    rejecting = AlphaVectors(rejects, np.full(len(rejects), num_poses + 1)).useful(beliefs)
    return AlphaVectors(stage.confirm[None], np.array([num_poses])).joined(rejecting)


def improving(found: AlphaVectors, beliefs: Floats, known: AlphaVectors, least_gain: float) -> AlphaVectors:
    """Of the vectors found, one per belief, those that have a higher value there than all known ones."""
    better = (found.alphas * beliefs).sum(axis=1) - known.value(beliefs) > least_gain
    some = AlphaVectors(found.alphas[better], found.actions[better])
    return some.useful(beliefs) if better.any() else some


def backup(
    problem: StagedProblem, likelihoods: Floats, vectors: AlphaVectors, beliefs: Floats, weight: float = 1.0
) -> AlphaVectors:
    """The alpha vector of the best plan that begins with a probe, then follows ``vectors``, for each belief ``(B, n)``.

    ``likelihoods`` are p(outcome | pose, state), ``(P, M, n)``; a probe gives an outcome with the probability
    ``weight``, and nothing otherwise.
    """
    num_poses, num_outcomes, num_states = likelihoods.shape
    single = likelihoods.reshape(-1, num_states).astype(np.float32)
    transposed = np.ascontiguousarray(vectors.alphas.T, np.float32)  # for the choice of a vector; values are in float64
    rows = max(1, _BLOCK // (num_poses * num_outcomes * max(num_states, len(vectors.alphas))))
    alphas, actions = [], []
    for first in range(0, len(beliefs), rows):
        some = beliefs[first : first + rows]
        joint = some.astype(np.float32)[:, None] * single  # (B, P M, n)
        best = (joint.reshape(-1, num_states) @ transposed).argmax(axis=1).reshape(-1, num_poses, num_outcomes)
        candidates = np.empty((len(some), num_poses, num_states))
        for pose in range(num_poses):
            candidates[:, pose] = np.einsum("mn,bmn->bn", likelihoods[pose], vectors.alphas[best[:, pose]])
        if weight < 1.0:
            candidates = weight * candidates + (1.0 - weight) * vectors.alphas[vectors.best(some)][:, None]
        candidates = problem.discount * candidates - problem.touch_cost
        pose_of = np.einsum("bpn,bn->bp", candidates, some).argmax(axis=1)
        alphas.append(candidates[np.arange(len(some)), pose_of])
        actions.append(pose_of)
    return AlphaVectors(np.concatenate(alphas), np.concatenate(actions))


def different(beliefs: Floats) -> Floats:
    """Beliefs ``(B, n)`` in their order, without those that nearly equal another."""
    _, index = np.unique(beliefs.round(_DECIMALS), axis=0, return_index=True)
    return beliefs[np.sort(index)]


def _some(beliefs: Floats, rng: np.random.Generator) -> Floats:
    """At most 250 of the beliefs; the first one, with which the stage begins, is always kept."""
    if len(beliefs) <= _NUM_BELIEFS:
        return beliefs
    chosen = 1 + rng.choice(len(beliefs) - 1, _NUM_BELIEFS - 1, replace=False)
    return beliefs[np.concatenate([[0], np.sort(chosen)])]


def sample_beliefs(
    problem: StagedProblem,
    vectors: Sequence[AlphaVectors] | None,
    rng: np.random.Generator,
    num_searches: int,
    exploration: float = 0.1,
) -> list[list[Floats]]:
    """Beliefs ``(B, n)`` of simulated searches, by stage and by number of touches in the stage.

    The searches follow ``vectors``, with a fraction ``exploration`` of random actions; without them, all are random.
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
