"""One process at a time writes its results into a folder."""

import os
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

import pytest

from belief.errors import CannotWrite
from belief.files import claim_folder, ends_claims
from experiments.cli import commands
from tests.experiments.command_line.test_arguments import _NEEDED

fcntl = pytest.importorskip("fcntl")
IN_ONE_FILE = {"touch", "benchmark", "replay", "export", "certify", "pad-fit"}
WRITERS = [
    name
    for name, kind in commands().items()
    if any(field.name == "out" for field in fields(kind)) and name not in IN_ONE_FILE
]


@contextmanager
def locked(folder):
    """Lock a folder as another process does."""
    folder.mkdir(exist_ok=True)
    handle = os.open(folder, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    try:
        yield
    finally:
        os.close(handle)


@pytest.mark.parametrize("name", WRITERS)
def test_every_command_refuses_a_folder_that_another_process_writes(name, tmp_path):
    command = commands()[name](**{**_NEEDED.get(commands()[name], {}), "out": tmp_path / "out"})
    with locked(tmp_path / "out"), pytest.raises(CannotWrite, match="is in use: another process writes"):
        command.run()
    assert not list((tmp_path / "out").iterdir())


def test_a_claim_ends_with_its_function_and_leaves_no_folder(tmp_path):
    folder = tmp_path / "new" / "out"

    @ends_claims
    def inner(fails):
        claim_folder(tmp_path / "new" / "." / "out")
        claim_folder(tmp_path / "inner")
        if fails:
            raise KeyError

    @ends_claims
    def outer():
        claim_folder(folder)
        inner(False)
        assert not (tmp_path / "inner").exists()
        with pytest.raises(KeyError):
            inner(True)
        with pytest.raises(BlockingIOError):
            fcntl.flock(os.open(folder, os.O_RDONLY), fcntl.LOCK_EX | fcntl.LOCK_NB)

    outer()
    assert not list(tmp_path.iterdir())
    outer()


claim = ends_claims(claim_folder)


def test_a_claim_excludes_a_process_and_ends_when_its_own_is_killed(tmp_path):
    program = (
        f"import pathlib, belief.files as c; c = c.claim_folder(pathlib.Path({str(tmp_path)!r})); print(); input()"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        with pytest.raises(CannotWrite, match=r"is in use.*choose another --out"):
            claim(tmp_path)
        other.kill()
    claim(tmp_path)


def test_a_folder_without_locks_can_be_claimed(tmp_path, monkeypatch):
    def without(*_):
        raise OSError("no locks available")

    monkeypatch.setattr(fcntl, "flock", without)
    claim(tmp_path / "out")
    monkeypatch.setitem(sys.modules, "fcntl", None)  # as on Windows
    claim(tmp_path / "out")
    assert not list(Path(tmp_path).iterdir())
