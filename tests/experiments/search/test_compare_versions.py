"""Numbers follow from what is played now: edited deciders, runs that grow, folders with more than was asked for."""

import json
import sys
from types import MappingProxyType

import pytest

import experiments.search.compare
import planners.registry
from activetouch.sensor_files import MODELS
from belief.errors import ActiveTouchError
from experiments.parallel import NoCluster
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.holdings import Selection
from experiments.search.run_folder import ORACLE, RunFolder, ShardKey
from experiments.search.setting import Setting

pytestmark = [pytest.mark.mujoco, pytest.mark.torch]
COARSE = Setting(SceneChoice("coarse"), num_objects=2)
QUASISTATIC = Setting(SceneChoice("coarse", fidelity="quasistatic"), num_objects=2)
MINE = """
from dataclasses import dataclass

from belief import Confirm, Probe, Reject
from planners.decider import Decision


@dataclass(frozen=True)
class Mine:
    touches: int = 2

    def decide(self, info, rng):
        if len(info.history) < self.touches:
            return Decision(Probe(len(info.history)))
        return Decision(Confirm() if info.target_prob > 0.9 else Reject())
"""


def compare(folder, *deciders, targets=("sphere",), **how):
    return Compare(deciders, targets=targets, out=folder, jobs=1, **{"setting": COARSE, "episodes": 4, **how})


def lines(folder):
    return [json.loads(line) for line in (folder / "episodes.jsonl").read_text().splitlines()]


@pytest.fixture
def table(monkeypatch):
    """Adds lines to the table of deciders."""

    def add(**builders):
        deciders = MappingProxyType({**planners.registry.DECIDERS, **builders})
        for module in (planners.registry, experiments.search.compare):
            monkeypatch.setattr(module, "DECIDERS", deciders)

    return add


def held_by(request):
    """The largest comparison in the folder of a run, and what else it holds."""
    problem, holdings, asked = request._filled()
    (chosen, reference, bounds), notes = request._largest(holdings, asked)
    return holdings.compare(problem, chosen, reference, request.seed, bounds), notes


def test_an_edited_decider_in_the_same_folder_gives_the_new_numbers(tmp_path, monkeypatch, table, capsys):
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def build():
        import my_own

        return my_own.Mine()

    def played(text, folder):
        (tmp_path / "my_own.py").write_text(text)
        sys.modules.pop("my_own", None)
        return compare(folder, "mine", "random_confirm").play().cells["mine", "all"].touches

    table(mine=build)
    edited = MINE.replace("touches: int = 2", "touches: int = 6")
    before = played(MINE, tmp_path / "run")
    kept = (tmp_path / "run" / "shards" / "random_confirm-sphere-00000.jsonl").stat().st_mtime_ns
    assert capsys.readouterr().err == ""
    after = played(edited, tmp_path / "run")
    assert "of another version (code, settings or policies): 1 of mine" in capsys.readouterr().err
    assert after > before
    assert after == played(edited, tmp_path / "fresh")
    assert lines(tmp_path / "run") == lines(tmp_path / "fresh")
    assert (tmp_path / "run" / "shards" / "random_confirm-sphere-00000.jsonl").stat().st_mtime_ns == kept
    sys.modules.pop("my_own", None)


def test_a_line_of_the_table_with_other_settings_is_another_decider(tmp_path, table):
    from planners import SequentialDecider
    from planners.probing import FixedOrder
    from planners.stopping import PosteriorThresholds

    touches = []
    for confirm in (0.6, 0.9999999):
        table(mine=lambda confirm=confirm: SequentialDecider(PosteriorThresholds(confirm), FixedOrder()))
        touches.append(compare(tmp_path, "mine").play().cells["mine", "all"].touches)
    assert touches[0] < touches[1]


def test_what_an_earlier_version_played_is_in_no_report(tmp_path, table):
    from planners.random_confirm import RandomConfirm
    from planners.threshold_rule import ThresholdRule

    table(mine=lambda: RandomConfirm())
    compare(tmp_path, "mine", "random_confirm").play()
    table(mine=lambda: ThresholdRule())
    small = compare(tmp_path, "random_confirm", episodes=1)
    small.play()
    assert {line["decider"] for line in lines(tmp_path)} == {"random_confirm"}
    assert held_by(small)[0].deciders == ["random_confirm"]


