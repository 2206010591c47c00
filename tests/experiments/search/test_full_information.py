"""What could be reached: every object touched in every pose, with the most probable answer."""

import json
from dataclasses import replace

import numpy as np
import pytest

from activetouch import TouchWorld
from belief.problem import Confirm, Probe
from belief.seeding import touch_rng
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.comparison import Comparison, prepared
from experiments.search.play import FullInformation, Setting, play_episodes, replay
from planners import Outcome

pytestmark = [pytest.mark.mujoco, pytest.mark.torch]
COARSE = Setting(SceneChoice("coarse", fidelity="quasistatic"))


def test_the_answer_is_the_most_probable_one_also_where_the_target_is_absent():
    """Objects of independent shapes have independent posteriors, so its rule can be written down."""
    setting = replace(COARSE, num_objects=2, composition="independent")
    searches = prepared(setting, ["random_confirm"], seed=5, jobs=1).searches
    sensor, number = searches.sensor, 20
    episodes, seconds = play_episodes(searches, FullInformation(), 1, range(number))
    for index, episode in enumerate(episodes):
        world, probs = TouchWorld.of_search(sensor, searches.problem, (5, 1, index)), []
        for place in range(2):
            if place:
                world.advance()
            images = np.stack([world.press(pose, touch_rng((5, 1, index), place, pose, 0))[0] for pose in range(6)])
            logs = sensor.model.log_likelihood(sensor.read(images, list(range(6))))
            probs.append(np.exp(logs[1] - np.logaddexp.reduce(logs)))
        is_absent = np.prod(1.0 - np.array(probs)) > max(probs)
        assert episode.outcome is (Outcome.EXHAUSTED if is_absent else Outcome.CONFIRMED)
        if not is_absent:
            assert episode.steps[-1].object_index == int(np.argmax(probs))
            assert episode.steps[-1].belief.probs[1] == pytest.approx(max(probs), abs=1e-6)
            assert isinstance(episode.steps[-1].decision.action, Confirm)
    assert {episode.outcome for episode in episodes} == {Outcome.EXHAUSTED, Outcome.CONFIRMED}
    came_back = [episode for episode in episodes if episode.steps[-1].object_index == 0]
    assert came_back  # which no decider can do
    assert sum(bool(episode.success) for episode in episodes) >= 18
    assert {episode.num_touches for episode in episodes} == {12}
    assert seconds.num_touches == 12 * number
    frames = replay(sensor, searches.problem, came_back[0])
    assert [frame.image is not None for frame in frames] == [
        isinstance(step.decision.action, Probe) for step in came_back[0].steps
    ]


def test_the_command_adds_a_row_whose_touches_are_those_of_the_deciders(tmp_path):
    asked = Compare(
        deciders=("fixed_poses",), full_information=True, targets=("cone",), episodes=3, setting=COARSE, out=tmp_path
    )
    found = replace(asked, jobs=1).play()
    assert found.deciders == ["fixed_poses", "full information"]
    assert found.reference == "fixed_poses"
    assert [row["touches"] for row in found.rows() if row["decider"] == "full information"] == [24.0, 24.0]
    for fixed, full in zip(*(found.episodes[name, "cone"] for name in found.deciders), strict=True):
        first = next(step for step in fixed.steps if step.touch is not None)
        pose = first.decision.action.pose
        same = next(s for s in full.steps if s.object_index == first.object_index and s.decision.action == Probe(pose))
        np.testing.assert_allclose(same.touch.logits, first.touch.logits, rtol=1e-4)
    assert json.loads((tmp_path / "run.json").read_text())["arguments"]["full_information"] is True
    assert Compare.from_config(tmp_path).full_information is True
    assert Comparison.load(tmp_path).rows() == found.rows()
    found.save(tmp_path)
    assert "full information" in (tmp_path / "report.html").read_text()
