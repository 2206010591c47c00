"""What the viewer of Rerun shows of a session: every answer, the belief, each image, the likeliest body."""

import io
import json
import re
import subprocess
import sys
from collections import Counter
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.cli import main

pytestmark = [
    pytest.mark.mujoco,
    pytest.mark.skipif(find_spec("rerun") is None, reason="needs the extra view"),  # whose import takes a second
]
PRESSED = np.zeros((4, 4), int)
PRESSED[1:3, 1:3] = 90


def live(*options, requests):
    lines = "".join(json.dumps(request) + "\n" for request in requests)
    words = [sys.executable, "-m", "experiments.cli", "live", "--sensor", "coarse", "--target", "cone", *options]
    return subprocess.run(words, input=lines, capture_output=True, text=True)


def here(*options, requests, monkeypatch):
    """The same in this process: its answers."""
    lines, said = "".join(json.dumps(request) + "\n" for request in requests), io.BytesIO()
    monkeypatch.setattr(
        "sys.argv", ["activetouch", "live", "--sensor", "coarse", "--target", "cone", *map(str, options)]
    )
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(lines.encode())))
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(said, write_through=True))
    main()
    return said.getvalue().decode()


def rows(path):
    """Number of rows of each entity of a recording, which is whole."""
    rerun = [sys.executable, "-m", "rerun", "rrd"]
    subprocess.run([*rerun, "verify", path], check=True, capture_output=True)
    said = subprocess.run([*rerun, "print", path], check=True, capture_output=True, text=True).stdout
    found = Counter()
    for number, entity in re.findall(r"with (\d+) rows .* - /(\S+) - data columns", said):
        found[entity] += int(number)
    return found


def test_a_session_is_written_into_a_file(tmp_path, monkeypatch):
    requests = [
        {"do": "ask"},
        {"do": "tell", "step": 0, "missed": True},
        {"do": "ask"},
        {"do": "tell", "step": 1, "image": PRESSED.tolist(), "force": 2.0},
        {"do": "undo"},
        {"do": "tell", "step": 3, "image": PRESSED.tolist(), "pose": "y45"},
        {"do": "dance"},
    ]
    place = tmp_path / "new" / "session.rrd"
    done = live("--view", place, "--log", tmp_path / "log.jsonl", requests=requests)
    plain = here("--log", tmp_path / "plain.jsonl", requests=requests, monkeypatch=monkeypatch)
    assert done.returncode == 0, done.stderr
    assert done.stdout == plain  # the viewer says nothing between the answers
    assert [json.loads(line)["ok"] for line in done.stdout.splitlines()] == [True] * 6 + [False]
    expected = {"answer": 7, "belief/words": 7, "belief/bars": 7, "felt": 2, "body": 2}
    assert {name: number for name, number in rows(place).items() if not name.startswith("__")} == expected


def test_a_file_that_cannot_be_written_is_said_in_a_line(tmp_path):
    done = live("--view", tmp_path, "--log", tmp_path / "log.jsonl", requests=[])
    assert done.returncode == 1
    assert json.loads(done.stdout)["error"] == "CannotWrite"
    assert "Traceback" not in done.stderr
