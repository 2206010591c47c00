"""Check of recorded touches before searches are played on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from activetouch.errors import BadRecording
from activetouch.recorded.named_columns import suspicious_features
from activetouch.recorded.touches import RecordedTouches

_SESSIONS, _OBJECTS = 4, 3  # of three sessions none is left to calibrate on
_MANY_FEATURES = 500


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
    ('7 touches have exactly the features of an earlier touch; copies leak from training into tests',)
    """
    chosen = touches.for_task(task)
    objects = chosen.objects
    if few_sessions := incomplete(touches, task):
        needed, known = _needed(task), len(np.unique(objects))
        uses = ", to learn from, to calibrate on and to test on" if needed > 1 else ""
        cure = "; without_incomplete or --leave-out-incomplete leaves these out" if len(few_sessions) < known else ""
        raise BadRecording(
            f"{len(few_sessions)} of {known} objects have too few sessions: {_listed(few_sessions)}; {task} need at "
            f"least {needed} of each action{uses}{cure}"
        )
    if task != "objects":
        owners = {label: len(np.unique(objects[chosen.labels == k])) for k, label in enumerate(chosen.label_names)}
        few = {label: count for label, count in owners.items() if count < _OBJECTS}
        if few:
            raise BadRecording(
                f"{task} need at least {_OBJECTS} objects of each, to learn from, to calibrate on and to test on; "
                f"there are {few}"
            )
    remarks = []
    if touches.features.shape[1] > _MANY_FEATURES:
        remarks.append(
            f"a touch has {touches.features.shape[1]} features, and hundreds of classifiers are trained; if that "
            f"takes too long, average neighbouring features, so that there are at most {_MANY_FEATURES}"
        )
    rows = touches.features[chosen.rows]
    copies = len(rows) - len(np.unique(np.column_stack([rows, chosen.actions]), axis=0))
    if copies:
        remarks.append(
            f"{copies} touches have exactly the features of an earlier touch; copies leak from training into tests"
        )
    remarks.extend(suspicious_features(touches))
    constant = int((np.ptp(rows, axis=0) == 0.0).sum())
    if constant:
        remarks.append(f"{constant} of {rows.shape[1]} features are equal in all touches")
    return tuple(remarks)


def incomplete(touches: RecordedTouches, task: str = "objects") -> dict[str, dict[str, int]]:
    """The objects with too few sessions of an action for a task: their number of sessions, by object and action.

    >>> incomplete(RecordedTouches(np.eye(3), [0, 1, 0], [0, 0, 1], [0] * 3, ("press", "rub"), ("mug", "can")))
    {'mug': {'press': 1, 'rub': 1}, 'can': {'press': 1, 'rub': 0}}
    """
    names = touches.object_names if task == "objects" else touches.labels[task]
    counts = np.zeros((len(names), touches.num_actions), np.int64)
    np.add.at(counts, tuple(np.unique([touches.objects, touches.actions, touches.sessions], axis=1)[:2]), 1)
    short = counts < _needed(task)
    return {
        touches.object_names[index]: {
            touches.action_names[i]: int(counts[index, i]) for i in np.flatnonzero(short[index])
        }
        for index in np.unique(touches.objects).tolist()
        if names[index] and short[index].any()
    }


def without_incomplete(touches: RecordedTouches, task: str = "objects") -> tuple[RecordedTouches, tuple[str, ...]]:
    """The touches of the objects that have enough sessions of every action, and what was left out.

    Args:
        touches: the set.
        task: ``objects``, ``categories`` or ``shapes``.

    Raises:
        BadRecording: no object has enough, or the set has no such labels.
    """
    touches.for_task(task)
    out = incomplete(touches, task)
    if not out:
        return touches, ()
    kept = np.flatnonzero(~np.isin(np.array(touches.object_names)[touches.objects], list(out)))
    if not kept.size:
        check_recorded(touches, task)
    rest = replace(
        touches,
        features=touches.features[kept],
        actions=touches.actions[kept],
        objects=touches.objects[kept],
        sessions=touches.sessions[kept],
    )
    return rest, (f"{len(out)} objects are left out as they have too few sessions: {_listed(out)}",)


def _needed(task: str) -> int:
    return _SESSIONS if task == "objects" else 1


def _listed(few: Mapping[str, Mapping[str, int]]) -> str:
    return "; ".join(
        f"{name} ({', '.join(f'{count} of {action}' for action, count in counts.items())})"
        for name, counts in few.items()
    )
