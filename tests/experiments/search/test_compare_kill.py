"""A real process is killed without warning, in the middle of a run; nothing finished is lost, nothing is doubled."""

import os
import signal
import subprocess
import sys
import time

import pytest

from experiments.search.run import RunFolder

pytestmark = [pytest.mark.mujoco, pytest.mark.torch, pytest.mark.slow]
SMALL = {"deciders": ("threshold", "random_confirm"), "targets": ("sphere",), "episodes": 26}
OPTIONS = [
    "--deciders",
    *SMALL["deciders"],
    "--targets",
    *SMALL["targets"],
    "--episodes",
    "26",
    *("--scene", "coarse", "--fidelity", "quasistatic", "--num-objects", "1", "--observation-model", "independent"),
]


def start(folder, *more):
    """The command in a process group of its own."""
    command = [sys.executable, "-m", "experiments.cli", "compare", *OPTIONS, "--jobs", "1", "--out", str(folder), *more]
    return subprocess.Popen(
        command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )


def batches(folder):
    """The intact batches by cell and number."""
    run, cells = RunFolder(folder), [(decider, "sphere") for decider in SMALL["deciders"]]
    return {(cell, number): b for cell in cells for held in run.batches(cell).values() for number, b in held.items()}


FINISH = f"""
import sys
from experiments.cli import _parsed

for folder in sys.argv[1:]:
    _parsed(["compare", *{OPTIONS}, "--jobs", "1", "--out", folder]).play()  # all but the report
"""


def finish(*folders):
    """The same command to its end, in a process of its own, as fixtures of other tests count as other code."""
    command = [sys.executable, "-c", FINISH, *map(str, folders)]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return [(folder / "episodes.jsonl").read_bytes() for folder in folders]


def test_a_run_that_was_killed_ends_like_one_that_was_not(tmp_path):
    process = start(tmp_path / "killed")
    deadline = time.monotonic() + 120
    while process.poll() is None and not batches(tmp_path / "killed") and time.monotonic() < deadline:
        time.sleep(0.01)
    assert process.poll() is None, process.stderr.read()
    os.killpg(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    process.stderr.close()
    kept = batches(tmp_path / "killed")
    assert 1 <= len(kept) < 4
    whole = tmp_path / "whole"  # nothing happens to it
    lines, expected = finish(tmp_path / "killed", whole)
    after = batches(tmp_path / "killed")
    assert {name: after[name] for name in kept} == kept
    assert len(after) == 4  # two batches of each decider
    assert lines.count(b"\n") == len(set(lines.splitlines())) == 2 * 26
    assert lines == expected
    assert {key: one.lines for key, one in after.items()} == {key: one.lines for key, one in batches(whole).items()}
