"""``activetouch robustness``: accuracy and calibration of a sensor outside the world it was trained in.

The same objects are touched in every pose under many conditions, so differences to the training world are paired.
Touches of unknown shapes measure how well the conflict test distinguishes them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from activetouch.named_scenes import NamedScene
from activetouch.sensor import TactileSensor
from activetouch.shapes import EXTENDED_SHAPES
from belief.claims import claim_folder, ends_claims
from belief.files import write_text
from belief.metrics import expected_calibration_error, negative_log_likelihood
from belief.metrics.calibration_at_stop import Stops, stops
from belief.observation_model.model import ArrayModel
from belief.observation_model.selection import log_posteriors, log_posteriors_by_touch
from belief.statistics import clopper_pearson_interval, paired_bootstrap
from belief.table import Table
from experiments.command_line.arguments import BadArgument, CountOrNone, Jobs, Seed, Within, check_arguments
from experiments.parallel import default_jobs
from experiments.robustness.report import robustness_tables, write_robustness_page
from experiments.robustness.searches import CONFIDENCE, confidence_at_stops, search_scores
from experiments.robustness.strangers import alarms, e_values, stranger_scores
from experiments.robustness.touches import AS_TRAINED, ClassifierOutputs, applicable_conditions, measure_touches
from experiments.scene_choice import SceneChoice, in_file_names
from experiments.sensor.scores import accuracy_of_objects
from experiments.sensor_choice import open_sensor

_UNKNOWN = "unknown shapes"


@dataclass(frozen=True)
class RobustnessReport:
    """Accuracy and calibration of a sensor by condition; it prints as tables.

    Attributes:
        numbers: all figures, of JSON types.
    """

    numbers: Mapping[str, Any]

    def tables(self) -> list[Table]:
        """The tables of the report."""
        return robustness_tables(self.numbers)

    def __str__(self) -> str:
        return "\n\n".join(table.markdown() for table in self.tables())

    def save(self, folder: Path) -> None:
        """Write report.html, tables (robustness.md) and robustness.json into a folder.

        Raises:
            CannotWrite: the disk is full, or the folder cannot be written.
        """
        write_text(folder / "robustness.json", json.dumps(self.numbers, indent=1) + "\n")
        write_text(folder / "robustness.md", f"{self}\n")
        write_robustness_page(self.numbers, folder / "report.html")


def robustness(
    sensor: TactileSensor,
    named: NamedScene,
    *,
    name: str = "scene",
    conditions: Sequence[str] = (),
    objects: int = 100,
    searches: int = 0,
    abstain: float | None = None,
    seed: int = 0,
    jobs: int = 1,
) -> RobustnessReport:
    """Touch the same objects, and search among them, under changed conditions.

    Args:
        sensor: to measure.
        named: the scene that the sensor was trained in, and its search.
        name: of the scene.
        conditions: keys of :data:`~experiments.robustness.conditions.CONDITIONS`; all whose presses are fast by
            default.
        objects: of every shape, at least two; each is touched once in every pose, under every condition.
        searches: live searches for every target, by information gain.
        abstain: false-alarm rate of the conflict test, with which searches may end with "I do not know"; also if the
            stated confidence is below that of stops. They never do by default.
        seed: of the objects, their touches, the searches and the bootstrap.
        jobs: number of processes that press; the results do not depend on it.

    Raises:
        UnknownName: there is no such condition.
        UnstablePress: no object could be pressed under a condition.
    """
    scene = named.scene
    scenes, left_out = applicable_conditions(scene, conditions)
    novel = {label: shape for label, shape in EXTENDED_SHAPES.items() if label not in scene.shapes}
    touched = scenes | ({_UNKNOWN: replace(scene, shapes=novel)} if novel else {})
    if not novel:
        left_out[_UNKNOWN] = "the sensor was trained on all known shapes"
    outputs = measure_touches(sensor, touched, objects, seed, jobs)
    scores = {c: condition_scores(outputs[c], outputs[AS_TRAINED], sensor.model, seed) for c in scenes}
    unseen: dict[str, Any] = {}
    if novel:
        unseen = stranger_scores(outputs[AS_TRAINED], outputs[_UNKNOWN], sensor.model, tuple(novel), seed)
    if searches:
        for condition, found in search_scores(sensor, scenes, named, searches, seed, jobs, abstain).items():
            scores[condition]["models"][sensor.model.name]["searches"] = found
    return RobustnessReport(
        {
            "scene": name,
            "seed": seed,
            "objects_per_shape": objects,
            "num_poses": len(scene.poses),
            "chance": 1.0 / len(scene.shapes),
            "conditions": scores,
            "unseen": unseen,
            "left_out": left_out,
            "shift": list(sensor.shift),
        }
    )


@dataclass(frozen=True)
class Robustness:
    """Measure a sensor under faults, other objects, other presses and unknown shapes.

    Writes a page (report.html), tables (robustness.md) and robustness.json.

    For example:

        activetouch robustness --scene gel --objects 100
        activetouch robustness --scene coarse --searches 100
        activetouch robustness --scene coarse --conditions "noise × 2" "size ± 25 %"
    """

    scene: str = "gel"
    """The world that the sensor was trained in: paper, coarse, gel, hard, many or keyed; or module:attribute of your
    own scene."""
    sensor: Path | None = None
    """Folder from activetouch calibrate, or name of a shipped sensor; that of the scene by default."""
    objects: Annotated[int, Within(2, 10**8)] = 100
    """Number of objects of every shape, at least two; each is touched once in every pose, under every condition."""
    conditions: tuple[str, ...] = ()
    """Conditions to measure, such as "noise × 2"; all by default."""
    searches: CountOrNone = 0
    """Number of live searches for every target, by information gain, under every condition."""
    abstain: Annotated[float, Within(0.0, 1.0, open_low=True, open_high=True)] | None = None
    """False-alarm rate of the conflict test, such as 0.02, with which searches may end with "I do not know"; also if
    the stated confidence is below that of stops. They never do by default."""
    seed: Seed = 0
    """Seed of the objects, their touches, the searches and the bootstrap."""
    out: Path | None = None
    """Folder for the results; runs/robustness-SCENE by default."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes that press; the results do not depend on it."""
    anyway: bool = False
    """Use the sensor in a scene that it was not made for, and take this scene as the training world."""

    @ends_claims
    def run(self) -> None:
        """Touch, measure, print and write."""
        check_arguments(self)
        if self.abstain is not None and not self.searches:
            raise BadArgument("--abstain is for live searches; add --searches 25")
        choice = SceneChoice(self.scene)
        out = self.out if self.out is not None else Path(f"runs/robustness-{in_file_names(self.scene)}")
        claim_folder(out)
        sensor = open_sensor(self.sensor, choice, self.anyway)
        found = robustness(
            sensor,
            choice.named,
            name=self.scene,
            conditions=self.conditions,
            objects=self.objects,
            searches=self.searches,
            abstain=self.abstain,
            seed=self.seed,
            jobs=self.jobs,
        )
        for table in found.tables():
            print(table, end="\n\n")
        found.save(out)
        print(f"wrote {out / 'report.html'}")


