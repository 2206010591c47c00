"""What the commands print to: text as it is, on any terminal.

Paths and labels are a user's. So nothing printed is read as rich's markup, and a character that the terminal's encoding
lacks is replaced, not an error at the end of the work.
"""

from __future__ import annotations

import codecs
import io
import sys
import unicodedata
from typing import IO

from rich.console import Console

_ALIKE = """
–- —- −- …... →-> ≤<= ≥>= ≠!= ×x ·. •* █# ‘' ’' “" ”" µu μu λlambda πpi σsigma ßss ─- ━- ╸- ╺- │| ╭+ ╮+ ╰+ ╯+
"""  # each character, and what it becomes
_PLAIN = {word[0]: word[1:] for word in _ALIKE.split()}


def plain_console(file: IO[str] | None = None, width: int | None = None, stderr: bool = False) -> Console:
    """A console that prints text as it is, with neither markup, nor names of emoji, nor colours of its own choice."""
    return Console(file=file, width=width, stderr=stderr, markup=False, emoji=False, highlight=False)


def print_on_any_terminal() -> None:
    """Have standard output and error replace characters that they cannot encode."""
    codecs.register_error("plain", _replace)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="plain")


def _replace(error: UnicodeError) -> tuple[str, int]:
    """Something like the characters that cannot be encoded, in ASCII."""
    assert isinstance(error, UnicodeEncodeError), "it is registered for writing only"
    return "".join(map(_plain, error.object[error.start : error.end])), error.end


def _plain(character: str) -> str:
    alike = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    return _PLAIN.get(character) or alike or "?"
