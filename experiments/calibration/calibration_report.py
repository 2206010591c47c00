"""``activetouch calibration-report``: calibration of a sensor for one touch, fused touches, and stopped searches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from activetouch.data.dataset import read_split
from activetouch.data.manifest import read_manifest
from activetouch.perception.reader import TactileReader
from activetouch.scene import Scene
from activetouch.sensor_files import READER_FILE
from belief import metrics
from belief.calibration import CALIBRATIONS, Calibration, TemperatureScaling
from belief.errors import ActiveTouchError
from belief.files import claim_folder, ends_claims
from belief.seeding import keyed_rng
from experiments.calibration.measurements import KINDS, RAW, UNDISCOUNTED, Measurements, Rounds, score_model
from experiments.command_line.arguments import Seed, Trust, check_arguments
from experiments.scene_choice import in_file_names, named_scene, repeats_folder
from experiments.sensor.calibrate import candidate_models, require_enough, scene_of
from experiments.sensor.scores import read_touches
from experiments.sensor_choice import open_collection, require_collection, sensor_folder


class NoRepeats(ActiveTouchError, ValueError):
    """A collection has no repeated touches of an object in one pose."""


@dataclass(frozen=True)
class CalibrationReport:
    """Measure the calibration of a sensor: single touches, fused touches, and searches that stop at a confidence.

    Fits all calibrations and observation models to the calibration split of a collection whose objects were touched
    several times in every pose, and evaluates them on the test split. The first paragraph is the verdict.

    For example:

        activetouch collect --scene coarse --plan.train 0 --plan.repeats 6 --out data/coarse-repeats
        activetouch calibration-report --scene coarse
        activetouch calibration-report --scene paper --sensor paper-independent
        activetouch calibration-report --data data/mug-repeats --sensor runs/sensor-mug --out runs/calibration-mug
    """

    scene: str = "coarse"
    """Name of the scene, which gives the defaults of the next three."""
    data: Path | None = None
    """Folder of the collection; data/SCENE-repeats by default."""
    sensor: Path | None = None
    """Folder of the sensor, or name of a shipped one; the shipped sensor of the scene by default."""
    out: Path | None = None
    """Folder for report.html, numbers.json, tables.md and a figure; runs/calibration-SCENE by default."""
    seed: Seed = 0
    """Seed of sequences and null distributions."""
    anyway: bool = False
    """Use a collection of another scene than the sensor's."""
    trust: bool = False
    """Run code of your own that the collection names beside --scene, such as a renderer module:attribute."""

    @ends_claims
    def run(self) -> None:
        """Measure, print and write."""
        check_arguments(self)
        named_scene(self.scene)  # raises for an unknown name
        data = self.data if self.data is not None else repeats_folder(self.scene)
        folder = self.out if self.out is not None else Path(f"runs/calibration-{in_file_names(self.scene)}")
        claim_folder(folder)
        manifest = open_collection(data, self.scene, repeats=True)
        reader = TactileReader.load(sensor_folder(self.sensor, self.scene) / READER_FILE)
        filed = self.scene if self.out is None else None
        require_collection(data, manifest, reader.card, filed, anyway=self.anyway)
        scene = scene_of(manifest, Trust(data, [self.scene], self.trust))
        found = calibration_report(reader, data, scene, name=self.scene, seed=self.seed)
        found.save(folder)
        print(found)
        print(f"wrote {folder / 'report.html'}; all tables are in {folder / 'tables.md'}")


def calibration_report(
    reader: TactileReader,
    data: str | Path,
    scene: Scene | None = None,
    *,
    name: str = "",
    confidence: float = 0.95,
    seed: int = 0,
) -> Measurements:
    """Measure the calibration of a sensor: single touches, fused touches, and searches that stop at a confidence.

    Args:
        reader: reader of the touches, such as ``sensor.reader``.
        data: folder of a collection whose objects were touched several times in every pose.
        scene: scene of the touches, if it is known; without it, no model is about one rigid body.
        name: name of the scene, for the report.
        confidence: posterior probability at which a search stops.
        seed: seed of sequences and null distributions.

    Raises:
        NoRepeats: Objects were touched only once in a pose.
        TooFewObjects: There are too few objects to choose a model.
    """
    data = Path(data)
    manifest = read_manifest(data)
    if manifest.plan.repeats < 2:
        raise NoRepeats(
            f"{data} touches every object once per pose, so the dependence of repeated touches cannot be measured. "
            "Record several rounds: collect --plan.train 0 --plan.repeats 6"
        )
    require_enough(manifest, data)
    fits = candidate_models({}, reader, scene)
    read, rounds = {}, {}
    for split in ("calibration", "test"):  # in turn, because the images of one take a gigabyte
        truth = read_split(data, split)
        read[split] = truth, read_touches(reader, truth, f"reading {split} touches")
        rounds[split] = Rounds.of(*read[split], len(manifest.pose_labels))
    (known, touches), (truth, tested) = read["calibration"], read["test"]

    def generator(*key: int) -> np.random.Generator:
        return keyed_rng([seed, *key], is_fixed_length=True)

    logits = touches.require_logits()[0]
    calibrations: dict[str, Calibration] = {RAW: TemperatureScaling(1.0, "ok")}
    calibrations |= {name: kind().fit_logits(logits, known.shapes) for name, kind in CALIBRATIONS.items()}
    singles = {
        name: metrics.calibration_report(
            each.predict_proba(tested.require_logits()[0]), truth.shapes, generator(0, index)
        )
        for index, (name, each) in enumerate(calibrations.items())
    }
    labels: dict[str, Any] = {"shape_labels": manifest.shape_labels, "num_poses": len(manifest.pose_labels)}
    models = {n: fit(touches.sequence(0), known.shapes, known.object_ids, **labels) for n, fit in fits.items()}
    ratio: Any = models["ratio"]
    sequences = {kind: gather(rounds["test"], generator(1, i)) for i, (kind, gather) in enumerate(KINDS.items())}
    return Measurements(
        scene=name,
        seed=seed,
        confidence=confidence,
        num_objects={split: of_split.num_objects for split, of_split in rounds.items()},
        num_rounds=rounds["test"].num_rounds,
        touches=singles,
        models=[
            score_model(n, model, sequences, confidence, generator(2, index))
            for index, (n, model) in enumerate({**models, UNDISCOUNTED: replace(ratio, correlation=0.0)}.items())
        ],
    )