def condition_scores(
    outputs: ClassifierOutputs, trained: ClassifierOutputs, model: ArrayModel, seed: int
) -> dict[str, Any]:
    """Accuracy and calibration in a condition, with 95 % intervals.

    Args:
        outputs: of the classifier in this condition.
        trained: of the classifier in the training world.
        model: observation model of the sensor.
        seed: of the bootstrap, and of the order of poses.

    Returns:
        ``num_objects`` touched; ``accuracy`` of single touches and its paired ``difference`` to the training world,
        with bootstrap intervals over objects; ``is_chance``: whether the interval contains chance; ``models``: by the
        name of the model, :func:`model_scores`.
    """
    (num_objects, _, num_shapes), rng = outputs.logits.shape, np.random.default_rng(seed)
    right, right_trained = ((f.logits.argmax(axis=2) == f.shapes[:, None]).mean(axis=1) for f in (outputs, trained))
    accuracy, *interval = accuracy_of_objects(right, outputs.numbers, rng)
    _, here, there = np.intersect1d(outputs.numbers, trained.numbers, return_indices=True)
    difference, *difference_interval = paired_bootstrap(right[here], right_trained[there], rng)
    return {
        "num_objects": num_objects,
        "accuracy": accuracy,
        "accuracy_interval": interval,
        "difference": difference,
        "difference_interval": difference_interval,
        "is_chance": interval[0] <= 1.0 / num_shapes <= interval[1],
        "models": {model.name: model_scores(outputs, model, seed)},
    }


def model_scores(outputs: ClassifierOutputs, model: ArrayModel, seed: int) -> dict[str, Any]:
    """Accuracy and calibration of an observation model in a condition.

    Args:
        outputs: of the classifier in this condition.
        model: the model.
        seed: of the order of poses, in which each object is touched until a shape has a posterior of
            :data:`CONFIDENCE`.

    Returns:
        ``nll`` and ``ece`` of single touches; ``fused_accuracy`` of all touches of an object, with its exact binomial
        interval; ``stops``: see :func:`stops_scores`; ``alarms``: fraction of objects for which the conflict test
        fires, with its interval, None for a model without a conflict test.
    """
    num_objects, num_poses, _ = outputs.logits.shape
    probs, labels = np.exp(log_posteriors(model, outputs.singles())), outputs.shapes.repeat(num_poses)
    by_number = log_posteriors_by_touch(model, outputs.shuffled(seed))
    num_right = int((by_number[:, -1].argmax(axis=1) == outputs.shapes).sum())
    tested = e_values(model, outputs.shuffled(seed))
    return {
        "nll": negative_log_likelihood(probs, labels),
        "ece": expected_calibration_error(probs, labels),
        "fused_accuracy": num_right / num_objects,
        "fused_interval": clopper_pearson_interval(num_right, num_objects),
        "stops": stops_scores(stops(by_number, outputs.shapes, CONFIDENCE), outputs.shapes, model.shape_labels),
        "alarms": None if tested is None else alarms(tested["conflict"]),
    }


def stops_scores(stopped: Stops, shapes: NDArray[np.int64], labels: Sequence[str]) -> dict[str, Any] | None:
    """What stops state and achieve; None without a stop.

    Args:
        stopped: the stops.
        shapes: true shape of every sequence, ``(S,)``.
        labels: of the shapes.

    Returns:
        Their ``number``, mean number of ``touches``, mean ``stated`` confidence, ``achieved`` accuracy with its
        ``interval``, and ``worst_shape``: the shape whose objects have the lowest accuracy, with this accuracy.
    """
    found = confidence_at_stops(stopped.claims, stopped.correct, stopped.num_touches)
    if found is None:
        return None
    here = shapes[stopped.sequences]
    right = {labels[k]: float(stopped.correct[here == k].mean()) for k in np.unique(here).tolist()}
    return found | {"worst_shape": min(right.items(), key=lambda item: item[1])}
