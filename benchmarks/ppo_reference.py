"""Reference returns for learned policies: upper bound, best posterior thresholds, and free touches.

    python -m benchmarks.ppo_reference runs/ppo-paper paper-independent

The first argument is the output folder of ``activetouch train-ppo``, the second a shipped sensor.

The upper bound is certified for the discretised sensor model with discounted repeats. The return of the best pair of
posterior thresholds, with the least used pose next, is attainable. The return with free touches, in all poses in turn,
shows how much information touches contain.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.touch_bank import TouchBank
from activetouch.envs.touch_source import ObjectPriors
from activetouch.sensor_files import MODELS, fitted_model
from belief.observation_model import ArrayModel
from benchmarks.upper_bounds.object import object_bound
from experiments.ppo.recipe import PPO_RECIPES, PPORecipe
from experiments.ppo.training import TEST, TRAINING, Score, play
from planners.repeats import repeat_discount, weights_in_turn
from planners.solve import TouchProblem

_CONFIRM = (0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98, 0.99)
_REJECT = (0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3)
_EPISODES = 2000


@dataclass(frozen=True)
class Reference:
    """Reference returns for one target.

    Attributes:
        optimum: upper bound on the return for the table of outcomes, with discounted repeats and the touch limit.
        thresholds: best pair (confirm, reject) on the objects that policies learn from.
        score: score of that pair on the objects of the test split.
        free: return on these objects with the maximum number of touches, if touches cost nothing.
    """

    optimum: float
    thresholds: tuple[float, float]
    score: Score
    free: float


def reference(bank: TouchBank, test_bank: TouchBank, model: ArrayModel, target: str, recipe: PPORecipe) -> Reference:
    """Compute the reference returns for a target.

    Args:
        bank: touches that policies learn from.
        test_bank: touches of other objects.
        model: observation model that updates the belief.
        target: label of the shape sought.
        recipe: recipe whose touch cost, touch limit and prior are used.
    """
    task = (target, _EPISODES, "posterior", recipe.touch_cost, recipe.touch_limit, recipe.test_prob)
    known, test = BankEpisodes(bank, model, *task), BankEpisodes(test_bank, model, *task)
    pairs = list(product(_CONFIRM, _REJECT))
    best = max(pairs, key=lambda pair: play(thresholds(*pair), known).mean_return)
    index = bank.shape_labels.index(target)
    prior = ObjectPriors.of(len(bank.shape_labels), recipe.test_prob).probs(recipe.test_prob, index)
    problem = TouchProblem(model.outcome_table().probs, prior, index, recipe.touch_cost)
    in_turn = weights_in_turn(repeat_discount(model), problem.num_poses, -(-recipe.touch_limit // problem.num_poses))
    weights = [*in_turn[: recipe.touch_limit].tolist(), 0.0]  # touches after the limit are uninformative
    optimum = object_bound(problem, np.random.default_rng(0), weights)
    free = 2.0 * play(thresholds(np.inf, -np.inf), test).success - 1.0
    return Reference(optimum, best, play(thresholds(*best), test), free)


def thresholds(confirm: float, reject: float) -> Callable[[BankEpisodes], NDArray[np.int64]]:
    """A policy that decides when the posterior of the target passes a threshold, or at the touch limit."""

    def choose(episodes: BankEpisodes) -> NDArray[np.int64]:
        prob = np.exp(episodes.log_probs[np.arange(episodes.num_envs), episodes.targets])
        has_to = episodes.num_touches >= episodes.touch_limit
        actions = episodes.uses.argmin(axis=1)
        actions = np.where((prob <= reject) | (has_to & (prob < 0.5)), episodes.num_poses + 1, actions)
        return np.where((prob >= confirm) | (has_to & (prob >= 0.5)), episodes.num_poses, actions)

    return choose


def main(out: Path, sensor: str) -> None:
    """Print the references of all policies of a training that are for one target."""
    bank, test_bank = (TouchBank.open(out / "bank" / split) for split in (TRAINING, TEST))
    model = fitted_model(MODELS / sensor).model
    for state, targets in json.loads((out / "scores.json").read_text()).items():
        for target in targets:
            found = reference(bank, test_bank, model, target, PPO_RECIPES[state])
            returns = ", ".join(f"{score['mean_return']:.3f}" for score in targets[target])
            print(
                f"{state} {target}: returns of the seeds {returns}; {found.score.mean_return:.3f} of the best "
                f"thresholds {found.thresholds}; upper bound {found.optimum:.3f} for the table of outcomes; with "
                f"free touches {found.free:.3f}"
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
