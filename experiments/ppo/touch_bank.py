"""``activetouch touch-bank``: convert a collection with repeated touches into banks to train policies on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from activetouch.data.dataset import read_split
from activetouch.perception.reader import TactileReader
from activetouch.sensor_files import READER_FILE
from belief.claims import claim_folder, ends_claims
from experiments.scene_choice import bank_folder, named_scene, repeats_folder
from experiments.sensor.scores import readings
from experiments.sensor_choice import open_collection, require_collection, sensor_folder

TRAINING, TEST = "calibration", "test"
"""Splits of the collection for training and for evaluation of policies."""


@dataclass(frozen=True)
class MakeTouchBank:
    """Convert recorded touches into a bank of logits and features to train policies on.

    The reader was not trained on these objects. Policies learn from those of the calibration split, and are
    evaluated on those of the test split.

    For example:

        activetouch collect --scene coarse --plan.train 0 --plan.repeats 6 --out data/coarse-repeats
        activetouch touch-bank --scene coarse
        activetouch touch-bank --data data/mug-repeats --sensor runs/sensor-mug --out data/mug-bank
    """

    scene: str = "gel"
    """Name of the scene, which gives the defaults of the next three."""
    data: Path | None = None
    """Folder of the collection; data/SCENE-repeats by default."""
    sensor: Path | None = None
    """Folder of the sensor, or name of a shipped one; the scene's by default."""
    out: Path | None = None
    """Folder of the banks, one per split; data/SCENE-bank by default."""
    anyway: bool = False
    """Use a collection of another scene than the sensor's."""
    compact: bool = False
    """Write only the objects to learn from, in half precision and without features: a bank as it comes with the
    package."""

    @ends_claims
    def run(self) -> None:
        """Read both splits and write two banks."""
        from activetouch.envs.touch_bank import TouchBank  # loads gymnasium

        named_scene(self.scene)  # raises for an unknown name
        data = self.data if self.data is not None else repeats_folder(self.scene)
        sensor = sensor_folder(self.sensor, self.scene)
        out = self.out if self.out is not None else bank_folder(self.scene)
        claim_folder(out)
        manifest = open_collection(data, self.scene, repeats=True)
        reader = TactileReader.load(sensor / READER_FILE)
        filed = self.scene if self.out is None else None
        require_collection(data, manifest, reader.card, filed, repeats=True, anyway=self.anyway)
        for split in (TRAINING,) if self.compact else (TRAINING, TEST):
            touches = read_split(data, split)
            num_objects, num_poses = len(np.unique(touches.object_ids)), len(manifest.pose_labels)
            logits, features = [], []
            for reading in readings(reader, touches.images, f"reading {split} touches"):
                logits.append(reading.logits.astype(np.float16 if self.compact else np.float32))
                features.append(reading.embeddings.astype(np.float16))
            by_object = (num_objects, manifest.plan.repeats, num_poses, -1)
            bank = TouchBank(
                np.concatenate(logits).reshape(by_object),
                touches.shapes.reshape(by_object[:3])[:, 0, 0],
                manifest.shape_labels,
                manifest.pose_labels,
                None if self.compact else np.concatenate(features).reshape(by_object),
                {"collection": str(data), "split": split, "classifier": reader.card.training},
                manifest.scene,
            )
            bank.save(out / split)
            print(f"wrote {out / split}: {num_objects} objects, {manifest.plan.repeats} rounds of {num_poses} poses")
