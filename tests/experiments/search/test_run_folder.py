"""A run folder loses nothing that was finished, and takes nothing that is damaged or of another run."""

import errno
import json
import os

import pytest

from belief.errors import CannotWrite, CorruptFile
from belief.files import sealed_json
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.search.comparison import Comparison, prepared
from experiments.search.export import Export
from experiments.search.play import EPISODES_PER_BATCH, Seconds, Setting
from experiments.search.replay import Replay
from experiments.search.results import compare_results
from experiments.search.run import Batch, RunFolder, RunMismatch, _file_name

CELL = ("threshold", "cone")
ARGUMENTS = {"deciders": ["threshold"], "targets": ["cone"], "episodes": 50, "seed": 0, "setting": None}


def batch(number, size=EPISODES_PER_BATCH, word="x"):
    lines = [json.dumps({"seed": [0, 0, EPISODES_PER_BATCH * number + n], "word": word}) + "\n" for n in range(size)]
    return Batch(lines, Seconds(1.0, 2.0, 3.0, 4, 5))


def started(path, *numbers, key="k", identity=None):
    folder = RunFolder(path)
    folder.start(identity or {"seed": 0}, ARGUMENTS)
    for number in numbers:
        folder.add(CELL, key, number, batch(number))
    return folder


def file_of(folder):
    return folder / "cells" / _file_name(CELL)


@pytest.mark.parametrize("in_memory", [True, False])
def test_batches_read_back_as_they_were_written(tmp_path, in_memory):
    folder = started(None if in_memory else tmp_path, 1, 0)
    again = folder if in_memory else RunFolder(tmp_path)
    assert again.held(CELL, "k") == {0: batch(0), 1: batch(1)}
    assert again.lines(CELL, "k") == [*batch(0).lines, *batch(1).lines]
    assert again.held(CELL, "another version") == {}


def test_episodes_count_up_to_the_first_batch_that_is_missing_or_short(tmp_path):
    folder = started(tmp_path, 0, 2)
    assert len(folder.lines(CELL, "k")) == 25
    folder.add(CELL, "k", 1, batch(1, 5))
    assert len(folder.lines(CELL, "k")) == 30


@pytest.mark.parametrize("kept", [0.2, 0.999])
def test_what_a_kill_leaves_unfinished_counts_as_missing_and_the_next_batch_is_whole(tmp_path, kept):
    started(tmp_path, 0, 1)
    content = file_of(tmp_path).read_bytes()
    first = len(content) // 2  # of two batches of the same length
    file_of(tmp_path).write_bytes(content[: first + int(kept * first)])
    folder = RunFolder(tmp_path)
    assert sorted(folder.held(CELL, "k")) == [0]
    folder.add(CELL, "k", 1, batch(1))
    assert RunFolder(tmp_path).held(CELL, "k") == {0: batch(0), 1: batch(1)}


@pytest.mark.parametrize("place", [0.01, 0.7])
def test_a_digit_that_flips_is_noticed(tmp_path, place):
    started(tmp_path, 0)
    content = bytearray(file_of(tmp_path).read_bytes())
    at = next(i for i in range(int(place * len(content)), len(content)) if chr(content[i]).isdigit())
    content[at] = ord("1") if content[at] == ord("0") else ord("0")
    file_of(tmp_path).write_bytes(content)
    assert RunFolder(tmp_path).held(CELL, "k") == {}


def test_a_folder_goes_on_with_its_own_run_only(tmp_path):
    started(tmp_path, identity={"seed": 0, "scene": "a"})
    RunFolder(tmp_path).require({"seed": 0, "scene": "a"})
    with pytest.raises(RunMismatch, match=r"another run: other scene .*; other seed\. Give this run a folder"):
        RunFolder(tmp_path).start({"seed": 1, "scene": "b"}, ARGUMENTS)
    assert RunFolder(tmp_path).read_run()["identity"]["seed"] == 0


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", sealed_json({"format": 4}), sealed_json({"format": 3}), sealed_json({"format": 99}), "{}"],
)
def test_a_damaged_run_json_or_one_of_another_version_is_a_clear_error_and_stays(tmp_path, text):
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(CorruptFile, match=r"run\.json does not describe a run: .*Choose another --out"):
        RunFolder(tmp_path).start({"seed": 0}, ARGUMENTS)
    assert (tmp_path / "run.json").read_text() == text


