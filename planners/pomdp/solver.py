r"""Point-based value iteration (Pineau, Gordon & Thrun 2003) on a staged touch problem.

The value of any plan is linear in the belief, so a set of plans is a set of vectors α, and the best of them a lower
bound V(b) = max α·b that is piecewise linear, convex, and *achieved*. A backup at a belief b makes the best plan that
probes once and then goes on with known plans:

    α_p = -λ + γ ∑_o p(o | pose p, ·) ⊙ argmax_α  (b ⊙ p(o | p, ·)) · α

Beliefs to back up at are those that searches following the plans so far come to, those with most touches first, because
their values are what the others build on: one pass does what sweeps in no order need many for. Rounds of simulating
and backing up alternate, larger each time. All of it is arrays: one matrix product for all beliefs, poses and outcomes.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np

from belief.problem import Floats
from planners.pomdp.alpha_vectors import Plans
from planners.pomdp.belief_sampling import reached_beliefs
from planners.pomdp.stages import Stage, StagedProblem

_LEAST_GAIN = 1e-5  # of value at its own belief, for a plan to be kept
_BLOCK = 3_000_000  # numbers in the largest array
_MOST_BELIEFS = 6_000  # of a stage and round to back up at
_ALIKE = 3  # decimals beyond which beliefs are taken for one


def point_based(problem: StagedProblem, rng: np.random.Generator, rounds: Sequence[int]) -> list[Plans]:
    """Plans for every stage.

    Args:
        problem: what to solve; needs a touch cost or a discount, or touching on would never end.
        rng: of the simulated searches.
        rounds: how many searches to simulate in each round.

    Raises:
        ValueError: touches cost nothing and nothing is discounted.
    """
    if problem.touch_cost == 0.0 and problem.discount == 1.0:
        raise ValueError(
            "touch_cost is 0 and discount is 1: touching on for ever costs nothing, so there is no best plan. Give "
            "touches a cost, or a touch limit with finite_horizon_value"
        )
    plans: list[Plans] | None = None
    for num_searches in rounds:
        plans = _backward(problem, reached_beliefs(problem, plans, rng, num_searches), plans)
    assert plans is not None, "there is at least one round"
    return plans


def _backward(problem: StagedProblem, reached: list[list[Floats]], known: list[Plans] | None) -> list[Plans]:
    """Plans for all stages, the last first; those known are kept where they are the best at a reached belief."""
    solved: list[Plans] = []
    for number in reversed(range(len(problem.stages))):
        beliefs = np.concatenate(reached[number])
        plans = stopping_plans(problem, problem.stages[number], solved[-1] if solved else None, beliefs)
        num_stops = len(plans.alphas)
        if known is not None:
            old = known[number]
            is_probe = old.actions < len(problem.outcome_probs)
            plans = plans.joined(Plans(old.alphas[is_probe], old.actions[is_probe]))
        likelihoods = np.ascontiguousarray(np.moveaxis(problem.likelihoods(number), 2, 1))  # (P, M, n)
        share = min(1.0, _MOST_BELIEFS / len(beliefs))
        for level in reversed(reached[number]):
            some = different(level[: ceil(share * len(level))])
            probing = backup(problem, likelihoods, plans, some)
            plans = plans.joined(improving(probing, some, plans, _LEAST_GAIN))
        kept = np.union1d(np.unique(plans.best(beliefs)), np.arange(min(2, num_stops)))  # what stops is always there
        solved.append(Plans(plans.alphas[kept], plans.actions[kept]))
    return solved[::-1]


def stopping_plans(problem: StagedProblem, stage: Stage, following: Plans | None, beliefs: Floats) -> Plans:
    """CONFIRM, then REJECT with each plan for what follows that is best at a belief."""
    num_poses = len(problem.outcome_probs)
    rejects = stage.reject[None]
    if following is not None:
        assert stage.moves is not None, "only the last stage leads nowhere"
        rejects = rejects + problem.discount * following.alphas @ stage.moves.T
    rejecting = Plans(rejects, np.full(len(rejects), num_poses + 1)).useful(beliefs)
    return Plans(stage.confirm[None], np.array([num_poses])).joined(rejecting)


def improving(found: Plans, beliefs: Floats, known: Plans, least_gain: float) -> Plans:
    """Those of the plans found, one for each belief, that are worth more there than any known, without needless ones.

    >>> known = Plans(np.array([[0.0, 0.0]]), np.array([1]))
    >>> found = Plans(np.array([[0.5, 0.1], [-0.2, 0.1]]), np.array([0, 0]))
    >>> improving(found, np.array([[0.9, 0.1], [0.8, 0.2]]), known, least_gain=0.01).alphas.tolist()
    [[0.5, 0.1]]
    """
    better = (found.alphas * beliefs).sum(axis=1) - known.value(beliefs) > least_gain
    some = Plans(found.alphas[better], found.actions[better])
    return some.useful(beliefs) if better.any() else some


def backup(problem: StagedProblem, likelihoods: Floats, plans: Plans, beliefs: Floats, weight: float = 1.0) -> Plans:
    """The best plan that begins with a probe, at each belief.

    Args:
        problem: gives touch cost and discount.
        likelihoods: p(outcome | pose, state), ``(P, M, n)``.
        plans: to go on with.
        beliefs: ``(B, n)``.
        weight: chance that a probe shows an outcome at all, and not nothing.
    """
    num_poses, num_outcomes, num_states = likelihoods.shape
    single = likelihoods.reshape(-1, num_states).astype(np.float32)
    transposed = np.ascontiguousarray(plans.alphas.T, np.float32)  # which plan is best may be rounded, its value not
    rows = max(1, _BLOCK // (num_poses * num_outcomes * max(num_states, len(plans.alphas))))
    alphas, actions = [], []
    for first in range(0, len(beliefs), rows):
        some = beliefs[first : first + rows]
        joint = some.astype(np.float32)[:, None] * single  # (B, P M, n)
        best = (joint.reshape(-1, num_states) @ transposed).argmax(axis=1).reshape(-1, num_poses, num_outcomes)
        candidates = np.empty((len(some), num_poses, num_states))
        for pose in range(num_poses):
            candidates[:, pose] = np.einsum("mn,bmn->bn", likelihoods[pose], plans.alphas[best[:, pose]])
        if weight < 1.0:
            candidates = weight * candidates + (1.0 - weight) * plans.alphas[plans.best(some)][:, None]
        candidates = problem.discount * candidates - problem.touch_cost
        pose_of = np.einsum("bpn,bn->bp", candidates, some).argmax(axis=1)
        alphas.append(candidates[np.arange(len(some)), pose_of])
        actions.append(pose_of)
    return Plans(np.concatenate(alphas), np.concatenate(actions))


def different(beliefs: Floats) -> Floats:
    """Beliefs ``(B, n)`` without those that are nearly another, in their order.

    >>> different(np.array([[0.5, 0.5], [0.9, 0.1], [0.50001, 0.49999]])).tolist()
    [[0.5, 0.5], [0.9, 0.1]]
    """
    _, index = np.unique(beliefs.round(_ALIKE), axis=0, return_index=True)
    return beliefs[np.sort(index)]
