"""Nothing finished is lost, and a failed write leaves the old file."""

import pytest

from activetouch.atomic import atomic_path
from experiments.results import RunFolder, RunMismatch, ShardKey


def test_a_write_that_fails_leaves_the_old_file_and_no_debris(tmp_path):
    path = tmp_path / "result.json"
    path.write_text("old")

    def write_until_the_disk_is_full():
        with atomic_path(path) as temporary:
            temporary.write_text("half of the n")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_until_the_disk_is_full()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_write_makes_its_folder(tmp_path):
    with atomic_path(tmp_path / "a" / "b.txt") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "a" / "b.txt").read_text() == "new"


def test_a_folder_goes_on_with_its_own_run_only(tmp_path):
    folder = RunFolder(tmp_path)
    folder.open({"seed": 1, "scene": "x"}, {})
    folder.open({"seed": 1, "scene": "x"}, {})
    with pytest.raises(RunMismatch, match="other scene, seed"):
        folder.open({"seed": 2, "scene": "y"}, {})


def test_episodes_that_are_not_there_say_how_to_play_them(tmp_path):
    with pytest.raises(FileNotFoundError, match="activetouch compare --out"):
        RunFolder(tmp_path).lines(ShardKey("threshold", "a", 0))


def test_episodes_of_another_commit_are_kept_with_a_warning(tmp_path, monkeypatch):
    folder = RunFolder(tmp_path)
    assert folder.open({"seed": 1}, {}) is None
    monkeypatch.setattr("experiments.results._commit", lambda: "another")
    assert "another" in folder.open({"seed": 1}, {})
