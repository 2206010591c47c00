"""What the time of searches is spent on."""

import pytest

from activetouch.world import TouchTime, touch_many
from experiments.scene_choice import SceneChoice
from experiments.search.comparison import prepared
from experiments.search.play import Seconds, play_episodes
from experiments.search.setting import Setting
from planners import search_lockstep

pytestmark = pytest.mark.mujoco


def test_the_time_of_touches_is_no_time_of_decisions(monkeypatch):
    """The clock moves only while objects are touched, or only beside it."""
    run = prepared(Setting(SceneChoice("coarse", fidelity="quasistatic")), "threshold", seed=5, jobs=1)
    now, steps = [0.0], [5.0, 0.0]

    def touch_slowly(*given):
        found = touch_many(*given)[0], TouchTime(1.0, 2.0)
        now[0] += steps[0]
        return found

    def search_slowly(*given):
        now[0] += steps[1]
        return search_lockstep(*given)

    monkeypatch.setattr("experiments.search.play.touch_many", touch_slowly)
    monkeypatch.setattr("experiments.search.play.search_lockstep", search_slowly)
    monkeypatch.setattr("experiments.search.play.time.perf_counter", lambda: now[0])
    episodes, seconds = play_episodes(run.searches, run.deciders["threshold"], 1, [0])
    touches = episodes[0].num_touches
    assert seconds == Seconds(1.0 * touches, 2.0 * touches, 0.0, touches, 0)
    steps[:] = [0.0, 7.0]
    assert play_episodes(run.searches, run.deciders["threshold"], 1, [0])[1].decision == 7.0
