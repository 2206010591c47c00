"""Readers that a wheel leaves out are fetched once, checked, and kept; every failure says what would work."""

import hashlib
import shutil
import subprocess
from pathlib import Path

import pytest

from activetouch import TactileSensor, fetched_models
from activetouch.errors import MissingWeights
from activetouch.fetched_models import FETCHED, FOLDER, model_file
from activetouch.sensor_files import READER_FILE

ROOT = Path(__file__).parents[2]
NAME = f"paper-independent/{READER_FILE}"


@pytest.fixture
def without(tmp_path, monkeypatch):
    """An installation whose sensor paper-independent lacks its reader."""
    folder = tmp_path / "models"
    shutil.copytree(FOLDER / "paper-independent", folder / "paper-independent")
    (folder / NAME).unlink()
    monkeypatch.setattr(fetched_models, "FOLDER", folder)
    monkeypatch.setattr("activetouch.sensor.tactile.MODELS", folder)
    monkeypatch.setenv("ACTIVETOUCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("ACTIVETOUCH_MODELS", str(FOLDER))
    return folder


def test_the_list_is_that_of_the_files_and_of_what_a_release_leaves_out():
    for name, wanted in FETCHED.items():
        content = (FOLDER / name).read_bytes()
        assert (hashlib.sha256(content).hexdigest(), len(content)) == wanted
        assert model_file(FOLDER / name) == FOLDER / name
    asked = ["make", "--no-print-directory", "--eval", "named: ; @echo $(FETCHED)", "named"]
    assert subprocess.run(asked, cwd=ROOT, capture_output=True, text=True).stdout.split() == list(FETCHED)


def test_a_sensor_without_its_reader_fetches_it_once(without, monkeypatch, capsys):
    assert TactileSensor.shipped("paper-independent").shape_labels == ("sphere", "cube", "cylinder", "cone")
    assert "fetching" in capsys.readouterr().err
    monkeypatch.setenv("ACTIVETOUCH_MODELS", "/nowhere")
    TactileSensor.shipped("paper-independent")
    assert not capsys.readouterr().err


def test_an_address_works_as_a_folder_does(without, monkeypatch):
    monkeypatch.setenv("ACTIVETOUCH_MODELS", FOLDER.as_uri())
    assert model_file(without / NAME).read_bytes() == (FOLDER / NAME).read_bytes()


@pytest.mark.parametrize("source", ["/nowhere", "file:///nowhere", "no-such-scheme://x", "http://127.0.0.1:1"])
def test_what_cannot_be_fetched_says_what_would_work(source, without, monkeypatch):
    monkeypatch.setenv("ACTIVETOUCH_MODELS", source)
    with pytest.raises(MissingWeights, match=r"cannot be fetched.*set ACTIVETOUCH_MODELS"):
        TactileSensor.shipped("paper-independent")


def test_another_file_is_not_kept(without, tmp_path, monkeypatch):
    other = tmp_path / "other" / NAME
    other.parent.mkdir(parents=True)
    other.write_bytes((FOLDER / NAME).read_bytes()[:-1] + b"x")
    monkeypatch.setenv("ACTIVETOUCH_MODELS", str(tmp_path / "other"))
    with pytest.raises(MissingWeights, match="SHA-256 differs"):
        model_file(without / NAME)
    assert not list((tmp_path / "cache").rglob("*.safetensors"))


def test_a_cache_that_cannot_be_written_is_named(without, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ACTIVETOUCH_CACHE", str(tmp_path / "file"))
    with pytest.raises(MissingWeights, match="ACTIVETOUCH_CACHE"):
        model_file(without / NAME)


def test_other_files_are_left_alone(tmp_path):
    assert model_file(tmp_path / "reader.safetensors") == tmp_path / "reader.safetensors"
    assert model_file(FOLDER / "nothing.safetensors") == FOLDER / "nothing.safetensors"
