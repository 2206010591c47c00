"""The format ``session``: logs of sessions (docs/session_log.md), so that touches of real searches train a reader.

A touch counts if it was not taken back and the true shape of its object was revealed. Its features are the pixels of
its image, or, where a touch has no image, what a reader said of it. Every visit of an object is a session.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from activetouch.errors import BadRecording
from activetouch.recorded.tables import touches_of_columns
from activetouch.recorded.touches import RecordedTouches
from belief.columns import require_bounded
from belief.errors import CorruptFile
from belief.journal import array_from, read_journal

SCHEMA = "activetouch session "


def read_session_logs(path: Path) -> tuple[RecordedTouches, tuple[str, ...]]:
    """The touches of a log, or of all logs in a folder, and what was left out."""
    paths = sorted(p for p in path.iterdir() if p.suffix in (".json", ".jsonl")) if path.is_dir() else [path]
    rows, names, actions, sessions, unknown = [], [], [], [], 0
    poses: list[str] | None = None
    for number, log in enumerate(paths):
        try:
            header, truth, touches = standing_touches(log)
            problem = header["problem"]
            if poses not in (None, problem["poses"]):
                raise BadRecording(f"{log} has the poses {problem['poses']}, the logs before it {poses}")
            poses = problem["poses"]
            for touch in touches:
                label = dict(enumerate(truth))[touch["object"]]  # which has no number -1
                if label is None:
                    unknown += 1
                    continue
                found = next(array_from(touch[name]) for name in ("image", "features", "logits") if name in touch)
                rows.append(np.asarray(found, np.float64).ravel())
                require_bounded(len(rows), len(rows) * rows[-1].size, str(path), BadRecording)
                if rows[-1].shape != rows[0].shape:
                    raise BadRecording(f"a touch in {log} has {rows[-1].size} features, the first one {rows[0].size}")
                names.append(label)
                actions.append(touch["pose"])
                sessions.append(number * problem["num_objects"] + touch["object"])
        except BadRecording:
            raise
        except (LookupError, TypeError, ValueError, AttributeError, StopIteration) as error:
            raise BadRecording(f"{log} cannot be read as the log of a session: {error}") from error
    if poses is None or not rows:
        why = f"the true shapes of {unknown} touches were not revealed: session.reveal(…), or the request reveal, does"
        raise BadRecording(f"{path} holds no recordings: {why if unknown else 'there are no touches in logs'}")
    columns = {"object": np.array(names), "action": np.array(actions), "session": np.array(sessions)}
    recorded = touches_of_columns(np.stack(rows), columns, str(path), action_names=poses)
    left_out = (f"{unknown} touches are left out: nobody revealed what was touched",) if unknown else ()
    return recorded, left_out


def standing_touches(path: Path) -> tuple[dict[str, Any], list[str | None], list[dict[str, Any]]]:
    """The first line of a log, the true shapes as far as they are revealed, and touches that were not taken back."""
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
    return header, truth, [line for line in standing if line["told"] == "touch"]
