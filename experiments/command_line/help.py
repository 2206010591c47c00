"""The help of a command: its options in groups, with defaults where there are any."""

from __future__ import annotations

import argparse
import inspect
import re
import shutil
import textwrap
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import tyro

_LEFT = 26  # characters before an explanation
_NO_DEFAULT = re.compile(r" ?\(default: (?:None|False)?\)$")


def help_of(kind: type, name: str, **known: Any) -> str:
    """The text that ``activetouch NAME --help`` prints; ``known`` may hold ``default``, an instance to show."""
    parser = _parser(kind, name, **known)
    width = max(shutil.get_terminal_size().columns, 40)
    places = [str(action.metavar) for action in parser._actions if not action.option_strings]
    lines = [" ".join(["usage: activetouch", name, *places, "[OPTIONS]"]), "", *_description(kind, width)]
    for group in parser._action_groups:
        if actions := [action for action in group._group_actions if "--help" not in action.option_strings]:
            lines += ["", (group.description or group.title or "options").strip().rstrip(".").capitalize() + ":"]
            for action in actions:
                lines += _option(action, width)
    return "\n".join(lines)


_SYNONYMS = "scene/sensor objects/num-objects episodes/searches target/targets agent/deciders"  # of options
_ALIKE = [{f"--{name}" for name in names.split("/")} for names in _SYNONYMS.split()]


def hints(command: str, words: Sequence[str], commands: Mapping[str, type]) -> list[str]:
    """Lines on the options among some words that a command lacks and others have: its own name of it, or these."""
    given = dict.fromkeys(word.partition("=")[0] for word in words if word.startswith("--"))
    options = {name: {*_parser(kind, name)._option_string_actions} for name, kind in commands.items()}
    lines = []
    for option in (option for option in given if option not in options[command]):
        others = [name for name, has in options.items() if option in has]
        if alike := [name for names in _ALIKE if option in names for name in names & options[command]]:
            lines.append(f"{command} takes {alike[0]} in place of {option}")
        elif others:
            lines.append(f"{option} is an option of {', '.join(others)}, not of {command}")
    return lines


def _parser(kind: type, name: str, **known: Any) -> Any:
    """The parser of a command."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # there is no other way to the options
        return tyro.extras.get_parser(kind, prog=f"activetouch {name}", **known)


def _description(kind: type, width: int) -> list[str]:
    """The docstring: paragraphs wrapped, examples as they are."""
    lines = list[str]()
    for paragraph in (inspect.getdoc(kind) or "").split("\n\n"):
        is_example = paragraph.startswith("    ")
        lines += ["", *(paragraph.splitlines() if is_example else textwrap.wrap(paragraph, width))]
    return lines[1:]


def _option(action: argparse.Action, width: int) -> list[str]:
    """Lines of an option: what to write, and what it does."""
    shown = ", ".join(name for name in action.option_strings if action.default is True or name[:5] != "--no-")
    value = re.sub(r"\[(\S+) \[\S+ \.\.\.\]\]", r"\1 ...", str(action.metavar or "")).replace("{None}|", "")
    words = f"{shown} {value.replace('{None,', '{')}".strip()
    left = textwrap.wrap(words, width - 2, initial_indent="  ", subsequent_indent="    ")
    right = textwrap.wrap(_NO_DEFAULT.sub("", " ".join((action.help or "").split())), width - _LEFT) or [""]
    if len(left) == 1 and len(left[0]) + 2 <= _LEFT:
        left = [f"{left[0]:<{_LEFT}}{right.pop(0)}"]
    return [*left, *(" " * _LEFT + line for line in right)]
