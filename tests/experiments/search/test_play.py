"""What the time of searches is spent on."""

import sys
import threading
from dataclasses import replace

import pytest

from activetouch.world import TouchTime, touch_many
from belief import Probe
from belief.errors import BrokenContract, CodeFailed
from experiments.cli import main
from experiments.scene_choice import SceneChoice
from experiments.search.comparison import prepared
from experiments.search.play import Seconds, Setting, play_episodes
from experiments.search.run import read_episode
from planners import Decision, SequentialDecider, search_lockstep
from planners.fingerprint import fingerprint
from planners.other_agents import FunctionPolicy
from planners.ppo import BadPolicy, MissingPolicy
from planners.probing import FixedOrder
from planners.registry import copyable
from planners.stopping import PosteriorThresholds

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


def act(observation):
    return {}["no such key"]


class Fails:
    def decide(self, info, rng):
        return act(info) if info.history else Decision(Probe(0))


def test_what_cannot_play_is_said_before_the_first_search_with_the_line_of_the_user(tmp_path, monkeypatch):
    setting = Setting(SceneChoice("coarse", fidelity="quasistatic"), observation_model="independent")
    line = r"test_play.py, line \d+: return {}\[\"no such key\"\]\nKeyError: 'no such key'"
    with pytest.raises(CodeFailed, match=line) as failed:
        prepared(setting, {"mine": FunctionPolicy(act)}, jobs=1)
    assert failed.value.__notes__ == ["in the first decision of mine, target sphere"]
    (tmp_path / "bad.zip").write_text("nonsense")
    with pytest.raises(BadPolicy, match="no file that Stable-Baselines3 saved"):
        prepared(setting, f"sb3:{tmp_path}/bad.zip", jobs=1)
    monkeypatch.setattr(Setting, "open_sensor", None)  # which takes minutes for many bodies
    with pytest.raises(MissingPolicy, match=r"there is no file .*none\.zip") as failed:
        prepared(setting, f"sb3:{tmp_path}/none.zip", jobs=1)
    assert not hasattr(failed.value, "__notes__")
    monkeypatch.undo()
    for jobs in (1, 2):
        with pytest.raises(CodeFailed, match=line) as failed:
            prepared(setting, {"mine": Fails()}, targets="cone", episodes=1, jobs=jobs).play(jobs)
        assert failed.value.__notes__ == ["in one of the episodes range(0, 1) of mine, target cone, seed 0"]
    monkeypatch.setattr("experiments.search.play.search_lockstep", None)  # a fault of ours
    with pytest.raises(TypeError, match="not callable"):
        prepared(setting, "threshold", targets="cone", episodes=1, jobs=1).play(1)


def test_what_a_decider_loads_is_no_time_of_a_decision(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("experiments.search.play.time.perf_counter", lambda: now[0])

    def load_once(observation):
        now[0] = 9.0
        return 7  # REJECT

    run = prepared(Setting(SceneChoice("coarse", fidelity="quasistatic")), {"mine": FunctionPolicy(load_once)}, jobs=1)
    now[0] = 0.0
    assert play_episodes(run.searches, run.deciders["mine"], 1, [0])[1].decision == 0.0


OWN = """
from dataclasses import dataclass
from activetouch.named_scenes import SCENES
from activetouch.rendering import PressureRenderer
from belief import Probe
from planners import Decision

def quits(*given):
    raise SystemExit(0)

class Later:
    def decide(self, info, rng):
        return quits() if info.history else Decision(Probe(0))

class Renderer(PressureRenderer):
    def __call__(self, contact):
        quits()

class Made:
    def __init__(self):
        quits()
"""
COMPARE = ("compare", "--scene", "coarse", "--targets", "cone", "--episodes", "1", "--jobs", "1")


@pytest.mark.parametrize(
    "words",
    [
        (*COMPARE, "--deciders", "own_quits:Later"),
        (*COMPARE, "--deciders", "own_quits:Made"),
        (*COMPARE, "--deciders", "policy:own_quits:quits"),
        (*COMPARE, "--deciders", "policy:own_quits:Made"),
        ("certify", "--scene", "coarse", "--decider", "own_quits:Later", "--jobs", "1"),
        ("live", "--sensor", "coarse", "--target", "cone", "--decider", "own_quits:Made"),
        ("touch", "--scene", "own_quits:quits", "--shape", "cube", "--out", "touch.png"),
        ("touch", "--scene", "coarse", "--renderer", "own_quits:Renderer", "--shape", "cube", "--out", "touch.png"),
    ],
    ids=" ".join,
)
def test_code_of_a_user_that_exits_ends_no_command_as_if_all_were_well(words, tmp_path, monkeypatch):
    (tmp_path / "own_quits.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(sys, "argv", ["activetouch", *words])
    monkeypatch.setitem(sys.modules, "own_quits", None)
    del sys.modules["own_quits"]
    with pytest.raises(SystemExit, match=r"own_quits\.py, line 9: raise SystemExit\(0\)\nSystemExit: 0"):
        main()


class Locked:
    """A decider that holds what cannot be copied, as one does that asks a robot or a database."""

    def __init__(self):
        self.lock = threading.Lock()
        self.inner = SequentialDecider(PosteriorThresholds(confirm=0.9, reject=0.1), FixedOrder())

    def decide(self, info, rng):
        return self.inner.decide(info, rng)

    def __call__(self, observation):
        return 6  # CONFIRM


@pytest.fixture
def locked(monkeypatch):
    """Setting of short searches, in which this module has the name ``locked``."""
    monkeypatch.setitem(sys.modules, "locked", sys.modules[__name__])
    monkeypatch.setattr(sys.modules[__name__], "held", Locked(), raising=False)
    return Setting(SceneChoice("coarse", fidelity="quasistatic"))


@pytest.mark.parametrize("settings", [{}, {"abstain": 0.02}])
def test_a_decider_that_cannot_be_copied_is_made_anew_for_each_batch(settings, locked):
    names = ("locked:Locked", "policy:locked:Locked", "fixed_poses(confirm=0.9, reject=0.1)")
    run = prepared(replace(locked, **settings), names, targets="cone", episodes=2, jobs=1)
    run.play(1)
    labels = run.searches.problem.shape_labels
    mine, policy, alike = ([read_episode(one, labels) for one in run.lines()[name, "cone"]] for name in names)
    assert [one.num_touches for one in mine] == [one.num_touches for one in alike] != [0, 0]
    assert [one.num_touches for one in policy] == [0, 0]
    assert fingerprint(copyable(names[0], run.known["outcome table"])) == fingerprint(Locked())


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("given", ["locked:held", {"mine": Locked()}])
def test_a_decider_that_cannot_be_made_anew_is_refused_before_the_first_search(given, jobs, locked):
    with pytest.raises(BrokenContract, match=r"cannot be copied \(.*lock.*name a class or a function that makes one"):
        prepared(locked, given, targets="cone", episodes=1, jobs=jobs)


def test_a_policy_that_sees_no_target_is_named_where_there_are_several(capsys):
    setting = Setting(SceneChoice("coarse", fidelity="quasistatic"))
    given = {"state='paper'": 1, "sees_target=True": 0, "state='posterior'": 0}
    for words, number in given.items():
        name = f"policy:tests.experiments.search.test_play:confirms({words})"
        prepared(setting, name, jobs=1)
        assert capsys.readouterr().err.count("sees no target: it plays all 4 targets alike") == number
        prepared(setting, name, targets=["cone"], jobs=1)
        assert "sees no target" not in capsys.readouterr().err


def confirms(observation):
    return 6
