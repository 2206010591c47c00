"""Check of recorded touches before searches are played on them."""

from __future__ import annotations

import numpy as np

from activetouch.errors import BadRecording
from activetouch.recorded.named_columns import suspicious_features
from activetouch.recorded.touches import RecordedTouches

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
    for thing in np.unique(objects).tolist():
        for action, action_name in enumerate(touches.action_names):
            count = len(np.unique(chosen.sessions[(objects == thing) & (chosen.actions == action)]))
            needed = _SESSIONS if task == "objects" else 1
            if count < needed:
                raise BadRecording(
                    f"the object {names[thing]} has {count} sessions of the action {action_name}; {task} need at least "
                    f"{needed} of each action"
                    + (", to learn from, to calibrate on and to test on" if needed > 1 else "")
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
    if not any("touched" in name or "contact" in name or "tenth" in name for name in touches.controls):
        remarks.append("there are no features from where nothing was touched, so that this leak control is missing")
    return tuple(remarks)
