"""The formats of recorded touches, each a function that reads a folder. To add one, write it and add a line at the end.

All read columns with :func:`belief.columns.read_columns`, and :func:`touches_of_columns` checks what these hold.

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
* ``session``: logs of sessions (docs/session_log.md). A touch counts if it was not taken back and the true shape of
  its object was revealed. Its features are the pixels of its image or, where it has none, what a reader said of it.
  Every visit of an object is a session.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from activetouch.recorded.touches import RecordedTouches
from belief.columns import read_columns, require_bounded
from belief.errors import CorruptFile, did_you_mean
from belief.files import plain_number
from belief.journal import array_from, read_journal
from belief.naming import few
from belief.observation_model.action_kernel import numbered_sessions
from belief.validation import Floats

KINDS_OF = {"categories": "category", "shapes": "shape"}
"""The column of each task besides ``objects``."""
_MOST_SESSION = 2**53  # so that it is exact as a float
_NAMES = ("object", "action", "session", *KINDS_OF.values())  # columns that are no features
_ARRAYS = (*_NAMES, "features", "untouched", "feature_names", "provenance", "licence")
_UNTOUCHED = "untouched:"  # begins the names of columns that were measured where nothing was touched
_TYPO = 0.8  # least similarity of two names of which one is a typing error
_MOST_PIXELS = 32  # along an edge
_MOST_BORDER = 0.7  # share of the pixels; of 4 x 4, most lie at the border
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
    hint = " (leave the column out; if it is part of the action, give --action {}; if it is a label, name it category)"
    table = read_columns(paths, words, BadRecording, needed=("object",), is_numeric=True, hint=hint)
    _require_no_typo(table.headings, [word for word in words if word not in table.arrays], source)
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
    """The touches of a CSV file, or of all of a folder; BadRecording names the file and the line that is none."""
    if folder.suffix == ".npz":
        raise BadRecording(f"{folder} is no CSV file: add --format npz")
    paths, others = [folder], list[str]()
    if not folder.is_file():
        require_folder(folder, "one or more .csv files, with the columns object, action, session and features")
        paths = sorted(path for end in ("*.csv", "*.csv.gz") for path in folder.glob(end))
        others = sorted(path.name for path in folder.iterdir() if path not in paths)
    if not paths:
        raise BadRecording(
            f"there is no .csv or .csv.gz file in {folder}. A file has a header such as object,action,session,f1,f2 "
            "and one line for each touch"
        )
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
    _require_no_typo(others, [name for name in (*_NAMES, *factors) if name not in arrays], str(path))
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
        if is_border.mean() <= _MOST_BORDER:  # of a small picture, the border is touched as well
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


def _require_no_typo(others: Iterable[str], absent: Sequence[str], source: str) -> None:
    """Refuse a column that is called nearly like an absent one; typing errors are rarely in the first letter."""
    for name in filter(str.isalpha, others):
        if hint := did_you_mean(name.lower(), [word for word in absent if word[0] == name[0].lower()], _TYPO):
            raise BadRecording(f"{source} has a column {name!r}.{hint} Rename it, also if it is a feature")


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


def require_folder(folder: Path, what: str) -> None:
    """Refuse what is no folder, and say what it must hold."""
    if not folder.is_dir():
        raise BadRecording(f"there is no folder {folder}; it must hold {what}")


def touches_of_columns(
    features: Floats,
    columns: Mapping[str, NDArray[np.generic]],
    source: str,
    *,
    place: Callable[[int], str] | None = None,
    action_names: Sequence[str] = (),
    factors: Sequence[str] = (),
    feature_names: Sequence[str] = (),
    provenance: str = "",
    licence: str = "not stated",
    controls: Mapping[str, Floats] = MappingProxyType({}),
) -> RecordedTouches:
    """The touches of a table of features ``(n, F)`` and columns ``(n,)``, with all facts of :class:`RecordedTouches`.

    ``place`` names a row in messages, such as "line 7 of mugs.csv". Actions are those of the columns ``factors``, or of
    ``action``, sorted, unless ``action_names`` gives their order. Raises BadRecording, which names the row and the
    column: no feature, an object without a name or with two categories or shapes, or sessions that are not integers.

    >>> table = touches_of_columns(np.ones((2, 1)), {"object": np.array(["mug", "can"])}, "here")
    >>> table.object_names, table.action_names
    (('can', 'mug'), ('touch',))
    """
    n, place = len(features), place or (lambda row: f"row {row} of {source}")
    for name, values in columns.items():
        if values.shape != (n,):
            raise BadRecording(
                f"{name} in {source} must be ({n},) as there are {n} rows of features, got {values.shape}"
            )
    if features.size == 0:
        raise BadRecording(f"{source} has no features: every column besides object, action and session is one")
    object_names, objects = np.unique(columns["object"].astype(str), return_inverse=True)
    if "" in object_names:
        raise BadRecording(f"{place(int(np.argmax(columns['object'].astype(str) == '')))} names no object")
    if lacking := [name for name in factors if name not in columns]:
        raise BadRecording(
            f"--action {lacking[0]}: {source} has no such column; its features are {few(feature_names, 12)}"
        )
    given = columns.get("action", np.full(n, "touch")).astype(str)
    if factors:
        given = np.array(
            [" ".join(cells) for cells in zip(*(columns[name].astype(str) for name in factors), strict=True)]
        )
    ordered = tuple(action_names) or tuple(map(str, np.unique(given)))
    actions = np.array([ordered.index(name) for name in given.tolist()])
    sessions = numbered_sessions(objects, actions)
    if "session" in columns:
        sessions = _sessions(columns["session"], place)
    kinds = {
        task: _kinds(column, columns[column].astype(str), objects, place)
        for task, column in KINDS_OF.items()
        if column in columns
    }
    names = ordered, tuple(map(str, object_names))
    return RecordedTouches(
        features,
        actions,
        objects,
        sessions,
        *names,
        provenance or source,
        licence,
        tuple(feature_names),
        kinds,
        controls,
    )


def _kinds(
    column: str, values: NDArray[np.str_], objects: NDArray[np.intp], place: Callable[[int], str]
) -> tuple[str, ...]:
    """The category or shape of each object."""
    firsts = np.unique(objects, return_index=True)[1]
    if (others := np.flatnonzero(values != values[firsts][objects])).size:
        row, first = int(others[0]), int(firsts[objects[others[0]]])
        raise BadRecording(
            f"{place(row)} names an object with two of {column}: {str(values[row])!r} here and {str(values[first])!r} "
            f"in {place(first)}"
        )
    return tuple(map(str, values[firsts]))


def _sessions(values: NDArray[np.generic], place: Callable[[int], str]) -> NDArray[np.int64]:
    for row, value in enumerate(values.tolist()):
        try:
            number = plain_number(value) if isinstance(value, str) else float(value)
            is_whole = number.is_integer() and abs(number) < _MOST_SESSION
        except (TypeError, ValueError):  # such as dates
            is_whole = False
        if not is_whole:
            raise BadRecording(
                f"{place(row)}: the session is {str(value)[:40]!r}; it must be a whole number, in order of recording"
            )
    return values.astype(np.float64).astype(np.int64)


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
