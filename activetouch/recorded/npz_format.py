"""The format ``npz``: arrays in one ``.npz`` file, which is read without running anything.

``features (n, F)`` and ``object (n,)`` are needed; ``action``, ``session``, ``category``, ``shape``, each ``(n,)``, are
optional and mean what the columns of :mod:`activetouch.recorded.csv_format` do; ``feature_names (F,)``, ``provenance``
and ``licence`` are text.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from activetouch.recorded.bounded import MOST_BYTES, require_bounded, require_short
from activetouch.recorded.named_columns import NAMES, ignored, touches_of_columns
from activetouch.recorded.touches import RecordedTouches
from belief.files import require_regular_file

_WORDS = {"provenance": "", "licence": "not stated"}
_KNOWN = (*NAMES, *_WORDS, "features", "feature_names")


def read_npz(path: Path) -> tuple[RecordedTouches, tuple[str, ...]]:
    """The touches of a ``.npz`` file, or of the only one in a folder.

    Raises:
        BadRecording: no such file, several, arrays of objects that would have to be unpickled, or a missing array.
    """
    if path.is_dir():
        found = sorted(path.glob("*.npz"))
        if len(found) != 1:
            raise BadRecording(f"{path} must hold one .npz file, it holds {len(found)}; give the file itself")
        path = found[0]
    require_regular_file(path, BadRecording)
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > MOST_BYTES:
            raise BadRecording(f"{path} holds {size} bytes when decompressed; at most {MOST_BYTES} are read")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files if name in _KNOWN}
            others = [name for name in file.files if name not in arrays]
            given = {name: _text(name, arrays[name], str(path)) for name in NAMES if name in arrays}
    except BadRecording:
        raise
    except Exception as error:  # readers of zip and npy raise a dozen kinds on damaged bytes
        raise BadRecording(f"{path} cannot be read as .npz of plain arrays: {error}") from error
    if missing := [name for name in ("features", "object") if name not in arrays]:
        raise BadRecording(f"{path} has no array {missing[0]!r}; it has {', '.join(arrays) or 'none that is known'}")
    features = arrays["features"]
    if features.ndim != 2 or features.dtype.kind not in "biuf":
        raise BadRecording(f"features in {path} must be numbers (n, F), got {features.dtype} {features.shape}")
    require_bounded(len(features), features.size, str(path))
    provenance, licence = (str(arrays[name]) if name in arrays else default for name, default in _WORDS.items())
    names = list(map(str, np.atleast_1d(arrays.get("feature_names", ())).tolist()))
    touches = touches_of_columns(
        features.astype(np.float64),
        given,
        str(path),
        feature_names=names,
        provenance=provenance,
        licence=licence,
    )
    return touches, ignored("array", others)


def _text(name: str, column: NDArray[Any], source: str) -> NDArray[Any]:
    """A column, whose bytes are text in UTF-8, and in which NaN is an empty cell."""
    if column.dtype.kind in "SU":
        require_short(name, column.dtype.itemsize // np.dtype(f"{column.dtype.kind}1").itemsize, column.size, source)
    if column.dtype.kind == "f" and np.isnan(column).any():
        return np.where(np.isnan(column), "", column.astype(str))
    return np.char.decode(column, "utf-8") if column.dtype.kind == "S" else column
