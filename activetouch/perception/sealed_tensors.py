"""Arrays in a safetensors file whose header tells their SHA-256: whole or not there, and no code is run from it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from belief.errors import CorruptFile
from belief.files import atomic_path, sealed_json, unsealed_json

_FORMAT = "activetouch-state-1"


def write_tensors(path: Path, tensors: Mapping[str, NDArray[Any]], fields: Mapping[str, Any]) -> None:
    """Write arrays by name, and JSON fields with them, atomically."""
    arrays = {name: np.ascontiguousarray(array).reshape(np.shape(array)) for name, array in tensors.items()}
    header = sealed_json({"fields": fields, "tensors": _digest(arrays)}, indent=None)
    with atomic_path(path) as temporary:
        save_file(arrays, temporary, metadata={_FORMAT: header})


def read_tensors(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """The arrays and fields from :func:`write_tensors`.

    Raises:
        CorruptFile: the file is missing, truncated, of another kind, or was changed after it was written.
    """
    try:
        with safe_open(path, framework="np") as file:
            header = unsealed_json((file.metadata() or {})[_FORMAT])
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if header["tensors"] != _digest(arrays):
            raise ValueError("it was changed after it was written: its arrays do not match their SHA-256")
        fields = dict(header["fields"])
    except KeyError as error:
        raise CorruptFile(f"{path} is damaged: it has no {error}") from error
    except (SafetensorError, OSError, ValueError, TypeError) as error:
        raise CorruptFile(f"{path} is damaged: {error}") from error
    return arrays, fields


def array_digest(*arrays: NDArray[Any]) -> str:
    """SHA-256 of arrays: types, shapes and content.

    >>> array_digest(np.zeros(2)) != array_digest(np.zeros((1, 2)))
    True
    """
    return _digest({str(index): array for index, array in enumerate(arrays)})


def _digest(arrays: Mapping[str, NDArray[Any]]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
