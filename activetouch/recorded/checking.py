"""Check of recorded touches before searches are played on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from activetouch.recorded.named_columns import abbreviated
from activetouch.recorded.touches import RecordedTouches
from belief.problem import Floats

_SESSIONS, _OBJECTS = 4, 3  # of three sessions none is left to calibrate on


def check_recorded(touches: RecordedTouches, task: str = "objects") -> tuple[str, ...]:
    """Check that a set can be split, read and searched in, and return remarks about what weakens its results.

    Args:
        touches: the set.
        task: ``objects``, ``categories`` or ``shapes``.

    Raises:
        BadRecording: the task has too few labels, objects or touches; the message says which and what is needed.

    >>> rows = np.arange(12.0).reshape(12, 1) % 5
    >>> mugs = RecordedTouches(rows, [0] * 12, [0, 1] * 6, np.arange(12) // 2, ("press",), ("mug", "ball"))
    >>> check_recorded(mugs)  # doctest: +ELLIPSIS
    ('7 touches have exactly the features of an earlier touch; copies leak from training into tests', 'there are no...')
    """
    chosen = touches.for_task(task)
    objects, names = chosen.objects, touches.object_names
    sessions = np.unique(np.stack([objects, chosen.actions, chosen.sessions]), axis=1)
    counts = np.zeros((len(names), touches.num_actions), np.int64)
    np.add.at(counts, (sessions[0], sessions[1]), 1)
    needed = _SESSIONS if task == "objects" else 1
    few = np.argwhere(counts < needed)
    if (few := few[np.isin(few[:, 0], objects)]).size:
        thing, action = few[0].tolist()
        raise BadRecording(
            f"the object {names[thing]} has {counts[thing, action]} sessions of the action "
            f"{touches.action_names[action]}; {task} need at least {needed} of each action"
            + (", to learn from, to calibrate on and to test on" if needed > 1 else "")
        )
    if task != "objects":
        owners = {label: len(np.unique(objects[chosen.labels == k])) for k, label in enumerate(chosen.label_names)}
        if rare := {label: count for label, count in owners.items() if count < _OBJECTS}:
            raise BadRecording(
                f"{task} need at least {_OBJECTS} objects of each, to learn from, to calibrate on and to test on; "
                f"there are {rare}"
            )
    remarks = [*suspicious_features(touches)]
    rows = touches.features[chosen.rows]
    copies = len(rows) - len(np.unique(np.column_stack([rows, chosen.actions]), axis=0))
    if copies:
        remarks.append(
            f"{copies} touches have exactly the features of an earlier touch; copies leak from training into tests"
        )
    constant = int((np.ptp(rows, axis=0) == 0.0).sum())
    if constant:
        remarks.append(f"{constant} of {rows.shape[1]} features are equal in all touches")
    if not any("touched" in name or "contact" in name or "tenth" in name for name in touches.controls):
        remarks.append("there are no features from where nothing was touched, so that this leak control is missing")
    return tuple(remarks)


def features_read(touches: RecordedTouches) -> str:
    """A sentence about the number of features of a set, and their names.

    >>> features_read(RecordedTouches(np.ones((1, 2)), [0], [0], [0], ("press",), ("mug",), feature_names=("f", "g")))
    '2 features: f, g'
    """
    number, names = touches.features.shape[1], touches.feature_names
    return f"{number} features: {abbreviated(names)}" if names else f"{number} features without names"


def suspicious_features(touches: RecordedTouches) -> tuple[str, ...]:
    """Sentences about features that do not depend on the touch: they name its object, or number its session or row.

    >>> rows = [[0.1, 7.0], [0.3, 7.0], [0.2, 8.0], [0.4, 8.0]]
    >>> mugs = RecordedTouches(rows, [0] * 4, [0, 0, 1, 1], [0, 1] * 2, ("press",), ("mug", "cup"))
    >>> suspicious_features(mugs)  # doctest: +ELLIPSIS
    ('1 of 2 features name the object (equal in all touches of an object, different between objects): feature 1; ...',)
    """
    steps = np.diff(touches.features, axis=0)
    counts_rows = (steps == steps[:1]).all(axis=0) & (steps[:1] != 0.0).any(axis=0) & (touches.num_touches > 2)
    found = {
        "name the object (equal in all touches of an object, different between objects)": _tells(
            touches.features, touches.objects
        ),
        "number the session (equal in all touches of a session, different between sessions)": _tells(
            touches.features, touches.sessions
        ),
        "count the rows": counts_rows,
    }
    return tuple(
        f"{which.sum()} of {len(which)} features {what}: {abbreviated(_names(touches, which))}; leave out what was not "
        "measured in the touch"
        for what, which in found.items()
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


def _names(touches: RecordedTouches, which: NDArray[np.bool_]) -> list[str]:
    """The names of some features."""
    places = np.flatnonzero(which).tolist()
    return [touches.feature_names[place] if touches.feature_names else f"feature {place}" for place in places]
