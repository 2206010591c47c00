"""Upper bounds on the expected return of a comparison's searches, for models of the sensor.

In the discretised sensor model a touch is a draw from the outcome table, and repeats of a pose are discounted as the
observation model says. The bound holds for policies that use every pose before they repeat one (:mod:`planners.solve`).
Live touches carry more information than their outcome and are correlated, so live returns can exceed the bound.

For a sensor of one rigid body there is a second bound, in which the body is revealed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from belief import Composition, SearchProblem
from belief.observation_model import ObservationModel
from belief.observation_model.rigid_body import joint_model
from belief.validation import Floats
from benchmarks.upper_bounds.search import revealing_touch_bound, search_bound
from experiments.search.setting import Setting
from planners.repeats import repeat_discount, weights_in_turn
from planners.solve import SearchTouchProblem

_MOST_STATES = 64  # on a grid of beliefs; four distinct objects have 32, which takes minutes
_MOST_SHAPES = 6  # likewise
_MOST_TOUCHES = 3  # before one that reveals the shape; of many states 2
_LITTLE = 1e-3  # fall of a bound by one more touch after which further touches are left out
_LEAST_OUTCOMES = 24  # of the outcome table; fewer would lose information that deciders use
_MOST_USES = 4  # of a pose with a discount of their own; later uses have the last discount
_GROUPS, _BODIES = 4, 8  # groups of bodies, for a standard error, and bodies in each
_REFERENCES = 128  # touches of a pose that stand for all
_TOUCHES_OF_BODY = 1  # before the one that reveals the shape; a second changes little where the body is known


class RevealedBody(NamedTuple):
    """An estimate of the upper bound for a decider that is shown the body.

    Attributes:
        mean: over groups of bodies.
        standard_error: of the mean.
    """

    mean: float
    standard_error: float

    @classmethod
    def over_targets(cls, each: Sequence[Sequence[float] | None]) -> RevealedBody | None:
        """Mean over targets, whose errors may go together; None without targets, or if it is unknown for one."""
        known = [cls(*some) for some in each if some is not None]
        if not known or len(known) < len(each):
            return None
        return cls(*(float(x) for x in np.mean(known, axis=0)))


def best_expected_return(setting: Setting, target: int) -> float | None:
    """Upper bound on the expected return of a search for a target; None if touches are free, or for bags.

    It takes minutes on a grid of beliefs. For many shapes it is :func:`.revealing_touch_bound`,
    in less than a minute.
    """
    if not isinstance(setting.problem.composition, Composition) or setting.problem.touch_cost == 0.0:
        return None
    search, weights = discretised_search(setting, target)
    if search.num_states <= _MOST_STATES and search.num_shapes <= _MOST_SHAPES:
        return search_bound(search, np.random.default_rng(0), weights)
    best = np.inf
    for touches in range(1, _MOST_TOUCHES + (search.num_states <= _MOST_STATES)):
        before, best = best, revealing_touch_bound(search, touches, weights, names_rival=True)
        if before - best < _LITTLE:
            break
    return best


def discretised_search(setting: Setting, target: int) -> tuple[SearchTouchProblem, list[float]]:
    """The search in the discretised sensor model, and the weights of repeats in it."""
    model = setting.open_sensor().model
    probs = model.outcome_table(max(_LEAST_OUTCOMES, model.default_outcomes)).probs
    weights = weights_in_turn(repeat_discount(model), setting.problem.num_poses, _MOST_USES)
    return _search(setting.problem, target, probs), weights.tolist()


def best_return_with_revealed_bodies(setting: Setting, target: int) -> RevealedBody | None:
    """Upper bound on the expected return if orientation and size of each object were shown at first sight.

    Only the shape is unknown then. It is for touches as a joint sensor predicts them: draws from its reference touches,
    independent given the body. After one touch of an object another one reveals its shape, and so does its rejection;
    a decider that is shown more can only do better. The bodies are some of the sensor's hypotheses.

    Returns:
        None if the sensor takes touches as independent, if touches are free, or for bags.
    """
    return revealed_body(setting.problem, setting.open_sensor().model, target)


def revealed_body(problem: SearchProblem, model: ObservationModel, target: int) -> RevealedBody | None:
    """:func:`best_return_with_revealed_bodies`, for an observation model.

    Args:
        problem: the search.
        model: whose hypotheses and reference touches there are.
        target: index of the target.
    """
    bodies_model = joint_model(model)
    if bodies_model is None or not isinstance(problem.composition, Composition) or not problem.touch_cost:
        return None
    model = bodies_model
    bodies = np.linspace(0, model.num_hypotheses - 1, _GROUPS * _BODIES).round().astype(int)
    found = []
    for group in range(_GROUPS):
        chosen = np.tile(bodies[group::_GROUPS], (problem.num_shapes, 1))
        tables = np.moveaxis(model.outcomes.of(chosen, _REFERENCES), 2, 0).astype(np.float64)  # (H, P, K, M)
        tables /= tables.sum(axis=3, keepdims=True)
        found.append(revealing_touch_bound(_search(problem, target, tables[0]), _TOUCHES_OF_BODY, tables=list(tables)))
    return RevealedBody(float(np.mean(found)), float(np.std(found, ddof=1) / np.sqrt(_GROUPS)))


def _search(problem: SearchProblem, target: int, probs: Floats) -> SearchTouchProblem:
    assert isinstance(problem.composition, Composition), "checked by the callers"
    return SearchTouchProblem(probs, problem.num_objects, problem.composition, target, problem.touch_cost)
