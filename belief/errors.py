"""Exceptions that all packages of the project raise."""

from __future__ import annotations

from pathlib import Path


class ActiveTouchError(Exception):
    """Base class of the errors that this project raises deliberately."""


class InvalidArgument(ActiveTouchError, ValueError):
    """An argument is invalid; the message states the given value and the valid ones."""


class ImpossibleObservation(ActiveTouchError, ValueError):
    """The evidence has zero likelihood under every hypothesis of positive probability.

    The belief is unchanged. A smoothed observation model never assigns likelihood zero.
    """


class CorruptFile(ActiveTouchError, ValueError):
    """A file is truncated, is of another kind, or was changed after it was written."""


class CannotWrite(ActiveTouchError, OSError):
    """A file cannot be written: the disk is full, or the folder is read-only or is not a folder."""


class MissingPackage(ActiveTouchError, ImportError):
    """An optional package is not installed; the message says how to install it."""


def install_command(extra: str) -> str:
    """The command that installs an extra here: in a clone, of the clone; otherwise from an index.

    >>> install_command("train").endswith("[train]'")
    True
    """
    root, here = Path(__file__).parents[1] / "pyproject.toml", Path("pyproject.toml")
    place = "activetouch" if not root.is_file() else "." if here.exists() and here.samefile(root) else root.parent
    return f"pip install '{place}[{extra}]'"


class CodeFailed(ActiveTouchError, RuntimeError):
    """Code of a user, such as a decider, raised an exception; the message names the line."""


class BrokenContract(ActiveTouchError, AssertionError):
    """A user's object violates its protocol; the message states the rule and the input."""


class UnknownName(ActiveTouchError, KeyError):
    """A name is not in a registry; the message suggests the nearest name and lists all names."""

    def __init__(self, kind: str, name: str, known: list[str]) -> None:
        from difflib import get_close_matches

        nearest = get_close_matches(name, known, n=1)
        hint = f" Did you mean {nearest[0]!r}?" if nearest else ""
        super().__init__(f"unknown {kind} {name!r}.{hint} Known: {', '.join(known)}.")
        self._arguments = (kind, name, known)

    def __reduce__(self) -> tuple[type[UnknownName], tuple[str, str, list[str]]]:
        return UnknownName, self._arguments  # so that it can be pickled

    def __str__(self) -> str:
        return str(self.args[0])


class ZeroPriorTarget(UserWarning):
    """The target shape has prior probability zero, so no touch can find it."""
