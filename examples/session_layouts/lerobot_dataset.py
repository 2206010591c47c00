"""LeRobot datasets, version 3.0: one episode for each session, one frame for each touch, taxels as an array feature.

Frames are numbered, one nominal second apart, as LeRobot's tools take them by frame rate. When each touch was made is
the feature ``observation.time``, in double precision. Names of poses and the layout of the taxels lie beside LeRobot's
own files, in ``meta/activetouch.json``.

Run: python examples/session_layouts/lerobot_dataset.py FOLDER LOG [LOG ...]   (needs the extra formats)
"""

from __future__ import annotations

from activetouch.extras import script_needs

script_needs("formats")

import json
import sys
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray
from session_touches import SessionTouches, TaxelLayout

from activetouch.errors import BadRecording
from activetouch.recorded.formats import require_folder
from belief.columns import MOST_BYTES, MOST_ROWS
from belief.errors import CannotWrite
from belief.files import atomic_path, require_regular_file, write_text

TAXELS = "observation.taxels"
"""Name of the feature of images."""
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_DATA, _EPISODES, _TASKS = f"data/{_FILE}", f"meta/episodes/{_FILE}", "meta/tasks.parquet"
_INFO, _STATS, _OWN = "meta/info.json", "meta/stats.json", "meta/activetouch.json"
_OTHERS = {
    "observation.time": "times",
    "observation.force": "forces",
    "observation.object": "objects",
    "action": "poses",
    "shape": "shapes",
}
"""Features by attribute of :class:`SessionTouches`."""


def write_lerobot(folder: str | Path, touches: SessionTouches) -> None:
    """Write touches as a LeRobot dataset.

    Args:
        folder: of the dataset; must hold none.
        touches: the touches; the action of a frame is the index of its pose.

    Raises:
        CannotWrite: the folder holds a dataset, or cannot be written.
    """
    folder, n, sessions = Path(folder), len(touches), touches.sessions
    if (folder / _INFO).exists():
        raise CannotWrite(f"{folder} already holds a dataset; name another folder")
    first = np.searchsorted(sessions, np.arange(sessions[-1] + 2))
    frames = np.arange(n) - first[sessions]
    words = [f"find {target}" for target in touches.targets]
    tasks = sorted(set(words))
    task = np.array([tasks.index(word) for word in words])[sessions]
    columns: dict[str, NDArray[Any]] = {TAXELS: touches.images}
    columns |= {name: np.asarray(getattr(touches, attribute)) for name, attribute in _OTHERS.items()}
    columns |= {"timestamp": frames.astype(np.float32), "frame_index": frames, "episode_index": sessions}
    columns |= {"index": np.arange(n), "task_index": task}
    _write_table(folder / _DATA.format(chunk_index=0, file_index=0), columns)
    numbers = {name: rows for name, rows in columns.items() if rows.dtype.kind != "U"}
    episodes: dict[str, Any] = {
        "episode_index": np.arange(len(words)),
        "tasks": [[word] for word in words],
        "length": np.diff(first),
        "dataset_from_index": first[:-1],
        "dataset_to_index": first[1:],
    }
    for part in ("data", "meta/episodes"):
        episodes |= {f"{part}/{kind}_index": np.zeros(len(words), np.int64) for kind in ("chunk", "file")}
    for name, rows in numbers.items():
        stats = [_stats(rows[start:end]) for start, end in pairwise(first)]
        episodes |= {f"stats/{name}/{kind}": [one[kind] for one in stats] for kind in stats[0]}
    _write_table(folder / _EPISODES.format(chunk_index=0, file_index=0), episodes)
    kinds = {"task": ("unicode", "object"), "task_index": ("int64", "int64")}
    index = {  # for pandas, with which LeRobot reads the names of tasks as an index
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
            for name, (kind, numpy) in kinds.items()
        ],
        "pandas_version": "2.2.0",
    }
    _write_table(folder / _TASKS, {"task": tasks, "task_index": np.arange(len(tasks))}, {"pandas": json.dumps(index)})
    layout = touches.layout
    own = {
        "pose_labels": list(touches.pose_labels),
        "targets": list(touches.targets),
        "positions": None if layout is None else layout.positions.tolist(),
        "newtons_per_unit": None if layout is None else layout.newtons_per_unit,
    }
    write_text(folder / _OWN, json.dumps(own))
    write_text(folder / _STATS, json.dumps({name: _stats(rows) for name, rows in numbers.items()}))
    write_text(folder / _INFO, json.dumps(_info(columns, len(words), len(tasks)), indent=4))


