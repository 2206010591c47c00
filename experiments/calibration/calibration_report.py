"""``activetouch calibration-report``: calibration of a sensor for one touch, fused touches, and stopped searches."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from activetouch.data.dataset import read_split
from activetouch.data.manifest import Manifest
from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.perception.reader import TactileReader
from activetouch.sensor_files import READER_FILE
from belief.claims import claim_folder, ends_claims
from belief.errors import ActiveTouchError
from belief.files import write_text
from belief.observation_model import RatioModel
from belief.observation_model.registry import JOINT_MODELS, OBSERVATION_MODELS, Fit
from belief.observation_model.rigid_body import RigidBodyModel
from belief.seeding import keyed_rng
from experiments.calibration.measurements import Measurements
from experiments.calibration.models import UNDISCOUNTED, fit_model, free_weights, score_model
from experiments.calibration.orientation import RankTest, rank_tests
from experiments.calibration.sequences import KINDS, Rounds
from experiments.calibration.touches import CALIBRATION_FITS, score_touches
from experiments.command_line.arguments import Count, Jobs, Seed, Within, check_arguments
from experiments.command_line.console import plain_console
from experiments.command_line.trust import Trust
from experiments.parallel import default_jobs, run_tasks
from experiments.scene_choice import in_file_names, named_scene, repeats_folder
from experiments.sensor.calibrate import candidate_models, how_to_record, require_enough, scene_of
from experiments.sensor.scores import read_touches
from experiments.sensor_choice import open_collection, require_collection, sensor_folder

if TYPE_CHECKING:
    from experiments.reporting.page import Section


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
    confidence_level: Annotated[float, Within(0.0, 1.0, open_low=True, open_high=True)] = 0.95
    """Posterior probability at which a search stops."""
    resamples: Count = 500
    """Bootstrap samples of objects for the interval of a calibration error."""
    orientation_hypotheses: Count | None = None
    """Test the posterior of orientation and size with so many hypotheses of each shape, at temperature 1; with those of
    the model, at its temperature, by default. Hypotheses are points: 2 048 lie too far apart where touches are
    sharp, and the model's temperature makes up for that."""
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
        from experiments.calibration.sections import sections  # loads matplotlib

        named_scene(self.scene)  # raises for an unknown name
        data = self.data if self.data is not None else repeats_folder(self.scene)
        folder = self.out if self.out is not None else Path(f"runs/calibration-{in_file_names(self.scene)}")
        claim_folder(folder)
        manifest = open_collection(data, self.scene, repeats=True)
        if manifest.plan.repeats < 2:
            raise NoRepeats(
                f"{data} touches every object once per pose, so the dependence of repeated touches cannot be measured. "
                f"Record several rounds{how_to_record(manifest, data)}"
            )
        reader = self._reader(data, manifest)
        require_enough(manifest, data)
        scene = scene_of(manifest, Trust(data, [self.scene], self.trust))
        fits = candidate_models({}, reader, scene)
        hypotheses = HypothesisTable(reader, scene) if JOINT_MODELS.keys() & fits.keys() and scene else None
        calibration, test = self._read(reader, data, manifest)
        found = self.measure(manifest, calibration, test, fits, hypotheses)
        report = sections(found)
        write(folder, found, report)
        console = plain_console()
        for section in report:
            console.rule(section.title)
            for sentence in section.sentences:
                console.print(sentence)
            for table in section.tables if section is report[0] else ():
                console.print(table.rich())
        print(f"wrote {folder / 'report.html'}; all tables are in {folder / 'tables.md'}")

    def _reader(self, data: Path, manifest: Manifest) -> TactileReader:
        reader = TactileReader.load(sensor_folder(self.sensor, self.scene) / READER_FILE)
        filed = self.scene if self.out is None else None
        require_collection(data, manifest, reader.card, filed, repeats=True, anyway=self.anyway)
        return reader

    def _read(self, reader: TactileReader, data: Path, manifest: Manifest) -> list[Rounds]:
        """Touches of the calibration split and of the test split."""
        found = []
        for split in ("calibration", "test"):  # in turn, because the images of one take a gigabyte
            truth = read_split(data, split)
            touches = read_touches(reader, truth, f"reading {split} touches")
            found.append(Rounds.of(truth, touches, len(manifest.pose_labels)))
        return found

    def measure(
        self,
        manifest: Manifest,
        calibration: Rounds,
        test: Rounds,
        fits: Mapping[str, Fit] = OBSERVATION_MODELS,
        hypotheses: HypothesisTable | None = None,
    ) -> Measurements:
        """All numbers of the report.

        Args:
            manifest: manifest of the collection.
            calibration: touches of the calibration split.
            test: touches of the test split.
            fits: functions that fit the observation models, by name.
            hypotheses: those of the joint model, to test its posterior of orientations and sizes.
        """
        known, unseen = calibration.singles(), test.singles()
        labels, num_poses = (manifest.shape_labels, manifest.pose_labels), len(manifest.pose_labels)
        touches = self._in_order(
            [
                partial(score_touches, name, known, unseen, labels, self._rng(0, index), self.resamples)
                for index, name in enumerate(CALIBRATION_FITS)
            ],
            "single touches",
        )
        tasks = [partial(fit_model, name, fit, known, manifest.shape_labels, num_poses) for name, fit in fits.items()]
        fitted = self._in_order([t for t in tasks if t.args[0] not in JOINT_MODELS], "fitting observation models")
        fitted += [task() for task in tasks if task.args[0] in JOINT_MODELS]  # which embed their hypotheses once, here
        choices = {choice.name: choice for choice in fitted}
        ratio = choices["ratio"].model
        assert isinstance(ratio, RatioModel), "as registered"
        models = {name: (choice.model, choice.losses[name]) for name, choice in choices.items()}
        models[UNDISCOUNTED] = (replace(ratio, correlation=0.0), None)
        sequences = {kind: gather(test, self._rng(1, index)) for index, (kind, gather) in enumerate(KINDS.items())}
        scores = self._in_order(
            [
                partial(score_model, name, *fitted, sequences, self.confidence_level, self._rng(2, index))
                for index, (name, fitted) in enumerate(models.items())
            ],
            "fused touches",
        )
        return Measurements(
            scene=self.scene,
            seed=self.seed,
            confidence=self.confidence_level,
            num_objects={"calibration": calibration.num_objects, "test": test.num_objects},
            num_rounds=test.num_rounds,
            touches=touches,
            models=scores,
            correlation=ratio.correlation,
            weights={
                split: free_weights(ratio, rounds.one_pose(self._rng(3, index)))
                for index, (split, rounds) in enumerate({"calibration": calibration, "test": test}.items())
            },
            orientation=[
                test_of_shape
                for choice in choices.values()
                if isinstance(choice.model, RigidBodyModel) and hypotheses is not None
                for test_of_shape in self._rank_tests(choice.model, hypotheses, [calibration, test])
            ],
            orientation_hypotheses=self.orientation_hypotheses,
        )

    def _rank_tests(self, model: RigidBodyModel, hypotheses: HypothesisTable, splits: list[Rounds]) -> list[RankTest]:
        if self.orientation_hypotheses is not None:
            model = model.with_hypotheses(hypotheses, self.orientation_hypotheses).at(1.0)
        bodies = hypotheses.hypotheses(model.num_hypotheses)
        return rank_tests(model, bodies.rests, bodies.sizes, splits, self._rng(4))

    def _rng(self, *key: int) -> np.random.Generator:
        return keyed_rng([self.seed, *key], is_fixed_length=True)

    def _in_order(self, tasks: list[Any], description: str) -> list[Any]:
        """Results in the order of the tasks; a result's ``name`` is the first argument of its task."""
        found = {result.name: result for result in run_tasks(tasks, self.jobs, description)}
        return [found[task.args[0]] for task in tasks]


def write(folder: Path, found: Measurements, report: list[Section]) -> None:
    """Write ``report.html``, ``numbers.json``, ``tables.md`` and the figures into a folder."""
    from experiments.reporting.page import write_page  # loads jinja2

    write_page(folder / "report.html", f"Calibration in the scene “{found.scene}”", report)
    write_text(folder / "numbers.json", json.dumps(asdict(found), indent=1, default=np.ndarray.tolist) + "\n")
    tables = [table.markdown() for section in report for table in section.tables]
    write_text(folder / "tables.md", "\n\n".join(tables) + "\n")
    for section in report:
        for picture in section.pictures:
            picture.write(folder)
