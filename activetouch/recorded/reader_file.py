"""The file of a reader of recorded touches: arrays in safetensors with a SHA-256; reading it runs no code from it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.recorded.reader import Fitted, LinearDiscriminants, RecordedReader
from belief.calibration import PerPose
from belief.errors import CorruptFile
from belief.files import array_digest
from belief.naming import checked_names
from belief.sealed_tensors import read_tensors, write_tensors

RECORDED_READER = "activetouch-recorded-reader-1"
"""The kind of file."""


def write_recorded_reader(path: Path, reader: RecordedReader) -> None:
    """Write a reader, exact to the last bit.

    Raises:
        CannotWrite: there is no room, or no permission.
    """
    write_tensors(path, *_arrays_and_header(reader), RECORDED_READER)


def digest_of(reader: RecordedReader) -> str:
    """SHA-256 of all that a reader reads with."""
    arrays, header = _arrays_and_header(reader)
    text = json.dumps(header, sort_keys=True)
    return hashlib.sha256(f"{array_digest(arrays)} {text}".encode()).hexdigest()


def _arrays_and_header(reader: RecordedReader) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """What a file holds of a reader."""
    arrays: dict[str, NDArray[Any]] = {"log_prior": reader.log_prior}
    for action, fitted in enumerate(reader.classifiers):
        arrays |= {f"{action}.centre": fitted.centre, f"{action}.scale": fitted.scale}
        own = {field.name: getattr(fitted.classifier, field.name) for field in fields(fitted.classifier)}
        arrays |= {f"{action}.classifier.{name}": np.asarray(own[name]) for name in own if own[name] is not None}
    header = {
        "calibration": reader.calibration.to_fields(),
        "chosen": list(reader.chosen),
        "label_names": list(reader.label_names),
        "action_names": list(reader.action_names),
        "feature_names": list(reader.feature_names),
    }
    return arrays, header


def read_recorded_reader(path: Path) -> RecordedReader:
    """The reader of :func:`write_recorded_reader`, which reads to the last bit what the written one does.

    Raises:
        CorruptFile: the file is missing, truncated, of another kind, was changed, or its parts do not fit each other.
    """
    arrays, header = read_tensors(path, RECORDED_READER)
    try:
        labels, actions = (checked_names(name, header[name]) for name in ("label_names", "action_names"))
        classifiers = tuple(
            Fitted(arrays[f"{i}.centre"], arrays[f"{i}.scale"], _classifier(i, arrays), len(labels))
            for i in range(len(actions))
        )
        others = tuple(header["chosen"]), labels, actions, tuple(header["feature_names"])
        reader = RecordedReader(classifiers, PerPose.from_fields(header["calibration"]), arrays["log_prior"], *others)
        size = len(actions), reader.num_features
        found = reader.ratios(np.zeros(size), np.arange(len(actions)))
        if found.shape != (len(actions), len(labels)) or len(reader.feature_names) not in (0, size[1]):
            raise ValueError(
                f"it has {found.shape} ratios and {len(reader.feature_names)} names for {size[1]} features"
            )
        if np.isnan(found).any():
            raise ValueError("it reads zeros as NaN")
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, MemoryError) as error:
        raise CorruptFile(f"{path} does not describe a reader of recorded touches: {error!r}") from error
    return reader


def _classifier(action: int, arrays: Mapping[str, NDArray[Any]]) -> LinearDiscriminants:
    """A classifier from its arrays, of which those without dimensions are numbers."""
    prefix = f"{action}.classifier."
    own = {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
    values: dict[str, Any] = {name: array if array.ndim else array.item() for name, array in own.items()}
    return LinearDiscriminants(**values)
