"""A record holds what its command found, and nothing older."""

import json
import os
from dataclasses import asdict
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from belief.statistics import wilson_interval
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.play import Setting

_SPEC = spec_from_file_location("run_record", Path(__file__).parent.parent / "docs" / "generate" / "run_record.py")


@pytest.fixture
def run_record(tmp_path, monkeypatch):
    """The script, with records in another folder, for code that is committed."""
    script = module_from_spec(_SPEC)
    _SPEC.loader.exec_module(script)
    monkeypatch.setattr(script, "ROOT", tmp_path)
    monkeypatch.setattr(script, "RECORDS", tmp_path / "records")
    monkeypatch.setattr(script, "commit", lambda: "abc")
    return script


def test_a_record_holds_the_output_and_the_files_of_its_command(run_record, tmp_path):
    run_record.main("a/b", ["new.txt"], ["python", "-c", "open('new.txt', 'w').write('found'); print('said')"])
    text = (tmp_path / "records" / "a" / "b.txt").read_text()
    assert text.startswith("command: python -c")
    assert "\ncommit: abc\n" in text
    assert text.endswith("\n\nsaid\n\nnew.txt:\n\nfound\n")


@pytest.mark.parametrize("is_there", [False, True], ids=["missing", "of an earlier run"])
def test_a_file_that_the_command_did_not_write_is_refused(run_record, tmp_path, is_there):
    if is_there:
        (tmp_path / "old.txt").write_text("stale")
        os.utime(tmp_path / "old.txt", (1e9, 1e9))
    with pytest.raises(SystemExit, match=r"did not write old\.txt"):
        run_record.main("a/b", ["old.txt"], ["python", "-c", "print('said')"])
    assert not (tmp_path / "records").exists()


def test_a_command_that_fails_leaves_no_record(run_record, tmp_path):
    with pytest.raises(SystemExit, match="failed with status 3"):
        run_record.main("a/b", [], ["python", "-c", "raise SystemExit(3)"])
    assert not (tmp_path / "records").exists()


@pytest.fixture
def records():
    spec = spec_from_file_location("records", Path(__file__).parent.parent / "docs" / "generate" / "records.py")
    script = module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


def test_a_comparison_with_settings_that_its_record_would_not_name_is_refused(records, tmp_path):
    arguments = asdict(Compare(targets=("cone",), seed=1, setting=Setting(SceneChoice("coarse"), touch_cost=0.05)))
    (tmp_path / "run.json").write_text(json.dumps({"arguments": arguments, "identity": {}}, default=str))
    with pytest.raises(SystemExit, match=r"other settings: targets \['cone'\], touch_cost 0\.05$"):
        records.record(tmp_path)


def found(seed, won, searches=100, touches=4.0, **others):
    row = {"searches": searches, "success": [won / searches, 0.0, 1.0], "touches": touches, "return": 0.5}
    return {"command": f"activetouch compare --seed {seed}", "commit": "abc", "deciders": {"mine": row}} | others


def test_a_record_of_several_seeds_counts_all_their_searches(records):
    one = records.pooled([found(1, 90), found(2, 300, searches=300, touches=8.0)])
    assert one["seeds"] == [1, 2]
    assert one["command"].endswith("--seed 1")
    mine = one["deciders"]["mine"]
    assert mine["searches"] == 400
    assert mine["success"] == [390 / 400, *wilson_interval(390, 400)]
    assert (mine["touches"], mine["return"], mine["touches_by_seed"]) == (7.0, 0.5, [4.0, 8.0])


@pytest.mark.parametrize(
    "other",
    [found(1, 80), found(2, 80, commit="def"), found(2, 80) | {"command": "activetouch compare --cost 1 --seed 2"}],
)
def test_runs_of_one_seed_or_of_other_code_are_not_pooled(records, other):
    with pytest.raises(SystemExit, match="not pooled"):
        records.pooled([found(1, 90), other])
