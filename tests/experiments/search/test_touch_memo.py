"""Deciders that make the same touch of the same episode press the object once, and get what they would get alone."""

import numpy as np
import pytest

from activetouch.world import TouchTime, touch_many
from experiments.scene_choice import SceneChoice
from experiments.search.oracle import solved_by_full_information
from experiments.search.resume import groups_of, shard_sizes
from experiments.search.run_folder import BOUND, ORACLE, Seconds, episode_lines
from experiments.search.setting import Setting, load_sensor, make_world, play_episodes
from experiments.search.touch_memo import TouchMemo
from planners import search_lockstep
from planners.search import TouchRequest

pytestmark = pytest.mark.mujoco
COARSE = Setting(SceneChoice("coarse", fidelity="quasistatic"))
NUMBERS = range(3)


def play(decider, memo=None):
    return play_episodes(COARSE, decider, 1, 5, NUMBERS, memo)


def test_shared_touches_change_no_byte_of_any_episode():
    memo = TouchMemo()
    deciders = ("fixed_poses", "information_gain", "threshold")
    alone = [episode_lines(name, play(name)[0]) for name in deciders]
    solved = solved_by_full_information(COARSE, 1, 5, NUMBERS)
    assert solved_by_full_information(COARSE, 1, 5, NUMBERS, memo) == solved
    assert memo.num_shared == 0
    for name, lines in zip(deciders, alone, strict=True):
        before = memo.num_shared
        assert episode_lines(name, play(name, memo)[0]) == lines
        assert memo.num_shared > before


def test_a_shared_touch_counts_the_time_of_its_press_and_the_decider_only_its_own():
    memo = TouchMemo()
    first, second = (play("fixed_poses", memo)[1] for _ in range(2))
    assert memo.num_shared == second.num_touches
    assert second.physics == first.physics > 0.0
    assert second.decision > 0.0


def test_the_time_of_touches_is_no_time_of_decisions(monkeypatch):
    """The clock moves only while objects are touched, or only beside it."""
    now, steps = [0.0], [5.0, 0.0]

    def touch_slowly(*given):
        found = touch_many(*given)[0], TouchTime(1.0, 2.0)
        now[0] += steps[0]
        return found

    def search_slowly(*given):
        now[0] += steps[1]
        return search_lockstep(*given)

    monkeypatch.setattr("experiments.search.setting.touch_many", touch_slowly)
    monkeypatch.setattr("experiments.search.setting.search_lockstep", search_slowly)
    monkeypatch.setattr("experiments.search.setting.time.perf_counter", lambda: now[0])
    episodes, seconds = play_episodes(COARSE, "threshold", 1, 5, [0])
    touches = episodes[0].num_touches
    assert seconds == Seconds(1.0 * touches, 2.0 * touches, 0.0, touches, 0)
    steps[:] = [0.0, 7.0]
    assert play_episodes(COARSE, "threshold", 1, 5, [0])[1].decision == 7.0


def test_a_full_memo_presses_again():
    sensor = load_sensor(COARSE)

    def request(pose):
        return TouchRequest.of(make_world(COARSE, sensor, (5, 1, 0)), (5, 1, 0), 0, pose, 0)

    image = TouchMemo().press(request(0))[0]
    memo = TouchMemo(most_bytes=image.nbytes)
    for pose in (0, 1, 0, 1):
        again = TouchMemo().press(request(pose))[0]
        np.testing.assert_array_equal(memo.press(request(pose))[0], again)
    assert memo.num_shared == 1  # the second touch did not fit


def test_the_shards_of_the_same_episodes_form_a_group():
    keys = shard_sizes(["threshold", "fixed_poses", ORACLE, BOUND], ["cone", "cube"], 50)
    groups = groups_of(keys)
    assert sorted(key.stem for group in groups for key in group) == sorted(key.stem for key in keys)
    assert [len(group) for group in groups if group[0].decider == BOUND] == [1, 1]
    for group in groups:
        assert len({(key.target, key.number) for key in group}) == 1
        assert group[0].decider in (ORACLE, BOUND)
    assert len(groups) == 6
    assert len(groups_of(keys, 7)) > 7
    assert len(groups_of(keys, 1000)) == len(keys)
    assert groups_of([]) == []
