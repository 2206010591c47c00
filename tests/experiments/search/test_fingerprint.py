"""A digest of what a decider is: another one for every edit and setting, the same one in every process."""

import importlib
import subprocess
import sys
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from planners import SequentialDecider
from planners.fingerprint import fingerprint
from planners.probing import FixedOrder, RandomOrder
from planners.stopping import PosteriorThresholds, ThresholdRule

ROOT = Path(__file__).parents[3]
MINE = """
from dataclasses import dataclass

from my_helper import often

LEAST = 1


class Base:
    patience = 3


@dataclass(frozen=True)
class Mine(Base):
    touches: int = 2

    def decide(self, info, rng):
        return often(self.touches) + LEAST
"""
HELPER = """
def often(touches):
    return 2 * touches
"""


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Writes the modules of a decider of a user's own and a helper, and makes the decider as a new process would."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def make(mine=MINE, helper=HELPER):
        (tmp_path / "my_helper.py").write_text(helper)
        (tmp_path / "my_decider.py").write_text(mine)
        for name in ("my_helper", "my_decider"):
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return importlib.import_module("my_decider").Mine()

    yield make
    for name in ("my_helper", "my_decider"):
        sys.modules.pop(name, None)


def test_the_same_text_and_settings_have_one_digest(write):
    assert fingerprint(write()) == fingerprint(write())


@pytest.mark.parametrize(
    "edit",
    [
        {"mine": MINE.replace("touches: int = 2", "touches: int = 6")},
        {"mine": MINE.replace("+ LEAST", "- LEAST")},
        {"helper": HELPER.replace("2 * touches", "3 * touches")},
    ],
)
def test_every_edit_of_a_decider_or_of_what_helps_it_is_another(write, edit):
    assert fingerprint(write()) != fingerprint(write(**edit))


@dataclass(eq=False)
class Settings:
    """Anything a decider may be made with."""

    value: object
    cache: dict = field(default_factory=dict, init=False)


class Plain:
    """An object without fields."""

    def __init__(self, value):
        self.value = value


class Slotted:
    """An object without a dictionary."""

    __slots__ = ("value",)

    def __init__(self, value):
        self.value = value


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (
            SequentialDecider(PosteriorThresholds(), FixedOrder()),
            SequentialDecider(PosteriorThresholds(), RandomOrder()),
        ),
        (SequentialDecider(PosteriorThresholds(), FixedOrder()), SequentialDecider(ThresholdRule(), FixedOrder())),
        (Plain(Plain(1)), Plain(Plain(2))),
        (Slotted(1), Slotted(2)),
        (1, True),
        (1, "1"),
        (0.99, 0.991),
        (1.0, 1),
        (np.array([1.0, 2.0]), np.array([1.0, 3.0])),
        (np.array([[1.0, 2.0]]), np.array([1.0, 2.0])),
        ({"a": 1}, {"a": 2}),
        ([1, 2], [2, 1]),
        (partial(max, 1), partial(max, 2)),
        ((lambda n: lambda: n)(1), (lambda n: lambda: n)(2)),
    ],
)
def test_other_settings_are_another(one, other):
    assert fingerprint(Settings(one)) == fingerprint(Settings(one))
    assert fingerprint(Settings(one)) != fingerprint(Settings(other))


def test_what_it_keeps_for_itself_and_who_holds_itself_do_not_matter():
    used = Settings(3)
    used.cache["seen"] = 1
    assert fingerprint(used) == fingerprint(Settings(3))
    loop = Plain(None)
    loop.value = loop
    assert fingerprint(loop) == fingerprint(loop)


def test_another_process_finds_the_same_digest():
    code = (
        "from planners.fingerprint import fingerprint; from planners.stopping import PosteriorThresholds;"
        "print(fingerprint(PosteriorThresholds(0.9)))"
    )
    command = [sys.executable, "-c", code]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    assert told == fingerprint(PosteriorThresholds(0.9))


def test_the_files_of_a_folder_count_by_content_wherever_it_lies(tmp_path):
    for name, text in (("a", "x"), ("b", "x"), ("c", "y")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "policy").write_text(text)
    a, b, c = (fingerprint(Settings(tmp_path / name)) for name in "abc")
    assert a == b != c