def test_as_many_episodes_are_played_as_were_asked_for(tmp_path):
    compare(tmp_path, "random_confirm").play()
    folder = RunFolder(tmp_path)
    assert {key.decider: len(folder.lines(key)) for key in folder.complete_keys()} == {"random_confirm": 4, ORACLE: 4}


def test_a_run_that_grew_ends_with_the_bytes_of_one_that_did_not(tmp_path):
    for folder, steps in (("grown", (3, 26, 28)), ("whole", (28,))):
        for episodes in steps:
            compare(tmp_path / folder, "threshold", "random_confirm", episodes=episodes, setting=QUASISTATIC).play()
    grown, whole = tmp_path / "grown", tmp_path / "whole"
    assert (grown / "episodes.jsonl").read_bytes() == (whole / "episodes.jsonl").read_bytes()
    for file in (whole / "shards").glob("*.jsonl"):
        assert (grown / "shards" / file.name).read_bytes() == file.read_bytes()


def test_a_small_run_leaves_the_larger_report_and_says_so(tmp_path):
    both = compare(tmp_path, "threshold", "random_confirm", targets=("sphere", "cone"))
    both.play()
    before = (tmp_path / "episodes.jsonl").read_bytes()
    small = compare(tmp_path, "random_confirm", episodes=1)
    assert small.play().cells["random_confirm", "all"].num_episodes == 1
    assert (tmp_path / "episodes.jsonl").read_bytes() == before
    held, told = held_by(small)
    assert (held.deciders, held.targets) == (["threshold", "random_confirm"], ["sphere", "cone"])
    assert "4 searches each" in " ".join(told)
    assert held_by(both)[1] == []


def test_what_a_report_leaves_out_is_named(tmp_path):
    compare(tmp_path, "threshold", "random_confirm", targets=("sphere", "cone")).play()
    other = compare(tmp_path, "fixed_poses", targets=("cone",), episodes=2)
    other.play()
    held, told = held_by(other)
    assert held.deciders == ["threshold", "random_confirm"]
    assert "2 of fixed_poses" in " ".join(told)
    assert sum(line["decider"] == "fixed_poses" for line in lines(tmp_path)) == 2


def test_a_selection_holds_those_that_are_no_larger_in_anything():
    some = Selection(("a", "b"), ("x",), 5)
    assert Selection(("b",), ("x",), 5) in some
    for other in (Selection(("c",), ("x",), 5), Selection(("a",), ("y",), 5), Selection(("a",), ("x",), 6), "a"):
        assert other not in some


def refused(folder, error, *deciders, **how):
    with pytest.raises(error):
        compare(folder, *deciders, **how).play()
    assert not folder.exists()


def test_a_refused_run_claims_no_folder(tmp_path, monkeypatch):
    folder = tmp_path / "run"
    paper = Setting(SceneChoice("gel"), sensor=MODELS / "paper")
    refused(folder, ActiveTouchError, "threshold", setting=paper)
    refused(folder, FileNotFoundError, "ppo", setting=Setting(SceneChoice("hard")))
    monkeypatch.setattr("experiments.parallel._SECONDS_TO_CONNECT", 0.2)
    refused(folder, NoCluster, "threshold", backend="dask", scheduler="nonsense")
    monkeypatch.setattr("activetouch.Scene.press", lambda *_: 1 / 0)
    refused(folder, ZeroDivisionError, "threshold")


def test_the_folder_of_another_run_stays_as_it_is_when_one_is_refused(tmp_path):
    compare(tmp_path, "random_confirm").play()
    before = (tmp_path / "run.json").read_bytes()
    with pytest.raises(ActiveTouchError):
        compare(tmp_path, "random_confirm", "nobody").play()
    assert (tmp_path / "run.json").read_bytes() == before


def test_a_shard_whose_digit_flipped_is_played_again(tmp_path):
    compare(tmp_path, "threshold").play()
    shard = tmp_path / "shards" / f"{ShardKey('threshold', 'sphere', 0).stem}.jsonl"
    whole = shard.read_bytes()
    shard.write_bytes(whole.replace(b'"target": 0', b'"target": 1', 1))
    assert shard.read_bytes() != whole
    compare(tmp_path, "threshold").play()
    assert shard.read_bytes() == whole
