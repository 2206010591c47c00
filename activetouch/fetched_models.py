"""Large shipped readers that the released wheel leaves out: fetched at first use, checked, and kept in the cache.

A clone has all of them. ``$ACTIVETOUCH_MODELS`` may name another source, such as a copy on a machine without a network:
a folder or an address below which they lie.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Mapping
from http.client import HTTPException
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple
from urllib.request import urlopen

from activetouch.errors import MissingWeights
from activetouch.perception.cached_arrays import cache_folder
from belief.errors import CannotWrite
from belief.files import atomic_path

FOLDER = Path(__file__).parent / "models"
_SOURCE = "https://github.com/activetouch/activetouch/raw/v{version}/activetouch/models"
_PATIENCE = 60.0  # seconds without an answer


class Fetched(NamedTuple):
    """What a file must be.

    Attributes:
        digest: its SHA-256.
        size: in bytes.
    """

    digest: str
    size: int


FETCHED: Mapping[str, Fetched] = MappingProxyType(
    {
        "any_pad.safetensors": Fetched("5bf13c4b21170848c73a81bfd572ea246867586c39de944b90309ff3d6a3bdb2", 3_699_201),
        "paper-independent/reader.safetensors": Fetched(
            "6be2395ec1fe4c6987b056ba3072ade6ab6f0ef61d1869c1f9dc31f05549ea37", 6_799_130
        ),
        "gel-convnext/reader.safetensors": Fetched(
            "6ecdf07a93282f4380f8f75fe0d5098b7c7ea62a32be902348b77337a1f669e0", 1_212_162
        ),
        "hard/reader.safetensors": Fetched("26aa4da89a842000d378579d699cd81076ea4ffab6448858eca41f99e19780fa", 977_986),
        "many/reader.safetensors": Fetched("4fc3516d4984dc44598cfb30518e5df4cc62c27ebc6a8e1bedd088ac5c76c7f3", 977_986),
        "keyed/reader.safetensors": Fetched(
            "ff69d598fec9ce370a881b5c2c6247585f1179abf13144c93a36910404bb8440", 844_584
        ),
    }
)
"""Files below the folder of models that a wheel may lack."""


def model_file(path: Path) -> Path:
    """The file itself, or, where it is a shipped one that this installation lacks, its copy in the cache.

    Raises:
        MissingWeights: it cannot be fetched, or is not what it must be; the message says what would work.
    """
    name = path.relative_to(FOLDER).as_posix() if path.is_relative_to(FOLDER) else ""
    if path.exists() or name not in FETCHED:
        return path
    wanted = FETCHED[name]
    kept = cache_folder() / "models" / wanted.digest[:16] / path.name
    if not kept.is_file():
        source = os.environ.get("ACTIVETOUCH_MODELS") or _SOURCE.format(version=version("activetouch"))
        address = f"{source.rstrip('/')}/{name}"
        print(f"fetching {address} ({wanted.size / 1e6:.1f} MB), once", file=sys.stderr)
        content = _content(address, wanted)
        try:
            kept.parent.mkdir(parents=True, exist_ok=True)
            with atomic_path(kept) as part:
                part.write_bytes(content)
        except (CannotWrite, OSError) as error:
            raise MissingWeights(
                f"{address} was fetched and cannot be kept in {kept.parent} ({error}): set ACTIVETOUCH_CACHE to a "
                "folder that you can write"
            ) from error
    return kept


def _content(address: str, wanted: Fetched) -> bytes:
    """The checked content of a file at an address or in a folder."""
    remedy = (
        "copy the folder activetouch/models of a clone to this machine, and set ACTIVETOUCH_MODELS to it; or install "
        "from a clone, which has all files"
    )
    try:
        if "://" in address:
            with urlopen(address, timeout=_PATIENCE) as answer:
                content = answer.read(wanted.size + 1)
        else:
            with Path(address).open("rb") as file:
                content = file.read(wanted.size + 1)
    except (OSError, ValueError, HTTPException) as error:
        raise MissingWeights(f"{address} cannot be fetched: {error}. Without a network, {remedy}") from error
    if hashlib.sha256(content).hexdigest() != wanted.digest:
        raise MissingWeights(f"{address} is not the file of this version (its SHA-256 differs): {remedy}")
    return content
