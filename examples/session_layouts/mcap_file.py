"""MCAP files: a message in JSON for each touch, and one for the layout of the taxels.

On ``/layout`` are positions of the taxels in metres, on ``/touch`` the touches, with ``newtons`` on each taxel where
there is a layout. The image lies beside them as bytes, so that reading it back is exact.

Run: python examples/session_layouts/mcap_file.py FILE.mcap LOG [LOG ...]   (needs the extra formats)
"""

from __future__ import annotations

from activetouch.extras import script_needs

script_needs("formats")

import json
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import SeekingReader
from mcap.writer import Writer
from session_touches import SessionTouches, TaxelLayout

from activetouch.errors import BadRecording
from belief.columns import MOST_BYTES, MOST_ROWS
from belief.files import atomic_path, require_regular_file
from belief.journal import array_field, array_from

_SCHEMAS: dict[str, dict[str, Any]] = {
    "/layout": {"positions": "array", "newtons_per_unit": "number"},
    "/touch": {
        "time": "number",
        "session": "integer",
        "target": "string",
        "object": "integer",
        "shape": "string",
        "pose": "string",
        "force": ["number", "null"],
        "newtons": ["array", "null"],
        "image": "object",
    },
}
"""Types of the fields of each message."""


def write_mcap(path: str | Path, touches: SessionTouches) -> None:
    """Write touches as an MCAP file.

    Args:
        path: of the file, which is replaced.
        touches: the touches; with a layout, the taxels are in newtons, too.

    Raises:
        CannotWrite: the file cannot be written.
    """
    newtons, layout = touches.newtons, touches.layout
    with atomic_path(Path(path)) as temporary, temporary.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata("activetouch", {"pose_labels": json.dumps(touches.pose_labels)})
        channels = {}
        for topic, types in _SCHEMAS.items():
            properties = {name: {"type": kind} for name, kind in types.items()}
            schema = json.dumps({"type": "object", "properties": properties}).encode()
            number = writer.register_schema(f"activetouch.{topic[1:].title()}", "jsonschema", schema)
            channels[topic] = writer.register_channel(topic, "json", number)

        def add(topic: str, time: float, message: dict[str, Any], sequence: int = 0) -> None:
            log_time = round(Fraction(time) * 10**9)
            writer.add_message(channels[topic], log_time, json.dumps(message).encode(), log_time, sequence)

        if layout is not None:
            message = {"positions": layout.positions.tolist(), "newtons_per_unit": layout.newtons_per_unit}
            add("/layout", float(touches.times[0]), message)
        for i, image in enumerate(touches.images):
            message = {
                "time": float(touches.times[i]),
                "session": int(touches.sessions[i]),
                "target": touches.targets[touches.sessions[i]],
                "object": int(touches.objects[i]),
                "shape": touches.shapes[i],
                "pose": touches.pose_labels[touches.poses[i]],
                "force": None if np.isnan(touches.forces[i]) else float(touches.forces[i]),
                "newtons": None if newtons is None else newtons[i].tolist(),
                "image": array_field(image),
            }
            add("/touch", float(touches.times[i]), message, i)
        writer.finish()


def read_mcap(path: str | Path) -> SessionTouches:
    """The touches of an MCAP file that :func:`write_mcap`, or another program in the same schemas, wrote.

    Of a message, ``newtons`` are enough. What else is missing is left at its default: the image is then the row of
    newtons, the time that of the message.

    Raises:
        BadRecording: it is no such file, is damaged, or too large.
    """
    path = Path(path)
    require_regular_file(path, BadRecording)
    try:
        with path.open("rb") as file:
            reader = SeekingReader(file, validate_crcs=True, record_size_limit=MOST_BYTES)
            summary = reader.get_summary()
            size = sum(chunk.uncompressed_size for chunk in summary.chunk_indexes) if summary else 0
            if max(size, path.stat().st_size) > MOST_BYTES:
                raise ValueError(f"it holds more than {MOST_BYTES} bytes")
            own = next((data.metadata for data in reader.iter_metadata() if data.name == "activetouch"), {})
            layout, rows = None, []
            for _, channel, message in reader.iter_messages(["/layout", "/touch"], log_time_order=False):
                fields = json.loads(message.data)
                if channel.topic == "/layout":
                    layout = TaxelLayout(np.array(fields["positions"]), float(fields["newtons_per_unit"]))
                else:
                    rows.append({"time": float(Fraction(message.log_time, 10**9)), **fields})
                if len(rows) > MOST_ROWS:
                    raise ValueError(f"it holds more than {MOST_ROWS} touches")
        if not rows:
            raise ValueError("it has no message on /touch")
        return _touches(rows, json.loads(own.get("pose_labels", "[]")), layout)
    except BadRecording:
        raise
    except Exception as error:  # readers of MCAP and of what it compresses raise a dozen kinds on damaged bytes
        raise BadRecording(f"{path} cannot be read as MCAP of touches: {error!r}") from error


def _touches(rows: list[dict[str, Any]], pose_labels: list[str], layout: TaxelLayout | None) -> SessionTouches:
    poses = [row.get("pose", "touch") for row in rows]
    labels = pose_labels or sorted(set(poses))
    sessions = [row.get("session", 0) for row in rows]
    targets = {session: row.get("target", "an object") for session, row in zip(sessions, rows, strict=True)}
    is_exact = "image" in rows[0]
    images = np.stack([array_from(row["image"]) if is_exact else np.array(row["newtons"], np.float64) for row in rows])
    return SessionTouches(
        images,
        np.array([row["time"] for row in rows]),
        np.array([labels.index(pose) for pose in poses]),
        tuple(labels),
        sessions=np.array(sessions),
        objects=np.array([row.get("object", 0) for row in rows]),
        targets=tuple(targets[session] for session in sorted(targets)),
        shapes=tuple(row.get("shape", "") for row in rows),
        forces=np.array([np.nan if row.get("force") is None else row["force"] for row in rows]),
        layout=layout if is_exact or layout is None else TaxelLayout(layout.positions, 1.0),
    )


if __name__ == "__main__":
    write_mcap(sys.argv[1], SessionTouches.of_logs(sys.argv[2:]))
    print(f"wrote {sys.argv[1]}")
