"""``activetouch calibration-report``: calibration of a sensor for one touch, fused touches, and stopped searches."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from activetouch.data.dataset import read_split
from activetouch.data.manifest import read_manifest
from activetouch.perception.reader import TactileReader
from activetouch.scene import Scene
from activetouch.sensor_files import READER_FILE
from belief.claims import claim_folder, ends_claims
from belief.errors import ActiveTouchError
from belief.observation_model import registry
from belief.observation_model.selection import choose_observation_model
from belief.seeding import keyed_rng
from experiments.calibration.models import UNDISCOUNTED, score_model
from experiments.calibration.report import Measurements
from experiments.calibration.sequences import KINDS, Rounds
from experiments.calibration.touches import CALIBRATION_FITS, score_touches
from experiments.command_line.arguments import Jobs, Seed, check_arguments
from experiments.command_line.trust import Trust
from experiments.parallel import default_jobs, run_tasks
from experiments.scene_choice import in_file_names, named_scene, repeats_folder
from experiments.sensor.calibrate import candidate_models, require_enough, scene_of
from experiments.sensor.scores import read_touches
from experiments.sensor_choice import open_collection, require_collection, sensor_folder

T = TypeVar("T")


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
    """Folder for report.html, numbers.json, tables.md and figures; runs/calibration-SCENE by default."""
    seed: Seed = 0
    """Seed of sequences, null distributions and intervals."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes; the results do not depend on it."""
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
        found = calibration_report(
            reader,
            data,
            scene,
            name=self.scene,
            seed=self.seed,
            jobs=self.jobs,
        )
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
    resamples: int = 500,
    seed: int = 0,
    jobs: int = 1,
) -> Measurements:
    """Measure the calibration of a sensor: single touches, fused touches, and searches that stop at a confidence.

    Args:
        reader: reader of the touches, such as ``sensor.reader``.
        data: folder of a collection whose objects were touched several times in every pose.
        scene: scene of the touches, if it is known; without it, no model is about one rigid body.
        name: name of the scene, for the report.
        confidence: posterior probability at which a search stops.
        resamples: number of bootstrap samples of objects for the interval of a calibration error.
        seed: seed of sequences, null distributions and intervals.
        jobs: number of processes; the results do not depend on it.

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
    rounds = {}
    for split in ("calibration", "test"):  # in turn, because the images of one take a gigabyte
        truth = read_split(data, split)
        touches = read_touches(reader, truth, f"reading {split} touches")
        rounds[split] = Rounds.of(truth, touches, len(manifest.pose_labels))
    known, test = rounds["calibration"].singles(), rounds["test"]

    def generator(*key: int) -> np.random.Generator:
        return keyed_rng([seed, *key], is_fixed_length=True)

    singles = test.singles()
    touch_scores = _results(
        {
            fit: partial(score_touches, fit, known, singles, generator(0, index), resamples)
            for index, fit in enumerate(CALIBRATION_FITS)
        },
        jobs,
        "single touches",
    )
    labels: dict[str, Any] = {"shape_labels": manifest.shape_labels, "num_poses": len(manifest.pose_labels)}
    fitted_to = (known.batch.reshaped((1, -1)).sequence(0), known.shapes, known.object_ids)
    choosing = {n: partial(choose_observation_model, *fitted_to, **labels, candidates={n: fits[n]}) for n in fits}
    embeds = registry.fits("embeddings")
    separate = {n: task for n, task in choosing.items() if n not in embeds}
    chosen = _results(separate, jobs, "fitting observation models")
    chosen |= {n: choosing[n]() for n in choosing if n in embeds}  # which embed their hypotheses once, here
    models = {n: (choice.model, choice.losses[n]) for n, choice in chosen.items()}
    ratio: Any = models["ratio"][0]
    sequences = {kind: gather(test, generator(1, index)) for index, (kind, gather) in enumerate(KINDS.items())}
    scoring = {
        n: partial(score_model, n, *fit, sequences, confidence, generator(2, index))
        for index, (n, fit) in enumerate({**models, UNDISCOUNTED: (replace(ratio, correlation=0.0), None)}.items())
    }
    return Measurements(
        scene=name,
        seed=seed,
        confidence=confidence,
        num_objects={split: of_split.num_objects for split, of_split in rounds.items()},
        num_rounds=test.num_rounds,
        touches=list(touch_scores.values()),
        models=list(_results(scoring, jobs, "fused touches").values()),
    )


def _results(tasks: Mapping[str, Callable[[], T]], jobs: int, description: str) -> dict[str, T]:
    """Results of tasks by name, in the order of the tasks."""
    found = dict(run_tasks([partial(_with_name, name, task) for name, task in tasks.items()], jobs, description))
    return {name: found[name] for name in tasks}


def _with_name(name: str, task: Callable[[], T]) -> tuple[str, T]:
    return name, task()
