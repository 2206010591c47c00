"""The file of a reader of recorded touches: arrays in safetensors with a SHA-256; reading it runs no code from it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.recorded.reader import Fitted, GivenLogits, LinearDiscriminants, OwnClassifier, RecordedReader
from belief.calibration import PerPose
from belief.errors import CannotWrite, CorruptFile
from belief.files import array_digest
from belief.naming import checked_names
from belief.sealed_tensors import read_tensors, write_tensors

RECORDED_READER = "activetouch-recorded-reader-1"
"""The kind of file."""


def write_recorded_reader(path: Path, reader: RecordedReader) -> None:
    """Write a reader, exact to the last bit."""
    if any(isinstance(fitted.classifier, OwnClassifier) for fitted in reader.classifiers):
        raise CannotWrite(
            f"{path} holds arrays, and a classifier of your own is code: make the sensor where you use it, with "
            "RecordedSensor.fit(touches, classifier=...), or save its logits and train with --logits"
        )
    write_tensors(path, *_arrays_and_header(reader), RECORDED_READER)


def digest_of(reader: RecordedReader) -> str:
    """SHA-256 of all that determines the results of a reader."""
    arrays, header = _arrays_and_header(reader)
    text = json.dumps(header, sort_keys=True)
    return hashlib.sha256(f"{array_digest(arrays)} {text}".encode()).hexdigest()


def _arrays_and_header(reader: RecordedReader) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """The arrays and the header of a reader's file."""
    arrays: dict[str, NDArray[Any]] = {"log_prior": reader.log_prior}
    arrays |= {"usual": reader.usual, "blank": reader.blank}
    for action, fitted in enumerate(reader.classifiers):
        arrays |= {f"{action}.centre": fitted.centre, f"{action}.scale": fitted.scale}
        for part in ("classifier", "usual") if fitted.usual is not fitted.classifier else ("classifier",):
            own = vars(getattr(fitted, part))
            known = {name: value for name, value in own.items() if value is not None and name != "own"}
            arrays |= {f"{action}.{part}.{name}": np.asarray(value) for name, value in known.items()}
    users = [repr(part.classifier.own) for part in reader.classifiers if isinstance(part.classifier, OwnClassifier)]
    header = {
        "calibration": reader.calibration.to_fields(),
        "chosen": list(reader.chosen),
        "label_names": list(reader.label_names),
        "action_names": list(reader.action_names),
        "feature_names": list(reader.feature_names),
        **({"users": users} if users else {}),
    }
    return arrays, header


def read_recorded_reader(path: Path) -> RecordedReader:
    """The reader from :func:`write_recorded_reader`, with the same results to the last bit."""
    arrays, header = read_tensors(path, RECORDED_READER)
    try:
        labels, actions = (checked_names(name, header[name]) for name in ("label_names", "action_names"))
        parts = [
            (_classifier(f"{i}.classifier.", arrays), _classifier(f"{i}.usual.", arrays)) for i in range(len(actions))
        ]
        classifiers = tuple(
            Fitted(arrays[f"{i}.centre"], arrays[f"{i}.scale"], known, len(labels), usual or known)
            for i, (known, usual) in enumerate(parts)
        )
        tested: dict[str, Any] = {name: arrays[name] for name in ("usual", "blank") if name in arrays}
        others = tuple(header["chosen"]), labels, actions, tuple(header["feature_names"])
        reader = RecordedReader(
            classifiers, PerPose.from_fields(header["calibration"]), arrays["log_prior"], *others, **tested
        )
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


def _classifier(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> Any:
    """A classifier from its arrays, where arrays without dimensions are numbers; None where there are none."""
    own = {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
    values: dict[str, Any] = {name: array if array.ndim else array.item() for name, array in own.items()}
    return (GivenLogits if "columns" in values else LinearDiscriminants)(**values) if values else None
