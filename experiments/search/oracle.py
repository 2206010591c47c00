"""Full-information oracle: an upper reference for the success of a comparison.

The oracle touches every object in one pose after another and fuses all touches. It confirms the object that is most
probably the target, or rejects all objects if an absent target is more probable. No decider that touches each pose at
most once can have a higher expected success with the same sensor and observation model. Once the belief gives its
answer all but 1e-9 of the probability, it answers without the remaining poses.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from activetouch import TouchWorld
from activetouch.perception.reader import Reading
from belief.scene_belief import SceneBelief
from belief.touch_batch import TouchBatch
from experiments.search.play import Searches, Seed, TouchMemo, episode_seed, make_world
from planners.search import TouchRequest

_CERTAIN = 1.0 - 1e-9


def solved_by_full_information(
    searches: Searches, target: int, numbers: Sequence[int], memo: TouchMemo | None = None
) -> list[bool]:
    """Whether the full-information oracle succeeds, for each of the given episodes.

    Args:
        searches: what determines the searches.
        target: index of the target shape.
        numbers: numbers of the episodes.
        memo: images of touches that deciders of the same episodes made.
    """
    memo = TouchMemo() if memo is None else memo
    before = SceneBelief(searches.problem, searches.sensor.model)
    return [_is_solved(searches, before, target, episode_seed(searches.seed, target, n), memo) for n in numbers]


def _is_solved(searches: Searches, before: SceneBelief, target: int, key: Seed, memo: TouchMemo) -> bool:
    sensor, problem = searches.sensor, searches.problem
    readings: list[Reading] = []
    for pose in range(problem.num_poses):
        world = make_world(problem, sensor, key)
        readings.append(sensor.reader.read(_touched(world, pose, key, memo)))
        scene = before.supposing(sensor.model.log_likelihood_batch(_batch(readings)))
        here, absent = scene.marginals()[:, target], 1.0 - scene.prob_present(target)
        if max(absent, here.max()) >= _CERTAIN:
            break
    if absent > here.max():
        return target not in world.arrangement
    return world.arrangement[int(np.argmax(here))] == target


def _touched(world: TouchWorld, pose: int, key: Seed, memo: TouchMemo) -> NDArray[np.uint8]:
    """Images of the first touch of every object of a new world in one pose."""
    images = []
    for index in range(len(world.arrangement)):
        if index:
            world.advance()
        images.append(memo.press(TouchRequest.of(world, key, index, pose, repeat=0))[0])
    return np.stack(images)


def _batch(readings: Sequence[Reading]) -> TouchBatch:
    """Touches of the objects, ``(N, n)``, from what was read in each of the first n poses."""
    num_objects = len(readings[0].logits)
    poses = np.tile(np.arange(len(readings)), (num_objects, 1))
    logits, embeddings = (np.stack([getattr(r, name) for r in readings], axis=1) for name in ("logits", "embeddings"))
    return TouchBatch(poses, logits, embeddings)
