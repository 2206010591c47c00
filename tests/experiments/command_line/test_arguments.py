"""Every number on the command line has a range; outside it a command refuses, by name, before it does anything."""

import math
import sys
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, get_args, get_origin, get_type_hints

import joblib
import pytest
from tyro.conf import OmitArgPrefixes

from belief.constraints import Constraint, Within
from belief.errors import ActiveTouchError
from experiments.cli import commands, main
from experiments.command_line.arguments import BadArgument, arguments
from experiments.meshes.find import Find
from experiments.meshes.identify import Identify
from experiments.paper.reproduce import Reproduce
from experiments.press.touch import TouchCommand
from experiments.recorded.recorded import Recorded
from experiments.search.export import Export
from experiments.search.live import Live
from experiments.search.replay import Replay
from experiments.sensor.pad_fit import PadFitCommand
from experiments.tradeoff.tradeoff import Tradeoff

_NEEDED = {
    Export: {"folder": Path("none"), "out": Path("none")},
    Find: {"folder": Path("none"), "target": "mug"},
    Identify: {"folder": Path("none")},
    Live: {"target": "cone"},
    PadFitCommand: {"pad": Path("none"), "presses": Path("none"), "radius_mm": 10.0},
    Recorded: {"data": Path("none"), "format": "csv"},
}


def _kinds(annotation):
    """The types of numbers that an argument takes."""
    if get_origin(annotation) is Annotated:
        return _kinds(get_args(annotation)[0])
    if annotation in (int, float):
        return {annotation}
    return set().union(*map(_kinds, get_args(annotation)))


def _numbers(kind, path=(), prefix="--"):
    """Flag, path of attributes, and types of every number of a command."""
    command = kind(**_NEEDED.get(kind, {})) if not path else kind
    annotations = get_type_hints(type(command), include_extras=True)
    for field in fields(command):
        value, annotation = getattr(command, field.name), annotations[field.name]
        flag = prefix + field.name.replace("_", "-")
        if is_dataclass(value):
            metadata = getattr(annotation, "__metadata__", ())
            flat = any(one is OmitArgPrefixes or getattr(one, "name", None) == "" for one in metadata)
            yield from _numbers(value, (*path, field.name), prefix if flat else f"{flag}.")
        elif kinds := _kinds(annotation):
            yield flag, (*path, field.name), kinds, isinstance(value, tuple)


def _changed(command, path, value):
    """The command with an argument changed, however deep it lies."""
    name, *rest = path
    return replace(command, **{name: _changed(getattr(command, name), rest, value) if rest else value})


def _values(kinds):
    return [-1, 2**63] if kinds == {int} else [-1.0, math.nan]


@pytest.fixture(autouse=True)
def idle(monkeypatch):
    """No command begins to work."""

    def work(*_):
        raise AssertionError("the work was begun")

    monkeypatch.setattr(joblib.Parallel, "__call__", work)


CASES = [
    pytest.param(kind, path, (value,) if many else value, flag, id=f"{name} {flag} {value}")
    for name, kind in commands().items()
    for flag, path, kinds, many in _numbers(kind)
    for value in _values(kinds)
]


@pytest.mark.parametrize(("kind", "path", "value", "flag"), CASES)
def test_a_number_out_of_its_range_is_refused_by_name_before_anything_is_done(
    kind, path, value, flag, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ActiveTouchError) as refused:
        _changed(kind(**_NEEDED.get(kind, {})), path, value).run()
    assert flag in str(refused.value)
    shown = value[0] if isinstance(value, tuple) else value
    assert str(shown) in str(refused.value)
    assert not list(tmp_path.iterdir())
    said = capsys.readouterr().out
    assert said.startswith('{"ok": false, "error": "BadArgument"') if kind is Live else not said


def test_zero_is_refused_wherever_it_is_out_of_range():
    tried = 0
    for kind in set(commands().values()):
        command = kind(**_NEEDED.get(kind, {}))
        paths = {flag: (path, many) for flag, path, _, many in _numbers(kind)}
        for flag, _, annotation in arguments(command):
            if any(isinstance(rule, Within) and rule.broken(0) for rule in Constraint.of(annotation).rules):
                path, many = paths[flag]
                with pytest.raises(BadArgument, match=flag):
                    _changed(command, path, (0,) if many else 0).run()
                tried += 1
    assert tried > 30


@pytest.mark.parametrize(
    ("kind", "name"),
    [(TouchCommand, "x.docx"), (Replay, "x.mp4"), (Replay, "x.bmp")],
)
def test_a_file_of_an_unknown_format_is_refused_before_anything_is_made(kind, name, tmp_path):
    with pytest.raises(BadArgument, match=rf"--out must end in .*\.png.*, got .*{name}"):
        kind(out=tmp_path / name).run()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["collect", "--plan.train", "-1"], ["--plan.train", "-1"]),
    ],
)
def test_the_command_line_ends_in_one_message(arguments, words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["activetouch", *arguments])
    with pytest.raises(SystemExit) as end:
        main()
    message = str(end.value.code)
    assert message.startswith("activetouch: ")
    assert all(word in message for word in words)
    assert "tyro" not in message + capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "flag"),
    [(Tradeoff(scenes=()), "--scenes"), (Reproduce(parts=()), "--parts")],
)
def test_an_empty_list_of_things_to_do_is_refused(command, flag):
    with pytest.raises(BadArgument, match=f"{flag} must name at least one"):
        command.run()
