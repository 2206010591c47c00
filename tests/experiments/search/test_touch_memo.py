"""Deciders that make the same touch of the same episode press the object once, and get what they would get alone."""

import pytest

from activetouch.world import TouchTime, touch_many
from experiments.scene_choice import SceneChoice
from experiments.search.comparison import prepared
from experiments.search.play import Seconds, TouchMemo, play_episodes
from experiments.search.run_folder import episode_lines
from experiments.search.setting import Setting
from planners import search_lockstep

pytestmark = pytest.mark.mujoco
COARSE = Setting(SceneChoice("coarse", fidelity="quasistatic"))
NUMBERS = range(3)
DECIDERS = ("fixed_poses", "information_gain", "threshold")


@pytest.fixture(scope="module")
def run():
    """Searches and deciders, ready to be played."""
    return prepared(COARSE, DECIDERS, seed=5, jobs=1)


def play(run, decider, memo=None, numbers=NUMBERS):
    return play_episodes(run.searches, run.deciders[decider], 1, numbers, memo)


class CountedMemo(TouchMemo):
    """A memo that counts the touches it had already."""

    num_shared = 0

    def press(self, request):
        """See :class:`TouchMemo`."""
        self.num_shared += request.key in self._kept
        return super().press(request)


def test_shared_touches_change_no_byte_of_any_episode(run):
    memo = CountedMemo()
    alone = [episode_lines(name, play(run, name)[0]) for name in DECIDERS]
    for index, (name, lines) in enumerate(zip(DECIDERS, alone, strict=True)):
        before = memo.num_shared
        assert episode_lines(name, play(run, name, memo)[0]) == lines
        assert (memo.num_shared > before) is (index > 0)


def test_a_shared_touch_counts_the_time_of_its_press_and_the_decider_only_its_own(run):
    memo = CountedMemo()
    first, second = (play(run, "fixed_poses", memo)[1] for _ in range(2))
    assert memo.num_shared == second.num_touches
    assert second.physics == first.physics > 0.0
    assert second.decision > 0.0


def test_the_time_of_touches_is_no_time_of_decisions(run, monkeypatch):
    """The clock moves only while objects are touched, or only beside it."""
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
    episodes, seconds = play(run, "threshold", numbers=[0])
    touches = episodes[0].num_touches
    assert seconds == Seconds(1.0 * touches, 2.0 * touches, 0.0, touches, 0)
    steps[:] = [0.0, 7.0]
    assert play(run, "threshold", numbers=[0])[1].decision == 7.0
