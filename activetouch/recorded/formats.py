"""The formats of recorded touches, each a function that reads a folder. To add one, write it and add a line at the end.

* ``csv``: one row for each touch, in all ``.csv`` and ``.csv.gz`` files of a folder. The first line names the columns.
  ``object`` is needed; ``action`` (by default all touches have one action), ``session`` (order of recording among the
  touches of an object and action), ``category`` and ``shape`` are optional. Columns whose names begin with
  ``untouched:`` were measured where nothing was touched, and are a control; all others are features.
* ``npz``: arrays in one ``.npz`` file, which is read without running anything: ``features (n, F)``, or pictures
  ``(n, H, W)`` or ``(n, H, W, C)``, and ``object (n,)``, and optionally ``action``, ``session``, ``category`` and
  ``shape``, each ``(n,)``, ``untouched`` as ``features``, and ``feature_names (F,)``, ``provenance`` and ``licence``.
* ``bts3``: grasps of objects in three hand poses with three BioTac SP fingers of 24 electrodes, from the BioTac SP
  Stability Set v2 (MIT): ``bts3v2_palm_POSE.csv``, also compressed, with the columns ``object,slipped,ff_biotac_1,…``.
  Whether the object slipped is known only after the touch, and is no feature.
* ``session``: :mod:`activetouch.recorded.session_log`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from activetouch.recorded.session_log import read_session_logs
from activetouch.recorded.tables import KINDS_OF, require_folder, touches_of_columns
from activetouch.recorded.touches import RecordedTouches
from belief.columns import read_columns
from belief.naming import few
from belief.validation import Floats

_NAMES = ("object", "action", "session", *KINDS_OF.values())  # columns that are no features
_ARRAYS = (*_NAMES, "features", "untouched", "feature_names", "provenance", "licence")
_UNTOUCHED = "untouched:"  # begins the names of columns that were measured where nothing was touched
_MOST_PIXELS = 32  # along an edge
_POSES = ("down", "45", "side")
Read: TypeAlias = tuple[RecordedTouches, tuple[str, ...]]


def _touches_of_table(
    paths: Sequence[Path],
    words: Sequence[str],
    source: str,
    actions: Sequence[str] = (),
    factors: Sequence[str] = (),
    **facts: Any,
) -> RecordedTouches:
    """The rows of CSV files, in which columns other than ``words`` are features; ``actions`` are those of the files."""
    hint = " (leave the column out, or if it is part of the action, give --action {})"
    table = read_columns(paths, words, BadRecording, needed=("object",), is_numeric=True, hint=hint)
    if not len(table.numbers):
        raise BadRecording(f"the CSV files in {source} have no rows below their headers")
    if actions:
        table.arrays["action"] = np.repeat(actions, np.diff([*table.places[1], len(table.numbers)]))
    is_control = np.array([name.startswith(_UNTOUCHED) for name in table.headings], np.bool_)
    kept = [name for name in table.headings if not name.startswith(_UNTOUCHED)]
    if is_control.any():
        apart = {name.removeprefix(_UNTOUCHED).strip(): i for i, name in enumerate(table.headings) if is_control[i]}
        order = [apart[name] for name in (kept if set(kept) == set(apart) else apart)]
        facts["controls"] = {"untouched": table.numbers[:, order]}
    facts |= {"action_names": actions, "feature_names": kept, "factors": factors}
    return touches_of_columns(table.numbers[:, ~is_control], table.arrays, source, place=table.place, **facts)


def read_csv(folder: Path, factors: Sequence[str] = ()) -> Read:
    """The touches of all CSV files of a folder; BadRecording names the file and the line that is none."""
    require_folder(folder, "one or more .csv files, with the columns object, action, session and features")
    paths = sorted(path for end in ("*.csv", "*.csv.gz") for path in folder.glob(end))
    if not paths:
        raise BadRecording(f"there is no .csv or .csv.gz file in {folder}")
    others = sorted(path.name for path in folder.iterdir() if path not in paths)
    words = list(dict.fromkeys((*_NAMES, *factors)))
    return _touches_of_table(paths, words, str(folder), factors=factors), _ignored("file", others)


def read_bts3(folder: Path) -> Read:
    """The grasps of the 41 objects of the training files, and what was left out; errors as of :func:`read_csv`."""
    require_folder(folder, "bts3v2_palm_down.csv, bts3v2_palm_45.csv and bts3v2_palm_side.csv (or .csv.gz)")
    paths = []
    for pose in _POSES:
        found = [path for end in ("csv", "csv.gz") if (path := folder / f"bts3v2_palm_{pose}.{end}").exists()]
        if not found:
            raise BadRecording(f"there is no file bts3v2_palm_{pose}.csv or .csv.gz in {folder}")
        paths.append(found[0])
    touches = _touches_of_table(
        paths,
        ("object", "slipped"),
        str(folder),
        [f"palm {pose}" for pose in _POSES],
        provenance="BioTac SP Stability Set v2 (3dperceptionlab/biotacsp-stability-set-v2), 41 training objects",
        licence="MIT",
    )
    return touches, ("the column 'slipped' is left out: it is known only after the touch",)


def read_npz(path: Path, factors: Sequence[str] = ()) -> Read:
    """The touches of a ``.npz`` file, or of the only one in a folder; BadRecording if it has no such plain arrays."""
    if path.is_dir():
        found = sorted(path.glob("*.npz"))
        if len(found) != 1:
            raise BadRecording(f"{path} must hold one .npz file, it holds {len(found)}; give the file itself")
        path = found[0]
    hint = ". Touches are features (n, F), or pictures (n, H, W) or (n, H, W, C), and object (n,)"
    table = read_columns([path], (*_ARRAYS, *factors), BadRecording, needed=("features", "object"), hint=hint)
    arrays, others = table.arrays, table.others
    given = {name: arrays[name] for name in (*_NAMES, *factors) if name in arrays}
    names = list(map(str, np.atleast_1d(arrays.get("feature_names", ())).tolist()))
    features, controls, notes = (
        _numbers("features", arrays["features"], path),
        dict[str, Floats](),
        _ignored("array", others),
    )
    shape = features.shape[1:]
    if "untouched" in arrays:
        controls["untouched"] = _numbers("untouched", arrays["untouched"], path)
    if len(shape) > 1:
        pictures, *nothing = (_averaged(array) for array in (features, *controls.values()))
        rows, columns, colours = pictures.shape[1:]
        notes = (*notes, f"pictures {shape} are read as {rows} x {columns} pixels of {colours} numbers")
        names = [f"pixel {r},{c}" + f" of {k}" * (colours > 1) for r, c, k in np.ndindex(pictures.shape[1:])]
        is_border = np.ones((rows, columns), np.bool_)
        is_border[1:-1, 1:-1] = False
        controls = {name: array.reshape(len(array), -1) for name, array in zip(controls, nothing, strict=True)}
        if not is_border.all():
            controls["border pixels"] = pictures[:, is_border].reshape(len(features), -1)
        features = pictures
    touches = touches_of_columns(
        features.reshape(len(features), -1),
        given,
        str(path),
        factors=factors,
        feature_names=names,
        controls=controls,
        provenance=str(arrays.get("provenance", "")),
        licence=str(arrays.get("licence", "not stated")),
    )
    return touches, notes


def _numbers(name: str, array: NDArray[Any], path: Path) -> Floats:
    """An array of rows or pictures as numbers."""
    if array.ndim not in (2, 3, 4) or array.dtype.kind not in "biuf":
        raise BadRecording(
            f"{name} in {path} must be numbers (n, F), or pictures (n, H, W) or (n, H, W, C), got {array.dtype} "
            f"{array.shape}"
        )
    return array.astype(np.float64)


def _averaged(pictures: Floats) -> Floats:
    """Pictures ``(n, H, W)`` or ``(n, H, W, C)`` as at most 32 x 32 means of equal blocks, ``(n, h, w, C)``."""
    found = pictures.reshape(*pictures.shape[:3], -1)
    for axis in (1, 2):
        size = found.shape[axis]
        edges = (
            np.arange(size) if size <= _MOST_PIXELS else np.linspace(0, size, _MOST_PIXELS, endpoint=False).astype(int)
        )
        found = np.add.reduceat(found, edges, axis) / np.diff([*edges, size]).reshape([-1] + [1] * (3 - axis))
    return found


def _ignored(kind: str, names: Iterable[str]) -> tuple[str, ...]:
    """A sentence about what is not read; none where there is nothing."""
    listed = [repr(name) for name in names]
    return (f"ignored {kind}s: {few(listed, 12)}",) if listed else ()


Format: TypeAlias = Literal["csv", "npz", "bts3", "session"]
FORMATS: Mapping[str, Callable[..., Read]] = MappingProxyType(
    {"csv": read_csv, "npz": read_npz, "bts3": read_bts3, "session": read_session_logs}
)
"""Functions that read a folder: they return the touches, and sentences about what was left out. Those of formats with
columns also take the names of the columns that name the action."""
assert tuple(FORMATS) == get_args(Format)


def read_recorded(data: str | Path, format: str, action: Sequence[str] = ()) -> Read:
    """Recorded touches from a folder, and sentences about what was read and what was left out.

    Args:
        data: folder of the recordings; for ``npz`` also the file.
        format: a key of :data:`FORMATS`.
        action: columns that together name the action, such as a motion and a force; by default the column ``action``.

    Raises:
        BadRecording: an unknown format, or data that are not in it.
    """
    if format not in FORMATS:
        raise BadRecording(f"unknown format {format!r}; known are {', '.join(FORMATS)}")
    if action and format not in ("csv", "npz"):
        raise BadRecording(f"--action {' '.join(action)}: the format {format} has its own actions and no such columns")
    touches, notes = FORMATS[format](Path(data), *([action] if action else []))
    names = few(touches.feature_names, 12) or "without names"
    return touches, (f"{touches.features.shape[1]} features: {names}", *notes)
