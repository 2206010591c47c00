"""From named columns to recorded touches: what the formats ``csv`` and ``npz`` share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from activetouch.recorded.touches import RecordedTouches
from belief.files import plain_number
from belief.observation_model.kernel_fit import numbered_sessions
from belief.validation import Floats

NAMES = ("object", "action", "session", "category", "shape")
"""Names of the columns that are no features."""
_TASK_OF = {"category": "categories", "shape": "shapes"}
_FEW, _LONGEST = 12, 40  # names, and characters of one, that are said in full
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
        columns: ``object`` and, where given, ``action``, ``session``, ``category`` and ``shape``, each ``(n,)``.
        source: where the table comes from, for messages.
        place: names a row in messages, such as "line 7 of mugs.csv"; by default "row 5 of SOURCE", counted from 0.
        action_names: all actions in their order; by default those of the column, sorted.
        feature_names: F names, where the features have some.
        provenance: where the set comes from; the source by default.
        licence: its licence.

    Raises:
        BadRecording: no feature, an object without a name or with two categories or shapes, or sessions that are not
            integers; the message names the row and the column.

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
    labels = {
        task: _label_of_objects(column, columns[column].astype(str), objects, object_names, place)
        for column, task in _TASK_OF.items()
        if column in columns
    }
    return RecordedTouches(
        features,
        actions,
        objects,
        sessions,
        ordered,
        tuple(map(str, object_names)),
        labels,
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
    return (f"ignored {kind}s: {abbreviated(listed)}",) if listed else ()


def features_read(touches: RecordedTouches) -> str:
    """A sentence about the number and names of the features of a set.

    >>> features_read(RecordedTouches(np.ones((1, 2)), [0], [0], [0], ("press",), ("mug",), feature_names=("f", "g")))
    '2 features: f, g'
    """
    count = f"{touches.features.shape[1]} features"
    return f"{count}: {abbreviated(touches.feature_names)}" if touches.feature_names else f"{count} without names"


def suspicious_features(touches: RecordedTouches) -> tuple[str, ...]:
    """Sentences about features that name the object of a touch, or number its session or row.

    >>> rows = [[0.1, 7.0], [0.3, 7.0], [0.2, 8.0], [0.4, 8.0]]
    >>> mugs = RecordedTouches(rows, [0] * 4, [0, 0, 1, 1], [0, 1] * 2, ("press",), ("mug", "cup"))
    >>> suspicious_features(mugs)  # doctest: +ELLIPSIS
    ('these features name the object: feature 1. They are equal in all touches of an object and differ between...',)
    """
    steps = np.diff(touches.features, axis=0)
    counts = (steps == steps[:1]).all(axis=0) & (steps[:1] != 0.0).any(axis=0) & (touches.num_touches > 2)
    by_object, by_session = (_tells(touches.features, groups) for groups in (touches.objects, touches.sessions))
    same = "are equal in all touches of"
    found = (
        ("name the object", by_object, f"{same} an object and differ between objects"),
        ("number the session", by_session, f"{same} a session and differ between sessions"),
        ("count the rows", counts, "grow by the same in every row"),
    )
    return tuple(
        f"these features {what}: {_named(touches, which)}. They {why}; leave out what was not measured in the touch"
        for what, which, why in found
        if which.any()
    )


def _tells(features: Floats, groups: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each feature is equal within every group and differs between groups of two rows or more on average."""
    order = np.argsort(groups, kind="stable")
    starts = np.flatnonzero(np.diff(groups[order], prepend=groups.min() - 1))
    if 2 * len(starts) > len(groups):
        return np.zeros(features.shape[1], np.bool_)
    low, high = (bound.reduceat(features[order], starts) for bound in (np.minimum, np.maximum))
    return np.asarray((low == high).all(axis=0) & (np.ptp(low, axis=0) > 0.0))


def _named(touches: RecordedTouches, which: NDArray[np.bool_]) -> str:
    """The names of some features."""
    places = np.flatnonzero(which).tolist()
    return abbreviated([touches.feature_names[i] if touches.feature_names else f"feature {i}" for i in places])


def abbreviated(names: Sequence[str]) -> str:
    """Names with commas, the middle ones left out if they are many.

    >>> abbreviated(tuple("abc")), abbreviated([str(i) for i in range(99)])
    ('a, b, c', '0, 1, 2, 3, 4, 5, 6, 7, …, 97, 98')
    """
    shown = [name if len(name) <= _LONGEST else f"{name[:_LONGEST]}…" for name in names]
    return ", ".join(shown if len(shown) <= _FEW else [*shown[: _FEW - 4], "…", *shown[-2:]])


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


def _label_of_objects(
    column: str,
    values: NDArray[np.str_],
    objects: NDArray[np.intp],
    object_names: NDArray[np.str_],
    place: Callable[[int], str],
) -> tuple[str, ...]:
    """The label of each object."""
    _, firsts = np.unique(objects, return_index=True)
    label_of = values[firsts]
    if (others := np.flatnonzero(values != label_of[objects])).size:
        row = int(others[0])
        first = int(firsts[objects[row]])
        raise BadRecording(
            f"{place(row)}: the object {object_names[objects[row]]} has two of {column}: {str(values[row])!r} here and "
            f"{str(values[first])!r} in {place(first)}"
        )
    return tuple(map(str, label_of))
