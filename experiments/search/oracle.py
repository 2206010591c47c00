"""Full-information oracle: an upper reference for the success of a comparison.

The oracle touches every object once in every pose and fuses all touches. It confirms the object that is most probably
the target, or rejects all objects if an absent target is more probable. No decider that touches each pose at most once
can have a higher expected success with the same sensor and observation model.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from belief import SceneBelief
from belief.touch_batch import TouchBatch
from experiments.search.setting import Setting, episode_seed, load_sensor, make_world
from experiments.search.touch_memo import TouchMemo
from planners.search import TouchRequest


def solved_by_full_information(
    setting: Setting, target: int, seed: int, numbers: Sequence[int], memo: TouchMemo | None = None
) -> list[bool]:
    """Whether the full-information oracle succeeds, for each of the given episodes.

    Args:
        setting: setting of the run.
        target: index of the target shape.
        seed: seed of the run.
        numbers: numbers of the episodes.
        memo: images of touches in this setting.
    """
    sensor, problem = load_sensor(setting), setting.problem
    memo = TouchMemo() if memo is None else memo
    solved = []
    poses = np.tile(np.arange(problem.num_poses), (problem.num_objects, 1))
    before = SceneBelief(problem, sensor.model)
    for number in numbers:
        key = episode_seed(seed, target, number)
        world, images = make_world(setting, sensor, key), []
        for object_index in range(problem.num_objects):
            requests = [TouchRequest.of(world, key, object_index, pose, repeat=0) for pose in range(problem.num_poses)]
            images += [memo.press(request)[0] for request in requests]
            if object_index + 1 < problem.num_objects:
                world.advance()
        reading = sensor.reader.read(np.stack(images))
        logits = reading.logits.reshape(*poses.shape, -1)
        batch = TouchBatch(poses, logits, reading.embeddings.reshape(*poses.shape, -1))
        scene = before.supposing(sensor.model.log_likelihood_batch(batch))
        here = scene.marginals()[:, target]
        if 1.0 - scene.prob_present(target) > here.max():
            solved.append(target not in world.arrangement)
        else:
            solved.append(world.arrangement[int(np.argmax(here))] == target)
    return solved
