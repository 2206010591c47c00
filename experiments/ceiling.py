"""Frames of a comparison: its ceiling in success, and an upper bound on the return for the discretised sensor model.

The ceiling is what could be known if touches were free and objects could be gone back to. Every object is touched once
in every pose, everything is fused, and the object most probably the target is confirmed (none, if its absence is
likelier).
No decider that touches each pose at most once can expect to do better with the same sensor and observation model.

The bound counts what touches cost: :mod:`planners.solve` certifies what no policy's expected return exceeds if a touch
is a draw from the outcome table, and a pose's second and third touch are worth what the observation model says of
repeats, for policies that use no pose again before the others. Live touches hold more than their outcome does, and are
not independent given the shape, so live returns can exceed the bound.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from belief import Composition, SceneBelief
from belief.chance import touch_rng
from experiments.episodes import Setting, episode_seed, load_sensor, make_world
from planners.repeats import repeat_discount, weights_in_turn
from planners.search import TouchRequest
from planners.solve import SearchTouchProblem
from planners.solve.search_bounds import search_bound
from planners.solve.stages import num_states

_MOST_STATES = 64  # four distinct objects have 32, and take some minutes
_LEAST_OUTCOMES = 24  # of a touch: fewer would hold less than deciders make of it
_MOST_USES = 4  # of a pose that are priced one by one; the last price holds for all that follow


def solved_by_full_information(setting: Setting, target: int, seed: int, numbers: Sequence[int]) -> list[bool]:
    """Which of these episodes are solved by touching everything first."""
    sensor, problem = load_sensor(setting), setting.problem
    solved = []
    for number in numbers:
        key = episode_seed(seed, target, number)
        world = make_world(setting, sensor, key)
        scene = SceneBelief(problem, sensor.model)
        for object_index in range(problem.num_objects):
            requests = [
                TouchRequest(world, pose, touch_rng(key, object_index, pose, repeat=0))
                for pose in range(problem.num_poses)
            ]
            scene.update(object_index, sensor.touch_many(requests))
            if object_index + 1 < problem.num_objects:
                world.advance()
        here = scene.marginals()[:, target]
        if 1.0 - scene.prob_present(target) > here.max():
            solved.append(target not in world.arrangement)
        else:
            solved.append(world.arrangement[int(np.argmax(here))] == target)
    return solved


def best_expected_return(setting: Setting, target: int) -> float | None:
    """Upper bound on the expected return of a search for a target, for the discretised sensor model.

    In it touches are independent given the shape; live touches are not. None where it cannot be solved.
    """
    problem, model = setting.problem, load_sensor(setting).model
    if not isinstance(problem.composition, Composition) or problem.touch_cost == 0.0:
        return None
    probs = model.outcome_table(max(_LEAST_OUTCOMES, model.default_outcomes)).probs
    search = SearchTouchProblem(probs, problem.num_objects, problem.composition, target, problem.touch_cost)
    if num_states(search) > _MOST_STATES:
        return None
    weights = weights_in_turn(repeat_discount(model), problem.num_poses, _MOST_USES)
    return search_bound(search, np.random.default_rng(0), weights.tolist())
