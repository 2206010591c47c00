"""Exceptions that all packages of the project raise."""

from __future__ import annotations


class ActiveTouchError(Exception):
    """Base class of every error this project raises on purpose."""


class InvalidArgument(ActiveTouchError, ValueError):
    """An argument is invalid; the message states the given value and the valid ones."""


class ImpossibleObservation(ActiveTouchError, ValueError):
    """The evidence has zero likelihood under every hypothesis still believed in.

    The belief is unchanged. A smoothed observation model never assigns likelihood zero.
    """


class CorruptFile(ActiveTouchError, ValueError):
    """A file is truncated, is of another kind, or was changed after it was written."""


class CannotWrite(ActiveTouchError, OSError):
    """A file cannot be written: the disk is full, or the folder is read-only or no folder."""


class BrokenContract(ActiveTouchError, AssertionError):
    """An object of a user's own does not keep its protocol; the message states which rule and for which input."""


class UnknownName(ActiveTouchError, KeyError):
    """A name is not in a registry; the message suggests the nearest name and lists all names."""

    def __init__(self, kind: str, name: str, known: list[str]) -> None:
        from difflib import get_close_matches

        nearest = get_close_matches(name, known, n=1)
        hint = f" Did you mean {nearest[0]!r}?" if nearest else ""
        super().__init__(f"unknown {kind} {name!r}.{hint} Known: {', '.join(known)}.")
        self._arguments = (kind, name, known)

    def __reduce__(self) -> tuple[type[UnknownName], tuple[str, str, list[str]]]:
        return UnknownName, self._arguments  # so that it survives the way back from a worker

    def __str__(self) -> str:
        return str(self.args[0])


class ZeroPriorTarget(UserWarning):
    """The target shape has prior probability zero, so no touch can ever find it."""
