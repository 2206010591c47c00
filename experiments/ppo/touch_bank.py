"""Recorded touches as a reader reads them: the bank that policies are trained on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from activetouch.data.dataset import read_split
from activetouch.data.manifest import read_manifest
from activetouch.envs.touch_bank import MANIFEST, TouchBank
from activetouch.perception.reader import TactileReader
from experiments.sensor.scores import readings

TRAINING, TEST = "calibration", "test"
"""Splits of the collection for training and for evaluation of policies."""


def make_bank(reader: TactileReader, data: Path, split: str) -> TouchBank:
    """Read the touches of a collection with repeated touches.

    Args:
        reader: reader of the touches, which was not trained on these objects.
        data: folder of the collection.
        split: split of the collection, such as :data:`TRAINING`.
    """
    manifest, touches = read_manifest(data), read_split(data, split)
    logits, features = [], []
    for reading in readings(reader, touches.images, f"reading {split} touches"):
        logits.append(reading.logits.astype(np.float32))
        features.append(reading.embeddings.astype(np.float16))
    by_object = (len(np.unique(touches.object_ids)), manifest.plan.repeats, len(manifest.pose_labels), -1)
    return TouchBank(
        np.concatenate(logits).reshape(by_object),
        touches.shapes.reshape(by_object[:3])[:, 0, 0],
        manifest.shape_labels,
        manifest.pose_labels,
        np.concatenate(features).reshape(by_object),
        {"collection": manifest.identity, "split": split, "classifier": reader.card.training},
        manifest.scene,
    )


def kept_bank(reader: TactileReader, data: Path, split: str, folder: Path) -> TouchBank:
    """The bank in a folder, if it is :func:`make_bank` of the same collection and reader; otherwise it is made there.

    Raises:
        CorruptFile: A file of the bank in the folder was changed.
    """
    source = {"collection": read_manifest(data).identity, "split": split, "classifier": reader.card.training}
    if (folder / MANIFEST).is_file():
        found = TouchBank.open(folder)
        if dict(found.source) == source:
            return found
    make_bank(reader, data, split).save(folder)
    return TouchBank.open(folder)
