"""From named columns to recorded touches: what the formats ``csv`` and ``npz`` share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from activetouch.recorded.touches import RecordedTouches
from belief.files import plain_number
from belief.naming import few
from belief.observation_model.kernel_fit import numbered_sessions
from belief.validation import Floats

NAMES = ("object", "action", "session")
"""Names of the columns that are no features."""
_MOST = 2**53  # session number, so that it is exact as a float


def touches_of_columns(
    features: Floats,
    columns: Mapping[str, NDArray[np.generic]],
    source: str,
    *,
    place: Callable[[int], str] | None = None,
    action_names: Sequence[str] = (),
    feature_names: Sequence[str] = (),
    provenance: str = "",
    licence: str = "not stated",
) -> RecordedTouches:
    """The touches of a table.

    Args:
        features: ``(n, F)``.
        columns: ``object`` and, where given, ``action`` and ``session``, each ``(n,)``.
        source: where the table comes from, for messages.
        place: names a row in messages, such as "line 7 of mugs.csv"; by default "row 5 of SOURCE", counted from 0.
        action_names: all actions in their order; by default those of the column, sorted.
        feature_names: F names, where the features have some.
        provenance: where the set comes from; the source by default.
        licence: its licence.

    Raises:
        BadRecording: no feature, an object without a name, or sessions that are not integers; the message names the row
            and the column.

    >>> table = touches_of_columns(np.ones((2, 1)), {"object": np.array(["mug", "can"])}, "here")
    >>> table.object_names, table.action_names
    (('can', 'mug'), ('touch',))
    """
    n = len(features)
    place = place or (lambda row: f"row {row} of {source}")
    for name, values in columns.items():
        if values.shape != (n,):
            raise BadRecording(
                f"{name} in {source} must be ({n},) as there are {n} rows of features, got {values.shape}"
            )
    if features.size == 0:
        raise BadRecording(f"{source} has no features: every column besides object, action, session, … is one")
    object_names, objects = np.unique(columns["object"].astype(str), return_inverse=True)
    if "" in object_names:
        raise BadRecording(f"{place(int(np.argmax(columns['object'].astype(str) == '')))} names no object")
    given = columns.get("action", np.full(n, "touch")).astype(str)
    ordered = tuple(action_names) or tuple(map(str, np.unique(given)))
    actions = np.array([ordered.index(name) for name in given.tolist()])
    sessions = numbered_sessions(objects, actions)
    if "session" in columns:
        sessions = _whole_numbers("session", columns["session"], place)
    return RecordedTouches(
        features,
        actions,
        objects,
        sessions,
        ordered,
        tuple(map(str, object_names)),
        provenance or source,
        licence,
        tuple(feature_names),
    )


def ignored(kind: str, names: Iterable[str]) -> tuple[str, ...]:
    """A sentence about what is not read, such as arrays; none where there is nothing.

    >>> ignored("array", ["categories"])
    ("ignored arrays: 'categories'",)
    """
    listed = [repr(name) for name in names]
    return (f"ignored {kind}s: {few(listed, 12)}",) if listed else ()


def features_read(touches: RecordedTouches) -> str:
    """A sentence about the number and names of the features of a set.

    >>> features_read(RecordedTouches(np.ones((1, 2)), [0], [0], [0], ("press",), ("mug",), feature_names=("f", "g")))
    '2 features: f, g'
    """
    count = f"{touches.features.shape[1]} features"
    return f"{count}: {few(touches.feature_names, 12)}" if touches.feature_names else f"{count} without names"


def _whole_numbers(name: str, values: NDArray[np.generic], place: Callable[[int], str]) -> NDArray[np.int64]:
    """A column as integers."""
    for row, value in enumerate(values.tolist()):
        try:
            number = plain_number(value) if isinstance(value, str) else float(value)
            is_whole = number.is_integer() and abs(number) < _MOST
        except (TypeError, ValueError):  # such as dates
            is_whole = False
        if not is_whole:
            raise BadRecording(
                f"{place(row)}: the {name} is {str(value)[:40]!r}; it must be a whole number, in the order of recording"
            )
    return values.astype(np.float64).astype(np.int64)
