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
    """The command that installs an extra: of the clone that this code is in, or whatever it was installed from.

    >>> install_command("train").endswith("[train]'")
    True
    """
    (source, commit), here = code_source(), Path()
    if isinstance(source, Path):
        return f"pip install '{'.' if source.is_dir() and source.samefile(here) else source}[{extra}]'"
    return f"pip install 'activetouch[{extra}]{f' @ {source}' if source else ''}{f'@{commit}' if commit else ''}'"


def code_source() -> tuple[Path | str, str]:
    """The clone of this code, or the folder, file or address from which pip installed it, and its commit.

    Each is empty where it is not known, as after an installation from an index.
    """
    clone = Path(__file__).parents[1]
    if (clone / "pyproject.toml").is_file():
        return clone, ""
    import importlib.metadata
    import json
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    try:
        origin = json.loads(importlib.metadata.distribution("activetouch").read_text("direct_url.json") or "{}")
        url, repository = origin.get("url", ""), origin.get("vcs_info")
        if repository:
            return f"{repository['vcs']}+{url}", repository["commit_id"]
        if not url.startswith("file:"):
            return url, ""
        place = Path(url2pathname(urlsplit(url).path))
        return ("" if origin.get("dir_info", {}).get("editable") or not place.exists() else place), ""
    except (importlib.metadata.PackageNotFoundError, ValueError, LookupError, AttributeError, TypeError):
        return "", ""


def did_you_mean(name: str, known: list[str], least: float = 0.6) -> str:
    """A question that suggests the nearest name, of at least this similarity in [0, 1]; empty if there is none.

    >>> did_you_mean("sesion", ["object", "session"])
    " Did you mean 'session'?"
    """
    from difflib import get_close_matches

    nearest = get_close_matches(name, known, n=1, cutoff=least)
    return f" Did you mean {nearest[0]!r}?" if nearest else ""


class CodeFailed(ActiveTouchError, RuntimeError):
    """Code of a user, such as a decider, raised an exception; the message names the line."""


class BrokenContract(ActiveTouchError, AssertionError):
    """A user's object violates its protocol; the message states the rule and the input."""


class UnknownName(ActiveTouchError, KeyError):
    """A name is not in a registry; the message suggests the nearest name and lists all names."""

    def __init__(self, kind: str, name: str, known: list[str]) -> None:
        super().__init__(f"unknown {kind} {name!r}.{did_you_mean(name, known)} Known: {', '.join(known)}.")
        self._arguments = (kind, name, known)

    def __reduce__(self) -> tuple[type[UnknownName], tuple[str, str, list[str]]]:
        return UnknownName, self._arguments  # so that it can be pickled

    def __str__(self) -> str:
        return str(self.args[0])


class ZeroPriorTarget(UserWarning):
    """The target shape has prior probability zero, so no touch can find it."""


class OverconfidentStops(UserWarning):
    """An observation model states more at the stops of held-out objects than is right; the message says what to do."""
