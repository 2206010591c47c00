"""Short names of deciders for tables, figures and sentences: settings that all of them share are said once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from belief.references import BadReference, Reference

MOST = 36
"""Length from which a name is replaced by its first word and a number."""


def short_names(names: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """What deciders are called where space is short, and sentences that say what was left out.

    Args:
        names: deciders as on the command line, all different.

    >>> both = "information_gain(given='shape', confirm=0.98)", "random_poses(confirm=0.98)"
    >>> found, said = short_names([*both, "random_confirm"])
    >>> list(found.values())
    ["information_gain(given='shape')", 'random_poses', 'random_confirm']
    >>> said
    ['All but random_confirm have the settings confirm=0.98.']
    """
    settings = {name: found for name in names if (found := _settings(name))}
    shared = _shared(list(settings.values()))
    short = {name: _spec(name, settings[name], shared) if name in settings else name for name in names}
    if len(set(short.values())) < len(names):
        short, shared = {name: name for name in names}, {}
    plain = [name for name in names if name not in settings]
    long = {name: f"{_first_word(name)} {n}" for n, name in enumerate(names, start=1) if len(short[name]) > MOST}
    short |= long
    said = [f"{name} is {full}." for full, name in long.items()]
    if shared:
        if len(names) == 1:
            who = "It has"
        elif len(settings) == 1:
            who = f"{short[next(iter(settings))]} has"
        else:
            who = f"All but {', '.join(plain)} have" if plain else "All have"
        said.insert(0, f"{who} the settings {_words(shared)}.")
    return short, said


def _settings(name: str) -> Mapping[str, Any]:
    try:
        return Reference.parse(name).settings
    except BadReference:  # such as sb3:PATH
        return {}


def _shared(settings: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Settings that are the same in all."""
    first = dict(settings[0]) if settings else {}
    return {key: value for key, value in first.items() if all((key, value) in other.items() for other in settings)}


def _spec(name: str, settings: Mapping[str, Any], shared: Mapping[str, Any]) -> str:
    own = {key: value for key, value in settings.items() if key not in shared}
    return f"{_first_word(name)}({_words(own)})" if own else _first_word(name)


def _first_word(name: str) -> str:
    try:
        return Reference.parse(name).name
    except BadReference:
        return name.partition(":")[0]


def _words(settings: Mapping[str, Any]) -> str:
    return ", ".join(f"{key}={value!r}" for key, value in settings.items())
