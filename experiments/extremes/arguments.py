"""Extremes of the command line: every numeric argument of every command outside its range."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from experiments.command_line.arguments import BadArgument, Within, arguments
from experiments.extremes.cases import Case, refuses

_NEEDED = {
    "export": {"target": "cone", "out": Path("none")},
    "frontier": {"checkpoints": (Path("none.safetensors"),)},
    "merge": {"folders": (Path("none"),)},
    "recorded": {"data": Path("none"), "format": "csv"},
}
"""Arguments without a default."""


def out_of_range(name: str, kind: type) -> Iterator[tuple[str, float, Any]]:
    """Flag, value and command, for values outside the range of an argument.

    Args:
        name: name of the command.
        kind: class of the command.
    """
    command = kind(**_NEEDED.get(name, {}))
    for flag, path, value, rules in arguments(command):
        for rule in (rule for rule in rules if isinstance(rule, Within)):
            for wrong in (-1, 0, 2**63 if isinstance(rule.high, int) else math.nan):
                given = (wrong,) if isinstance(value, tuple) else wrong
                if rule.broken(given) is not None:
                    yield flag, wrong, changed(command, path, given)


def changed(command: Any, path: tuple[str, ...], value: Any) -> Any:
    """The command with one attribute changed, at any depth."""
    name, *rest = path
    inner = changed(getattr(command, name), tuple(rest), value) if rest else value
    return replace(command, **{name: inner})


def _cases() -> Iterator[Case]:
    from experiments.cli import commands

    for name, kind in commands().items():
        for flag, wrong, command in out_of_range(name, kind):
            yield refuses(name, f"{flag} {wrong}", command.run, BadArgument, f"{flag} must be in .*got {wrong}")


CASES: tuple[Case, ...] = tuple(_cases())
"""Every command must name the flag and the value and stop."""