def test_a_full_disk_loses_nothing_and_says_what_to_do(tmp_path, monkeypatch):
    folder = started(tmp_path, 0)

    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(CannotWrite, match="make room"):
            folder.add(CELL, "k", 1, batch(1))
    assert RunFolder(tmp_path).held(CELL, "k")[0] == batch(0)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({}, ""),
        ({"deciders": ["information_gain(given='shape')", "sb3:cone.zip"]}, "--trust "),
        ({"setting": {"choice": {"scene": "mine:scene", "renderer": None}}}, "--trust "),
    ],
)
def test_the_command_that_repeats_a_run_trusts_the_code_that_the_run_names(tmp_path, changes, word):
    folder = RunFolder(tmp_path / "run")
    folder.start({"seed": 0}, ARGUMENTS | changes)
    assert folder.command("compare", config="run.json") == f"activetouch compare {word}--config run.json"
    with pytest.raises(FileNotFoundError, match=f"finish it with:\nactivetouch compare {word}--config"):
        folder.latest(("cone",))


def played(folder, episodes=4):
    """A comparison without touches."""
    coarse = Setting(SceneChoice("coarse"))
    prepared(coarse, "random_confirm", targets="cone", episodes=episodes, out=folder, jobs=1).play(jobs=1)
    return (folder / "episodes.jsonl").read_bytes()


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder with a finished comparison, and the bytes of its episodes."""
    folder = tmp_path_factory.mktemp("finished")
    return folder, played(folder)


READERS = {
    "load": lambda run: Comparison.load(run),
    "export": lambda run: Export(folder=run, out=run / "paper").run(),
    "replay": lambda run: Replay(run, decider="random_confirm", target="cone", out=run / "search.png").run(),
    "results": lambda run: compare_results([run]),
    "results by file": lambda run: compare_results([run / "episodes.jsonl"]),
}


@pytest.mark.mujoco
@pytest.mark.parametrize("reader", READERS)
def test_every_reader_of_a_run_refuses_episodes_that_were_changed_or_removed(finished, reader, tmp_path):
    folder, content = finished
    lines, file = content.splitlines(keepends=True), folder / "episodes.jsonl"
    other = content.replace(b'"confirmed"', b'"exhausted"')
    assert other != content
    for changed, told in (
        (other, "it was changed, its content does not match its digest"),
        (b"".join(lines[:2]), "it has 2 lines, and run.json says 4"),
        (b"".join([*lines[:3], lines[0]]), "it was changed"),
        (content[:-1], "it has 3 lines"),
        (b"", "it has 0 lines"),
        (b"\xff" * 9, "it has 0 lines"),
    ):
        file.write_bytes(changed)
        with pytest.raises(CorruptFile, match=rf"{told}.* Repeat the call .*\nactivetouch compare --config"):
            READERS[reader](folder)
    assert played(folder) == content
    Comparison.load(folder)


@pytest.mark.mujoco
def test_a_run_with_more_episodes_is_sealed_again_and_one_of_an_earlier_version_is_played_again(tmp_path):
    first, more = played(tmp_path), played(tmp_path, 6)
    assert more[: len(first)] == first
    assert len(Comparison.load(tmp_path).of("random_confirm")) == 6
    text = (tmp_path / "run.json").read_text()
    fields = {name: value for name, value in json.loads(text).items() if name not in ("sha256", "episodes")}
    for older in (fields, {**fields, "episodes": None}, {**fields, "episodes": [6]}):
        (tmp_path / "run.json").write_text(sealed_json(older))
        with pytest.raises(CorruptFile, match=r"no digest of it, so its comparison did not finish, or .* earlier"):
            Comparison.load(tmp_path)
    assert played(tmp_path, 6) == more
    assert (tmp_path / "run.json").read_text() == text


@pytest.mark.mujoco
def test_a_comparison_that_is_killed_keeps_the_one_before_readable(finished):
    folder, content = finished
    text, run = (folder / "run.json").read_text(), RunFolder(folder).read_run()
    RunFolder(folder).start(run["identity"], {**run["arguments"], "episodes": 6})
    assert RunFolder(folder).latest(["sphere", "cube", "cylinder", "cone"])["random_confirm", "cone"]
    assert played(folder) == content
    assert (folder / "run.json").read_text() == text


@pytest.mark.mujoco
def test_a_run_of_other_versions_is_not_continued(tmp_path):
    played(tmp_path)
    fields = json.loads((tmp_path / "run.json").read_text())
    fields["identity"]["versions"]["onnxruntime"] = "1.0"
    (tmp_path / "run.json").write_text(sealed_json({key: fields[key] for key in fields if key != "sha256"}))
    with pytest.raises(RunMismatch, match="other versions"):
        played(tmp_path)


def test_only_the_episodes_of_a_run_stand_for_it(tmp_path):
    (tmp_path / "copy.jsonl").write_text("{}\n")
    with pytest.raises(BadArgument, match="has no column"):
        compare_results([tmp_path / "copy.jsonl"])
