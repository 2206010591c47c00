"""Valid ranges of command-line arguments, declared in annotations such as ``jobs: Jobs``.

Every command calls :func:`check_arguments` before it starts work.

A command runs ``module:attribute`` of a file only if its own command line names or allows it (:class:`Trust`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar, get_type_hints

import tyro

from belief.constraints import Constraint, Ending, Within
from belief.errors import ActiveTouchError


class BadArgument(ActiveTouchError, ValueError):
    """An argument of a command is invalid; the message names the flag and the value."""


T = TypeVar("T")
InFile = Annotated[T, tyro.conf.Fixed, tyro.conf.Suppress]
"""Type of an argument that Python and ``run.json`` can set, and the command line cannot."""
Count: TypeAlias = Annotated[int, Within(1, 10**8)]
"""Positive number of things."""
CountOrNone: TypeAlias = Annotated[int, Within(0, 10**8)]
"""Number of things, possibly zero."""
Jobs: TypeAlias = Annotated[int, Within(1, 4096)]
"""Number of processes or threads."""
Seed: TypeAlias = Annotated[int, Within(0, 2**32 - 1)]
"""Random seed, 32 bits."""
Pixels: TypeAlias = Annotated[int, Within(1, 4096)]
"""Edge length of an image [pixels]."""
Picture: TypeAlias = Annotated[Path, Ending((".png", ".svg", ".pdf", ".jpg"))]
"""File name of a figure."""


@dataclass(frozen=True)
class Cluster:
    """Work on the workers of a Dask cluster."""

    cluster: str | None = None
    """Address of a Dask scheduler, as tcp://HOST:PORT, whose workers work in place of --jobs; or local:8, a cluster of
    8 processes."""
    dashboard: bool = False
    """Print the address of the cluster's dashboard, a page on the progress of each task."""


OnCluster: TypeAlias = tyro.conf.OmitArgPrefixes[Cluster]
"""Options of a command whose tasks can go to a cluster (:mod:`experiments.parallel.cluster`)."""


def check_arguments(command: Any, prefix: str = "--") -> None:
    """Check all arguments of a command, nested groups included, against their annotations; raises BadArgument."""
    for flag, value, kind in arguments(command, prefix):
        Constraint.of(kind).require(flag, value, BadArgument)


def arguments(command: Any, prefix: str = "--") -> Iterator[tuple[str, Any, Any]]:
    """Yield flag, value and annotation of every argument of a command, nested groups included."""
    annotations = get_type_hints(type(command), include_extras=True)
    for field in fields(command):
        value, kind = getattr(command, field.name), annotations[field.name]
        flag = prefix + field.name.replace("_", "-")
        if is_dataclass(value):
            metadata = getattr(kind, "__metadata__", ())
            unnamed = any(one is tyro.conf.OmitArgPrefixes or getattr(one, "name", None) == "" for one in metadata)
            yield from arguments(value, prefix if unnamed else f"{flag}.")
        else:
            yield flag, value, kind


def one_of(names: Iterable[str]) -> tyro.constructors.PrimitiveConstructorSpec[str | None]:
    """How an argument with the default None is read that takes one of some names; None is not offered as one."""
    known = tuple(names)
    metavar = f"{{{','.join(known)}}}"
    return tyro.constructors.PrimitiveConstructorSpec(
        1, metavar, lambda words: words[0], lambda value: value in (None, *known), lambda value: [str(value)], known
    )


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
