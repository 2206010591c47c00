"""The format ``session``: logs of sessions (docs/session_log.md), so that touches of real searches train a reader.

A touch counts if it was not taken back and the true shape of its object was revealed. Its features are the pixels of
its image, or, where a touch has no image, what a reader said of it. Every visit of an object is a session.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from activetouch.recorded.bounded import require_bounded
from activetouch.recorded.named_columns import touches_of_columns
from activetouch.recorded.touches import RecordedTouches
from belief.errors import CorruptFile
from belief.journal import array_from, read_journal

SCHEMA = "activetouch session "
_ENDS = (".json", ".jsonl")


class LoggedTouch(NamedTuple):
    """One touch of a log that was not taken back.

    Attributes:
        object_index: in order of visit.
        label: true shape of the object; None if nobody revealed it.
        pose: label of its pose, or of the nearest one.
        time: when it was told [s since 1970].
        arrays: by name: ``image``, ``logits``, ``features``, as far as it has them.
        line: all that the log says of it.
    """

    object_index: int
    label: str | None
    pose: str
    time: float
    arrays: dict[str, NDArray[Any]]
    line: dict[str, Any]


def logged_touches(path: Path) -> tuple[dict[str, Any], list[LoggedTouch]]:
    """The first line of a session's log, and the touches that were not taken back.

    Raises:
        BadRecording: it is no such log, or is damaged; the message names the line.
    """
    try:
        header, *lines = read_journal(path)
        if not str(header.get("schema")).startswith(SCHEMA):
            raise CorruptFile(f"{path} is no log of a session: its schema is {header.get('schema')!r:.60}")
        truth: list[str | None] = header["arrangement"]
        standing: list[dict[str, Any]] = []
        for line in lines:
            if line["told"] == "truth":
                truth = line["arrangement"]
            elif line["told"] == "undo":
                standing.pop()
            else:
                standing.append(line)
        return header, [
            LoggedTouch(
                line["object"],
                truth[line["object"]],
                line["pose"],
                float(line["time"]),
                {name: array_from(line[name]) for name in ("image", "logits", "features") if name in line},
                line,
            )
            for line in standing
            if line["told"] == "touch"
        ]
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise BadRecording(f"{path} cannot be read as the log of a session: {error}") from error


def read_session_logs(path: Path) -> tuple[RecordedTouches, tuple[str, ...]]:
    """The touches of a log, or of all logs in a folder, and what was left out.

    Raises:
        BadRecording: there is no log, one is damaged, the logs have different poses or features, or no true shape was
            revealed.
    """
    paths = sorted(p for p in path.iterdir() if p.suffix in _ENDS) if path.is_dir() else [path]
    rows, names, actions, sessions, unknown = [], [], [], [], 0
    poses: list[str] | None = None
    for number, log in enumerate(paths):
        header, touches = logged_touches(log)
        if poses not in (None, header["problem"]["poses"]):
            raise BadRecording(f"{log} has the poses {header['problem']['poses']}, the logs before it {poses}")
        poses = header["problem"]["poses"]
        for touch in touches:
            if touch.label is None:
                unknown += 1
                continue
            found = next(iter(touch.arrays[name] for name in ("image", "features", "logits") if name in touch.arrays))
            rows.append(np.asarray(found, np.float64).ravel())
            require_bounded(len(rows), len(rows) * rows[-1].size, str(path))
            if rows[-1].shape != rows[0].shape:
                raise BadRecording(f"a touch in {log} has {rows[-1].size} features, the first one {rows[0].size}")
            names.append(touch.label)
            actions.append(touch.pose)
            sessions.append(number * header["problem"]["num_objects"] + touch.object_index)
    if poses is None or not rows:
        why = f"the true shapes of {unknown} touches were not revealed: session.reveal(…), or the request reveal, does"
        raise BadRecording(f"{path} holds no recordings: {why if unknown else 'there are no touches in logs'}")
    columns = {"object": np.array(names), "action": np.array(actions), "session": np.array(sessions)}
    recorded = touches_of_columns(np.stack(rows), columns, str(path), action_names=poses)
    left_out = (f"{unknown} touches are left out: nobody revealed what was touched",) if unknown else ()
    return recorded, left_out
