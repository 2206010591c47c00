"""Reference returns for a learned policy: upper bound, best thresholds, and free touches.

The upper bound is certified for the discretised sensor model with discounted repeats. The best pair of thresholds on
the posterior, which probes the least used pose, is an attainable return. The return with free touches, in all poses in
turn, shows how much information there is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.priors import ObjectPriors
from activetouch.envs.touch_bank import TouchBank
from belief.observation_model import ArrayModel
from experiments.ppo.recipe import PPORecipe
from experiments.ppo.training import Score, play
from planners.bounds.object import object_bound
from planners.repeats import repeat_discount, weights_in_turn
from planners.solve import TouchProblem

_CONFIRM = (0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98, 0.99)
_REJECT = (0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3)
_EPISODES = 2000


@dataclass(frozen=True)
class Reference:
    """For one target.

    Attributes:
        optimum: what no policy exceeds, of the table of outcomes, repeats priced, within the touch limit.
        thresholds: the best pair on the objects that policies learn from: confirm, reject.
        score: of that pair on the objects of the test split.
        free: return on these if as many touches as are allowed cost nothing.
    """

    optimum: float
    thresholds: tuple[float, float]
    score: Score
    free: float


def reference(bank: TouchBank, test_bank: TouchBank, model: ArrayModel, target: str, recipe: PPORecipe) -> Reference:
    """The references for a target, under the task of a recipe, in tests as it measures them."""
    task = (target, _EPISODES, "posterior", recipe.touch_cost, recipe.touch_limit, recipe.test_prob)
    known, test = BankEpisodes(bank, model, *task), BankEpisodes(test_bank, model, *task)
    pairs = list(product(_CONFIRM, _REJECT))
    best = max(pairs, key=lambda pair: play(thresholds(*pair), known).mean_return)
    index = bank.shape_labels.index(target)
    prior = ObjectPriors.of(len(bank.shape_labels), index, recipe.test_prob).probs(recipe.test_prob)
    problem = TouchProblem(model.outcome_table().probs, prior, index, recipe.touch_cost)
    worth = weights_in_turn(repeat_discount(model), problem.num_poses, -(-recipe.touch_limit // problem.num_poses))
    weights = [*worth[: recipe.touch_limit].tolist(), 0.0]  # the limit: no touch after it shows anything
    optimum = object_bound(problem, np.random.default_rng(0), weights)
    free = 2.0 * play(thresholds(np.inf, -np.inf), test).success - 1.0
    return Reference(optimum, best, play(thresholds(*best), test), free)


def thresholds(confirm: float, reject: float) -> Callable[[BankEpisodes], NDArray[np.int64]]:
    """Confirm or reject where the posterior of the target is beyond a threshold, and at the touch limit; else probe."""

    def choose(episodes: BankEpisodes) -> NDArray[np.int64]:
        prob = np.exp(episodes.log_probs[:, episodes.target])
        has_to = episodes.num_touches >= episodes.touch_limit
        actions = episodes.uses.argmin(axis=1)
        actions = np.where((prob <= reject) | (has_to & (prob < 0.5)), episodes.num_poses + 1, actions)
        return np.where((prob >= confirm) | (has_to & (prob >= 0.5)), episodes.num_poses, actions)

    return choose
