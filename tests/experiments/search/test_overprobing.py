"""What counts as probing on after certainty."""

import json

import numpy as np
import pytest

from belief import Belief, Confirm, Probe, Reject, Touch
from experiments.search.overprobing import NothingToCount, OverprobingCommand, overprobing
from experiments.search.run_folder import EPISODES_PER_SHARD, RunFolder, Seconds, Shard, ShardKey, episode_lines
from experiments.search.setting import Setting
from planners import Decision, Episode, Outcome, Step

LABELS = ("cube", "cone")


def episode(arrangement, decisions, outcome=Outcome.CONFIRMED):
    """Decisions are (object, probability that it is a cube when deciding, action); the cube is sought."""
    steps = []
    for index, prob, action in decisions:
        touch = Touch(action.pose, np.zeros(2)) if isinstance(action, Probe) else None
        steps.append(Step(index, Belief.from_probs(LABELS, [prob, 1 - prob]), Decision(action), touch))
    return Episode((0,), 0, arrangement, tuple(steps), outcome)


def test_touches_after_certainty_are_counted_object_by_object():
    some = [
        # The cone: sure after one touch, touched twice more, doubted, and confirmed, which is wrong.
        episode((1, 0), [(0, 0.5, Probe(0)), (0, 0.01, Probe(0)), (0, 0.6, Probe(1)), (0, 0.97, Confirm())]),
        # Rejected as soon as sure; the cube is then certain untouched, which counts nowhere.
        episode((1, 0), [(0, 0.5, Probe(0)), (0, 0.02, Reject()), (1, 0.98, Confirm())]),
        # Never sure.
        episode((0, 1), [(0, 0.5, Probe(0)), (0, 0.7, Confirm())]),
    ]
    found = overprobing("me", some, 0.95)
    assert (found.objects, found.late_touches) == (2, 1.0)
    assert (found.went_on[0], found.doubted[0], found.first_wrong[0], found.wrong[0]) == (0.5, 0.5, 0.0, 0.5)
    assert found.went_on[1] < 0.5 < found.went_on[2]


def test_one_touch_after_certainty_is_going_on():
    once = episode((0, 1), [(0, 0.5, Probe(0)), (0, 0.99, Probe(1)), (0, 0.99, Confirm())])
    none = episode((0, 1), [(0, 0.5, Probe(0)), (0, 0.99, Confirm())])
    found = overprobing("me", [once, none, none], 0.95)
    assert (found.late_touches, found.went_on[0]) == (pytest.approx(1 / 3), pytest.approx(1 / 3))


def test_a_search_cut_off_after_certainty_decided_nothing_and_counts_as_wrong():
    cut = episode((0, 1), [(0, 0.5, Probe(0)), (0, 0.99, Probe(0))], Outcome.TRUNCATED)
    assert overprobing("me", [cut], 0.95).wrong[0] == 1.0


def test_who_is_never_sure_has_no_numbers():
    assert overprobing("me", [episode((0, 1), [(0, 0.99, Confirm())])], 0.95) is None
    assert overprobing("me", [], 0.95) is None


def a_run(folder, probability):
    """A folder with episodes in which one touch gives the cube this posterior."""
    labels = Setting().problem.shape_labels
    after = Belief.from_probs(labels, [probability, 1.0 - probability, 0.0, 0.0])
    probe, confirm = Decision(Probe(0)), Decision(Confirm())
    steps = (Step(0, Belief.uniform(labels), probe, Touch(0, np.zeros(4))), Step(0, after, confirm, None))
    run = RunFolder(folder)
    run.open({}, {"setting": Setting().to_dict(), "episodes": 25})
    played = [Episode((0,), 0, (0, 1, 2, 3), steps, Outcome.CONFIRMED)] * EPISODES_PER_SHARD
    run.write(ShardKey("somebody", "sphere", 0), Shard(episode_lines("somebody", played), Seconds(), "v1"))


def test_the_command_reads_a_finished_comparison(tmp_path, capsys):
    a_run(tmp_path, 0.99)
    OverprobingCommand(folder=tmp_path).run()
    assert "somebody" in capsys.readouterr().out
    [row] = json.loads((tmp_path / "overprobing.json").read_text())
    assert (row["decider"], row["objects"], row["late_touches"]) == ("somebody", EPISODES_PER_SHARD, 0.0)


def test_without_anything_to_count_nothing_is_written(tmp_path, capsys):
    a_run(tmp_path, 0.6)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(NothingToCount, match=r"0\.95 in 25 episodes.*\n.*--config .*run\.json --episodes 1025"):
        OverprobingCommand(folder=tmp_path).run()
    assert sorted(tmp_path.rglob("*")) == before
    assert not capsys.readouterr().out