def read_lerobot(folder: str | Path, taxels: str = TAXELS) -> SessionTouches:
    """The touches of a LeRobot dataset, version 3.0.

    Args:
        folder: of the dataset.
        taxels: name of the array feature of images. What a dataset of somebody else does not have is left at its
            default; its times are its time stamps, and its action is not read.

    Raises:
        BadRecording: it is no such dataset, is damaged, or too large.
    """
    folder = Path(folder)
    require_folder(folder, "a LeRobot dataset")
    try:
        info = json.loads(_text(folder / _INFO))
        if not str(info["codebase_version"]).startswith("v3."):
            raise ValueError(f"it is of version {info['codebase_version']}, not 3.0")
        own = json.loads(_text(folder / _OWN)) if (folder / _OWN).exists() else {}
        shape = tuple(info["features"][taxels]["shape"])
        paths = sorted((folder / "data").glob("*/*.parquet"))
        files = [pq.read_metadata(path) for path in paths]
        groups = [file.row_group(i) for file in files for i in range(file.num_row_groups)]
        values = sum(group.column(i).num_values for group in groups for i in range(group.num_columns))
        size = sum(group.total_byte_size for group in groups)
        if sum(group.num_rows for group in groups) > MOST_ROWS or max(values, size) > MOST_BYTES:
            raise ValueError(f"it has more than {MOST_ROWS} touches or {MOST_BYTES} values")
        names = [taxels, "timestamp", "episode_index", *(_OTHERS if own else ())]
        table = pq.read_table(paths, columns=names, partitioning=None).combine_chunks()
        columns = {name: _array(table[name], shape if name == taxels else ()) for name in names}
        layout = None
        if own.get("positions"):
            layout = TaxelLayout(np.array(own["positions"]), float(own["newtons_per_unit"]))
        _, sessions = np.unique(columns["episode_index"], return_inverse=True)
        others: dict[str, Any] = {attribute: columns[name] for name, attribute in _OTHERS.items() if own}
        others.setdefault("times", columns["timestamp"].astype(np.float64))
        others.setdefault("poses", np.zeros(len(sessions), np.int64))
        others["shapes"] = tuple(others.get("shapes", np.empty(0, str)).tolist())
        labels, targets = own.get("pose_labels", ("touch",)), tuple(own.get("targets", ()))
        return SessionTouches(
            columns[taxels], pose_labels=labels, sessions=sessions, targets=targets, layout=layout, **others
        )
    except BadRecording:
        raise
    except Exception as error:  # readers of parquet raise a dozen kinds on damaged bytes
        raise BadRecording(
            f"{folder} cannot be read as a LeRobot dataset with the feature {taxels}: {error}"
        ) from error


def _text(path: Path) -> str:
    require_regular_file(path)
    if path.stat().st_size > MOST_BYTES:
        raise ValueError(f"{path} has more than {MOST_BYTES} bytes")
    return path.read_text(encoding="utf-8")


def _write_table(path: Path, columns: Mapping[str, Any], metadata: dict[str, str] | None = None) -> None:
    """Write columns as parquet; arrays of several dimensions become lists of lists."""
    table = pa.table({name: _column(rows) for name, rows in columns.items()}, metadata=metadata)
    with atomic_path(path) as temporary:
        pq.write_table(table, temporary, compression="snappy")


def _column(rows: Any) -> Any:
    if not (isinstance(rows, np.ndarray) and rows.ndim > 1):
        return pa.array(rows)
    column = pa.array(np.ascontiguousarray(rows).ravel())
    for size in rows.shape[:0:-1]:
        column = pa.ListArray.from_arrays(np.arange(0, len(column) + 1, size, dtype=np.int32), column)
    return column


def _array(column: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    """A column of scalars, or of nested lists of a shape, as an array."""
    array = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    array = getattr(array, "storage", array)
    for size in shape:
        if pc.unique(pc.list_value_length(array)).to_pylist() != [size]:
            raise ValueError(f"an image is not {shape}")
        array = array.flatten()
    if array.null_count:
        raise ValueError("a value is missing")
    found = array.to_numpy(zero_copy_only=False)
    return found.astype(str) if found.dtype.kind == "O" else found.reshape(len(column), *shape)


def _stats(rows: NDArray[Any]) -> dict[str, Any]:
    """Least, largest, mean and spread of each number over the frames in which it is finite, as LeRobot writes them."""
    values = rows.astype(np.float64).reshape(len(rows), *(rows.shape[1:] or (1,)))
    values = values[np.isfinite(values).reshape(len(rows), -1).all(axis=1)]
    count = len(values)
    values = values if count else np.zeros((1, *values.shape[1:]))
    found = {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "std": values.std(axis=0),
    }
    return {**{kind: array.tolist() for kind, array in found.items()}, "count": [count]}


def _info(columns: Mapping[str, NDArray[Any]], num_episodes: int, num_tasks: int) -> dict[str, Any]:
    def feature(rows: NDArray[Any]) -> dict[str, Any]:
        dtype = "string" if rows.dtype.kind == "U" else rows.dtype.name
        return {"dtype": dtype, "shape": list(rows.shape[1:]) or [1], "names": None}

    return {
        "codebase_version": "v3.0",
        "robot_type": None,
        "total_episodes": num_episodes,
        "total_frames": len(columns["index"]),
        "total_tasks": num_tasks,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": 1,
        "splits": {"train": f"0:{num_episodes}"},
        "data_path": _DATA,
        "video_path": None,
        "features": {name: feature(rows) for name, rows in columns.items()},
    }


if __name__ == "__main__":
    write_lerobot(sys.argv[1], SessionTouches.of_logs(sys.argv[2:]))
    print(f"wrote {sys.argv[1]}")
