"""Names of code in files: a command runs ``module:attribute`` only if its own command line names or allows it."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

from belief.errors import ActiveTouchError


class FileNamesCode(ActiveTouchError, ValueError):
    """A file names code that the command line does not name."""


@dataclass(frozen=True)
class Trust:
    """Code that a file may name: what is ``known`` from the command line, and ``everything`` with ``--trust``."""

    source: Path
    known: Collection[str] = ()
    everything: bool = False

    def allows(self, name: str) -> bool:
        """Whether a name is of a registry, or of code that may be used.

        >>> trust = Trust(Path("run.json"))
        >>> trust.allows("mine:scene(force=2)"), trust.allows("information_gain(given='a:b')")
        (False, True)
        """
        return self.everything or name in self.known or ":" not in name.partition("(")[0]

    def require(self, names: Iterable[str | None]) -> None:
        """Check the names of scenes, renderers or deciders that the file holds."""
        unknown = [str(name) for name in names if name and not self.allows(str(name))]  # a file may hold other types
        if unknown:
            raise FileNamesCode(
                f"{self.source} names code: {', '.join(dict.fromkeys(unknown))}. Reading a file runs no code that only "
                "the file names. If you know where it is from, add --trust"
            )
