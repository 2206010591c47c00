"""From named columns to recorded touches: what the formats ``csv`` and ``npz`` share."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from activetouch.recorded.touches import RecordedTouches, scalar_features
from belief.observation_model.kernel_fit import numbered_sessions
from belief.problem import Floats

UNTOUCHED = "untouched:"
"""Begin of the names of columns that were measured where nothing was touched."""
_TASK_OF = {"category": "categories", "shape": "shapes"}


def touches_of_columns(
    features: Floats, untouched: Floats, columns: Mapping[str, NDArray[np.generic]], source: str
) -> RecordedTouches:
    """The touches of a table.

    Args:
        features: ``(n, F)``.
        untouched: features from where nothing was touched, ``(n, C)``; C may be zero.
        columns: ``object`` and, where given, ``action``, ``session``, ``category`` and ``shape``, each ``(n,)``.
        source: where the table comes from, for messages.

    Raises:
        BadRecording: no feature, an object without a name or with two categories or shapes, or sessions that are not
            integers.

    >>> table = touches_of_columns(np.ones((2, 1)), np.empty((2, 0)), {"object": np.array(["mug", "can"])}, "here")
    >>> table.object_names, table.action_names
    (('can', 'mug'), ('touch',))
    """
    n = len(features)
    for name, values in columns.items():
        if values.shape != (n,):
            raise BadRecording(
                f"{name} in {source} must be ({n},) as there are {n} rows of features, got {values.shape}"
            )
    if features.size == 0:
        raise BadRecording(f"{source} has no features: every column besides object, action, session, … is one")
    object_names, objects = np.unique(columns["object"].astype(str), return_inverse=True)
    if "" in object_names:
        raise BadRecording(f"row {int(np.argmax(columns['object'].astype(str) == ''))} of {source} names no object")
    given = columns.get("action")
    action_names, actions = (
        (np.array(["touch"]), np.zeros(n, np.int64))
        if given is None
        else np.unique(given.astype(str), return_inverse=True)
    )
    sessions = numbered_sessions(objects, actions)
    if "session" in columns:
        try:
            sessions = columns["session"].astype(np.float64).astype(np.int64)
        except (ValueError, OverflowError) as error:
            raise BadRecording(
                f"session in {source} must be whole numbers in the order of recording: {error}"
            ) from error
    labels = {}
    for column, task in _TASK_OF.items():
        if column in columns:
            labels[task] = _label_of_objects(column, columns[column].astype(str), objects, object_names, source)
    controls = {"scalar features only": scalar_features(features)}
    if untouched.size:
        controls["features where nothing was touched"] = np.asarray(untouched, np.float64)
    return RecordedTouches(
        features,
        actions,
        objects,
        sessions,
        tuple(map(str, action_names)),
        tuple(map(str, object_names)),
        labels,
        controls,
        source,
    )


def _label_of_objects(
    column: str,
    values: NDArray[np.str_],
    objects: NDArray[np.intp],
    object_names: NDArray[np.str_],
    source: str,
) -> tuple[str, ...]:
    """The label of each object."""
    found = []
    for number, name in enumerate(object_names.tolist()):
        own = np.unique(values[objects == number])
        if len(own) > 1:
            raise BadRecording(f"{source}: the object {name} has two of {column}: {own[0]!r} and {own[1]!r}")
        found.append(str(own[0]))
    return tuple(found)
