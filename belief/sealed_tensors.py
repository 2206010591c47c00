"""Arrays in a safetensors file whose header carries JSON fields and a SHA-256; reading one runs no code from it.

The package safetensors is loaded when a file is written or read.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from belief.errors import CorruptFile
from belief.files import array_digest, atomic_path, require_regular_file, sealed_json, unsealed_json

STATE = "activetouch-state-1"
"""The kind of file that holds the state of a training."""


def write_tensors(
    path: Path, tensors: Mapping[str, NDArray[Any]], fields: Mapping[str, Any], kind: str = STATE
) -> None:
    """Write arrays by name and JSON fields into one file, atomically; equal content gives equal bytes."""
    from safetensors.numpy import save_file

    arrays = {name: np.ascontiguousarray(array).reshape(np.shape(array)) for name, array in tensors.items()}
    # One entry of metadata: several would be written in random order.
    header = sealed_json({"fields": fields, "tensors": array_digest(arrays)}, indent=None)
    with atomic_path(path) as temporary:
        save_file(arrays, temporary, metadata={kind: header})


def read_tensors(path: Path, kind: str = STATE) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """The arrays and fields from :func:`write_tensors`."""
    with _opened(path) as file:
        header = _header(file.metadata(), kind)
        arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if header["tensors"] != array_digest(arrays):
            raise ValueError("it was changed after it was written: its arrays do not match their SHA-256")
        return arrays, dict(header["fields"])


def read_fields(path: Path, kind: str = STATE) -> dict[str, Any]:
    """The fields alone, from the header, whose digest is checked; the arrays are not."""
    with _opened(path) as file:
        return dict(_header(file.metadata(), kind)["fields"])


def _header(metadata: Mapping[str, str] | None, kind: str) -> dict[str, Any]:
    if not metadata or kind not in metadata:
        found = ", ".join(sorted(metadata or {})) or "another program's tensors"
        files = ". A training writes a reader, reader.safetensors, and its state, state.safetensors"
        raise ValueError(f"it holds {found}, not {kind}" + files * (STATE in (found, kind)))
    return unsealed_json(metadata[kind])


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A file that is open for reading; errors of the libraries that read it become CorruptFile."""
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(require_regular_file(path), framework="np") as file:
            yield file
    except CorruptFile:
        raise
    except KeyError as error:
        raise CorruptFile(f"{path} cannot be used: it has no {error}") from error
    except FileNotFoundError as error:
        raise CorruptFile(f"{path} is missing") from error
    except (SafetensorError, OSError) as error:
        raise CorruptFile(f"{path} is truncated, or no safetensors file: {error}") from error
    except (ValueError, TypeError) as error:
        raise CorruptFile(f"{path} cannot be used: {error}") from error
