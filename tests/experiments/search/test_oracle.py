"""The full-information oracle."""

import numpy as np
import pytest

from experiments.scene_choice import SceneChoice
from experiments.search.comparison import prepared
from experiments.search.oracle import solved_by_full_information
from experiments.search.play import TouchMemo, make_world
from experiments.search.setting import Setting
from planners.search import TouchRequest


def searches(**how):
    return prepared(Setting(**how), ["random_confirm"], seed=5, jobs=1).searches


@pytest.mark.torch
@pytest.mark.mujoco
def test_the_oracle_gives_the_most_probable_answer_also_where_the_target_is_absent():
    """Objects of independent shapes have independent posteriors, so its rule can be written down."""
    choice = SceneChoice("coarse", fidelity="quasistatic")
    coarse = searches(choice=choice, num_objects=2, composition="independent", anyway=True)
    sensor, expected, absent = coarse.sensor, [], []
    for number in range(12):
        world = make_world(coarse.problem, sensor, (5, 1, number))
        probs = []
        for index in range(2):
            if index:
                world.advance()
            requests = [TouchRequest.of(world, (5, 1, number), index, pose, repeat=0) for pose in range(6)]
            images = np.stack([TouchMemo().press(request)[0] for request in requests])
            logs = sensor.model.log_likelihood(sensor.read(images, list(range(6))))
            probs.append(np.exp(logs[1] - np.logaddexp.reduce(logs)))
        is_absent = np.prod(1.0 - np.array(probs)) > max(probs)
        absent.append(1 not in world.arrangement)
        expected.append(absent[-1] if is_absent else world.arrangement[int(np.argmax(probs))] == 1)
    assert 2 < sum(absent) < 10
    assert solved_by_full_information(coarse, 1, range(12)) == expected
    assert sum(expected) >= 11
