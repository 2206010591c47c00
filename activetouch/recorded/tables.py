"""From columns that others made to recorded touches: every check of what the columns hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from activetouch.recorded.touches import RecordedTouches
from belief.files import plain_number
from belief.naming import few
from belief.observation_model.action_kernel import numbered_sessions
from belief.validation import Floats

KINDS_OF = {"categories": "category", "shapes": "shape"}
"""The column of each task besides ``objects``."""
_MOST_SESSION = 2**53  # so that it is exact as a float


def require_folder(folder: Path, what: str) -> None:
    """Refuse what is no folder, and say what it must hold."""
    if not folder.is_dir():
        raise BadRecording(f"there is no folder {folder}; it must hold {what}")


def touches_of_columns(
    features: Floats,
    columns: Mapping[str, NDArray[np.generic]],
    source: str,
    *,
    place: Callable[[int], str] | None = None,
    action_names: Sequence[str] = (),
    factors: Sequence[str] = (),
    feature_names: Sequence[str] = (),
    provenance: str = "",
    licence: str = "not stated",
    controls: Mapping[str, Floats] = MappingProxyType({}),
) -> RecordedTouches:
    """The touches of a table of features ``(n, F)`` and columns ``(n,)``, with all facts of :class:`RecordedTouches`.

    ``place`` names a row in messages, such as "line 7 of mugs.csv". Actions are those of the columns ``factors``, or of
    ``action``, sorted, unless ``action_names`` gives their order. Raises BadRecording, which names the row and the
    column: no feature, an object without a name or with two categories or shapes, or sessions that are not integers.

    >>> table = touches_of_columns(np.ones((2, 1)), {"object": np.array(["mug", "can"])}, "here")
    >>> table.object_names, table.action_names
    (('can', 'mug'), ('touch',))
    """
    n, place = len(features), place or (lambda row: f"row {row} of {source}")
    for name, values in columns.items():
        if values.shape != (n,):
            raise BadRecording(
                f"{name} in {source} must be ({n},) as there are {n} rows of features, got {values.shape}"
            )
    if features.size == 0:
        raise BadRecording(f"{source} has no features: every column besides object, action and session is one")
    object_names, objects = np.unique(columns["object"].astype(str), return_inverse=True)
    if "" in object_names:
        raise BadRecording(f"{place(int(np.argmax(columns['object'].astype(str) == '')))} names no object")
    if lacking := [name for name in factors if name not in columns]:
        raise BadRecording(
            f"--action {lacking[0]}: {source} has no such column; its features are {few(feature_names, 12)}"
        )
    given = columns.get("action", np.full(n, "touch")).astype(str)
    if factors:
        given = np.array(
            [" ".join(cells) for cells in zip(*(columns[name].astype(str) for name in factors), strict=True)]
        )
    ordered = tuple(action_names) or tuple(map(str, np.unique(given)))
    actions = np.array([ordered.index(name) for name in given.tolist()])
    sessions = numbered_sessions(objects, actions)
    if "session" in columns:
        sessions = _sessions(columns["session"], place)
    kinds = {
        task: _kinds(column, columns[column].astype(str), objects, place)
        for task, column in KINDS_OF.items()
        if column in columns
    }
    names = ordered, tuple(map(str, object_names))
    return RecordedTouches(
        features,
        actions,
        objects,
        sessions,
        *names,
        provenance or source,
        licence,
        tuple(feature_names),
        kinds,
        controls,
    )


def _kinds(
    column: str, values: NDArray[np.str_], objects: NDArray[np.intp], place: Callable[[int], str]
) -> tuple[str, ...]:
    """The category or shape of each object."""
    firsts = np.unique(objects, return_index=True)[1]
    if (others := np.flatnonzero(values != values[firsts][objects])).size:
        row, first = int(others[0]), int(firsts[objects[others[0]]])
        raise BadRecording(
            f"{place(row)} names an object with two of {column}: {str(values[row])!r} here and {str(values[first])!r} "
            f"in {place(first)}"
        )
    return tuple(map(str, values[firsts]))


def _sessions(values: NDArray[np.generic], place: Callable[[int], str]) -> NDArray[np.int64]:
    for row, value in enumerate(values.tolist()):
        try:
            number = plain_number(value) if isinstance(value, str) else float(value)
            is_whole = number.is_integer() and abs(number) < _MOST_SESSION
        except (TypeError, ValueError):  # such as dates
            is_whole = False
        if not is_whole:
            raise BadRecording(
                f"{place(row)}: the session is {str(value)[:40]!r}; it must be a whole number, in order of recording"
            )
    return values.astype(np.float64).astype(np.int64)
