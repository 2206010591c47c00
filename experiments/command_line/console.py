"""Printing on any terminal: no markup is interpreted, and characters that the encoding lacks are replaced."""

from __future__ import annotations

import codecs
import io
import sys
import unicodedata
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any

from rich.console import Console

_ALIKE = """
–- —- −- …... →-> ≤<= ≥>= ≠!= ×x ·. •* █# ‘' ’' “" ”" µu μu λlambda πpi σsigma ßss ─- ━- ╸- ╺- │| ╭+ ╮+ ╰+ ╯+
"""  # each character and its replacement
_PLAIN = {word[0]: word[1:] for word in _ALIKE.split()}


def plain_console(file: IO[str] | None = None, width: int | None = None) -> Console:
    """A console that prints text unchanged: no markup, no emoji names, no automatic colours."""
    return Console(file=file, width=width, markup=False, emoji=False, highlight=False)


def print_on_any_terminal() -> None:
    """Make standard output and error replace characters that they cannot encode."""
    codecs.register_error("plain", _replace)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="plain")


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Print warnings of this project to stderr as one line each; Python prints those of other libraries."""
    with warnings.catch_warnings():
        show_others = warnings.showwarning

        def show(message: Any, category: type[Warning], *place: Any) -> None:
            if category.__module__.partition(".")[0] in ("activetouch", "belief", "planners", "experiments"):
                print(f"warning: {message}", file=sys.stderr)
            else:
                show_others(message, category, *place)

        warnings.showwarning = show  # type: ignore[assignment]
        yield


def _replace(error: UnicodeError) -> tuple[str, int]:
    """ASCII replacement of the characters that cannot be encoded."""
    assert isinstance(error, UnicodeEncodeError), "registered for writing only"
    characters = error.object[error.start : error.end]
    alike = [unicodedata.normalize("NFKD", one).encode("ascii", "ignore").decode() for one in characters]
    return "".join(_PLAIN.get(one) or like or "?" for one, like in zip(characters, alike, strict=True)), error.end
