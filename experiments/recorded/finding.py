"""Searches for a target among recorded objects of known, different labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from activetouch.recorded.world import RecordedBank, RecordedWorld
from belief.observation_model.action_kernel import ActionKernelModel
from belief.problem import SearchProblem
from belief.scene_belief import SceneBelief
from experiments.recorded.fold import Fold
from planners.decider import Decider, SequentialDecider
from planners.episode import Episode
from planners.probing import GivenOrder
from planners.registry import make_decider
from planners.search import search
from planners.stopping import PosteriorThresholds

FIXED = "best fixed order"
ORACLE = "oracle: all recordings of all objects"


@dataclass(frozen=True, eq=False)
class Found:
    """One search.

    Attributes:
        decider: its name.
        scene: number of the scene; all its searches are about the same objects.
        episode: the record.
        reward: the return.
    """

    decider: str
    scene: int
    episode: Episode
    reward: float


def find_all(
    fold: Fold, deciders: Sequence[str], seed: Sequence[int], num_objects: int, num_scenes: int, max_touches: int
) -> tuple[list[Found], list[tuple[int, bool]]]:
    """Search for every object of random scenes with all deciders.

    The robot knows which labels lie on the table, as in a search among distinct shapes, but not where.

    Args:
        fold: the split; objects and touches are those of its test.
        deciders: names for :func:`planners.registry.make_decider`, or "best fixed order".
        seed: of scenes and searches.
        num_objects: N, all of different labels.
        num_scenes: scenes, each with one search for each of its objects.
        max_touches: of one object, for deciders with thresholds.

    Returns:
        The searches, and for each the scene and whether the oracle is right. Both are empty where the test objects have
        fewer than N different labels.
    """
    present = np.unique(fold.bank.labels)
    found: list[Found] = []
    oracle: list[tuple[int, bool]] = []
    if len(present) < num_objects:
        return found, oracle
    limit = min(max_touches, fold.bank.repeats * len(fold.bank.action_names))
    for number in range(num_scenes):
        rng = np.random.default_rng([*seed, number])
        labels = rng.permutation(present)[:num_objects]
        names = tuple(fold.bank.label_names[label] for label in labels.tolist())
        bank, model = fold.bank.among(names), fold.models["kernel"].among(names)
        problem = SearchProblem(names, bank.action_names, num_objects, touch_limit=limit * num_objects)
        order = rng.permutation(num_objects)
        objects = [int(rng.choice(bank.objects_of(int(label)))) for label in order]
        made = {name: _decider(name, model, fold.order, limit) for name in deciders}
        scene = int(seed[-1]) * num_scenes + number
        for target in range(num_objects):
            words = [*seed, number, target]
            oracle.append((scene, _oracle_is_right(bank, model, problem, objects, words, target)))
            for name, decider in made.items():
                world = RecordedWorld(bank, objects, words)
                episode = search(world, decider, problem, target, model, words)
                found.append(Found(name, scene, episode, episode.reward(problem)))
    return found, oracle


def _decider(name: str, model: ActionKernelModel, order: tuple[str, ...], max_touches: int) -> Decider:
    if name == FIXED:
        return SequentialDecider(PosteriorThresholds(max_touches=max_touches), GivenOrder(order))
    return make_decider(name.replace("{max_touches}", str(max_touches)), model.outcome_table(), model)


def _oracle_is_right(
    bank: RecordedBank,
    model: ActionKernelModel,
    problem: SearchProblem,
    objects: Sequence[int],
    seed: Sequence[int],
    target: int,
) -> bool:
    """Whether the object that is most probably the target after all recordings is the target."""
    world, scene = RecordedWorld(bank, objects, seed), SceneBelief(problem, model)
    rng = np.random.default_rng(0)
    for number in range(len(objects)):
        touches = [world.touch(action, rng) for action in range(len(bank.action_names)) for _ in range(bank.repeats)]
        scene.update(number, touches)
        if number + 1 < len(objects):
            world.advance()
    best = int(np.argmax([scene.belief(number).log_probs[target] for number in range(len(objects))]))
    return world.arrangement[best] == target
