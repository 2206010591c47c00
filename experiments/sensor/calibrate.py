"""``activetouch calibrate``: select and fit the observation model, rank poses, evaluate on held-out objects."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.data.dataset import TouchSet, read_split
from activetouch.data.manifest import Manifest, read_manifest
from activetouch.perception.reader import HypothesisTable, TactileReader
from activetouch.scene import Scene
from activetouch.scene_description import in_words
from activetouch.sensor_files import INDEPENDENT_FILE, OBSERVATION_FILE, READER_FILE
from belief.calibration import TemperatureScaling
from belief.errors import ActiveTouchError
from belief.files import claim_folder, ends_claims, write_text
from belief.metrics import confusion_matrix, expected_calibration_error, negative_log_likelihood, shape_scores
from belief.observation_model.model import ArrayModel
from belief.observation_model.registry import Fit, class_named, fit_named, fits
from belief.observation_model.selection import NUM_FOLDS, ModelChoice, choose_observation_model, log_posteriors
from belief.statistics import clopper_pearson_interval
from belief.table import Table, Tabular
from belief.touch_batch import TouchBatch
from belief.validation import Floats
from experiments.command_line.arguments import BadArgument, Seed, Trust, check_arguments
from experiments.scene_choice import SceneChoice, command, in_file_names, named_scene, repeats_folder, training_folder
from experiments.sensor.scores import accuracy_of_objects, read_touches
from experiments.sensor_choice import NoSensor, open_collection, require_collection
from planners.probing import greedy_order, write_order

_RANKED, _ORDERED = 120, 16  # calibration objects that rank poses, and largest number of poses in the order


@dataclass(frozen=True)
class Calibrate:
    """Fit observation models to held-out objects, keep the best one, and evaluate the sensor on other objects.

    The collection should touch its objects several times in every pose (collect --plan.repeats 6): how far touches
    repeat each other can be learned from nothing else. Cross-validation on the calibration split selects the model.
    Writes the reader, the observation model, evaluation.json and the best fixed order of poses (for the decider
    best_order) into one folder that the other commands use. If the chosen model is about one rigid body, the best model
    that takes touches as independent is kept beside it.

    For example:

        activetouch collect --scene gel --plan.train 0 --plan.repeats 6 --out data/gel-repeats
        activetouch calibrate --scene gel
        activetouch calibrate --data data/mug --reader runs/train-mug/reader.safetensors --out runs/sensor-mug
        activetouch calibrate --scene hard --observation-model "rigid body"
    """

    scene: str = "gel"
    """Name of the scene, which gives the defaults of the next three."""
    reader: Path | None = None
    """From activetouch train, or a sensor's; runs/train-SCENE/reader.safetensors by default."""
    data: Path | None = None
    """Folder of the collection; data/SCENE-repeats by default."""
    out: Path | None = None
    """Folder of the finished sensor; runs/sensor-SCENE by default."""
    observation_model: tuple[str, ...] = ()
    """Choose from these observation models; from all by default."""
    seed: Seed = 0
    """Seed of the bootstrap intervals."""
    anyway: bool = False
    """Use a collection of another scene than the reader's."""
    trust: bool = False
    """Run code of your own that the collection names beside --scene, such as a renderer module:attribute."""

    @ends_claims
    def run(self) -> None:
        """Choose, fit, write, and print the evaluation."""
        check_arguments(self)
        named_scene(self.scene)  # raises for an unknown name
        data = self.data if self.data is not None else repeats_folder(self.scene)
        out = self.out if self.out is not None else Path(f"runs/sensor-{in_file_names(self.scene)}")
        models = {name: fit_named(name) for name in self.observation_model}
        claim_folder(out)
        trained = self.reader if self.reader is not None else training_folder(self.scene) / READER_FILE
        manifest = open_collection(data, self.scene, repeats=True)
        if self.reader is None and not trained.exists():
            raise NoSensor(f"{trained} is missing; train it with: {command('train', scene=self.scene)}")
        reader = TactileReader.load(trained)
        filed = self.scene if self.out is None else None
        require_collection(data, manifest, reader.card, filed, anyway=self.anyway)
        require_enough(manifest, data)
        scene = scene_of(manifest, Trust(data, [self.scene], self.trust))
        found = calibrate(reader, data, scene, models, self.seed)
        found.save(out)
        print(found)
        if manifest.plan.repeats == 1:
            print(
                "No object was touched twice in a pose, so how far touches repeat each other is an assumption. To "
                "measure it, record several rounds: collect --plan.repeats 6"
            )
        print(f"wrote {out}")


@dataclass(frozen=True, eq=False)
class Calibration(Tabular):
    """A reader with its observation model, and how good both are on objects that neither was fitted to.

    Attributes:
        choice: observation model with the cross-validated losses of all candidates.
        independent: best model that takes touches as independent, beside a joint model; None for any other.
        order: labels of the poses in the best fixed order, each with the NLL of the shape after it [nats].
        evaluation: figures of test objects, as in ``evaluation.json``.
    """

    reader: TactileReader
    choice: ModelChoice
    independent: ArrayModel | None
    order: Mapping[str, float]
    evaluation: Mapping[str, Any]
    scene: Mapping[str, Any]

    def save(self, folder: Path) -> None:
        """Write a sensor, which :meth:`activetouch.TactileSensor.load` reads."""
        self.reader.save(folder / READER_FILE)
        write_text(folder / OBSERVATION_FILE, self.choice.model.to_json({"scene": self.scene}) + "\n")
        if self.independent is not None:
            write_text(folder / INDEPENDENT_FILE, self.independent.to_json({"scene": self.scene}) + "\n")
        else:
            (folder / INDEPENDENT_FILE).unlink(missing_ok=True)
        write_order(folder, list(self.order), np.array(list(self.order.values())))
        write_text(folder / "evaluation.json", json.dumps(self.evaluation, indent=1) + "\n")

    def table(self) -> Table:
        """Accuracy and calibration of single touches and fused ones; ``evaluation.json`` has all confusions."""
        e = self.evaluation
        losses = ", ".join(
            f"{name} {loss:.4f}" for name, loss in sorted(self.choice.losses.items(), key=lambda p: p[1])
        )
        chosen = f" (cross-validated sequence NLL: {losses})" if losses else ""
        order = ", ".join(f"{label} {loss:.4f}" for label, loss in self.order.items())
        return Table(
            f"{e['num_touches']} test touches of {e['num_objects']} unseen objects",
            ["touches", ("accuracy", ".4f"), ("95 %", ".4f"), ("NLL", ".4f"), ("ECE", ".4f")],
            [
                ("one, as read", e["accuracy"], tuple(e["accuracy_interval"]), e["nll_raw"], e["ece_raw"]),
                ("one, calibrated", None, None, e["nll_calibrated"], e["ece_calibrated"]),
                (
                    "the first in every pose, fused",
                    e["fused_accuracy"],
                    tuple(e["fused_accuracy_interval"]),
                    e["fused_nll"],
                    e["fused_ece"],
                ),
            ],
            f"Observation model: {self.choice.name}{chosen}. Best order of poses, with the NLL after each on the "
            f"objects by which they are ranked: {order}. {self.choice.at_stops}".rstrip(),
        )


def calibrate(
    reader: TactileReader,
    data: Path,
    scene: Scene | None = None,
    models: Mapping[str, Fit] = MappingProxyType({}),
    seed: int = 0,
) -> Calibration:
    """Fit observation models to the calibration split of a collection, keep the best, and evaluate on the test split.

    Objects are better touched several times in every pose. Without a ``scene``, no model is about one rigid body.
    """
    manifest = read_manifest(data)
    candidates = candidate_models(models, reader, scene)
    calibration, test = read_split(data, "calibration"), read_split(data, "test")
    known = read_touches(reader, calibration, "reading calibration touches")
    tested = read_touches(reader, test, "reading test touches")
    print("fitting the observation model …")
    touches = (known.sequence(0), calibration.shapes, calibration.object_ids)
    labels: dict[str, Any] = {"shape_labels": manifest.shape_labels, "num_poses": len(manifest.pose_labels)}
    if len(candidates) == 1:  # nothing to choose from
        ((name, fit),) = candidates.items()
        choice = ModelChoice(name, fit(*touches, **labels), {})
    else:
        choice = choose_observation_model(*touches, **labels, candidates=candidates)
    class_named(choice.model.name)  # raises for a model that no command could read
    others = {name: loss for name, loss in choice.losses.items() if name not in fits("embeddings")}
    leaner = min(others, key=others.__getitem__) if choice.model.reads == "embeddings" and others else None
    independent = candidates[leaner](*touches, **labels) if leaner is not None else None
    evaluation = {
        "observation_model": choice.name,
        "cross_validated_nll": dict(choice.losses),
        "rounds": manifest.plan.repeats,
        **evaluate(choice.model, tested, test, np.random.default_rng(seed)),
    }
    rounds = known.reshaped((len(np.unique(calibration.object_ids)), -1))
    poses, losses = best_order(choice.model, rounds, calibration.shapes[:: rounds.num_touches])
    order = {manifest.pose_labels[pose]: float(loss) for pose, loss in zip(poses, losses, strict=True)}
    return Calibration(reader, choice, independent, order, evaluation, manifest.scene)


def best_order(model: ArrayModel, rounds: TouchBatch, shapes: NDArray[np.int64]) -> tuple[tuple[int, ...], Floats]:
    """The best fixed order of poses on calibration objects, and the NLL of the shape after each of its touches [nats].

    Greedy: each pose leaves the lowest NLL. The model was fitted to these objects, so the NLL is lower than on others.
    The first touches in ``rounds`` are one in every pose, in order.
    """
    batch, truth = rounds.sequences(np.arange(min(_RANKED, len(shapes)))), shapes[:_RANKED]

    def loss(poses: tuple[int, ...]) -> float:
        found = log_posteriors(model, batch.take((slice(None), list(poses))))
        return -float(found[np.arange(len(truth)), truth].mean())

    return greedy_order(model.num_poses, min(_ORDERED, model.num_poses), loss)


def scene_of(manifest: Manifest, trust: Trust) -> Scene | None:
    """The scene of a collection that the command line chose; None where a program did."""
    return None if manifest.choice is None else SceneChoice.from_dict(manifest.choice, trust).named.scene


def candidate_models(asked: Mapping[str, Fit], reader: TactileReader, scene: Scene | None) -> Mapping[str, Fit]:
    """The models asked for, or all that the reader and the scene allow: joint ones need embedded hypotheses."""
    all_joint = fits("embeddings")
    joint = {name: fit for name, fit in (asked or all_joint).items() if name in all_joint}
    others = {name: fit for name, fit in (asked or fits()).items() if name not in all_joint}
    if not joint or reader.hypotheses is None or scene is None:
        if asked and joint:
            raise BadArgument(
                f"{in_words(list(joint))} needs a reader of a named scene, trained with --recipe contrast"
            )
        return others
    table = HypothesisTable(reader, scene)
    embed = table if table.groups else cache(table)  # that of many poses remembers
    return {**others, **{name: partial(fit, embed=embed) for name, fit in joint.items()}}


class TooFewObjects(ActiveTouchError, ValueError):
    """A collection has too few objects to choose a model by cross-validation."""


def require_enough(manifest: Manifest, data: Path) -> None:
    """Refuse a collection with which no model can be chosen, before any image is read."""
    plan, num_shapes = manifest.plan, len(manifest.shape_labels)
    if num_shapes < 2:
        raise TooFewObjects(f"{data} has objects of one shape, {manifest.shape_labels[0]}; a sensor tells shapes apart")
    least = max(2, math.ceil(NUM_FOLDS / num_shapes))
    if plan.calibration < least or plan.test < 1:
        raise TooFewObjects(
            f"{data} has {plan.calibration} calibration objects and {plan.test} test objects of every shape; choosing "
            f"the observation model takes at least {least} and 1, and a few hundred make it a good one. Record "
            "more, in another folder"
        )


def evaluate(model: ArrayModel, touches: TouchBatch, truth: TouchSet, rng: np.random.Generator) -> dict[str, Any]:
    """Scores of single touches, with intervals over objects, and of an object's first round of poses fused."""
    logits = touches.require_logits()[0]
    num_objects, num_poses = len(np.unique(truth.object_ids)), model.num_poses
    raw = TemperatureScaling(1.0, "ok").predict_proba(logits)
    calibrated = np.exp(log_posteriors(model, touches.reshaped((-1, 1))))
    right, low, high = accuracy_of_objects(logits.argmax(axis=1) == truth.shapes, truth.object_ids, rng)
    fused = np.exp(log_posteriors(model, touches.reshaped((num_objects, -1)).first(num_poses)))
    object_shapes = truth.shapes.reshape(num_objects, -1)[:, 0]
    fused_right = int((fused.argmax(axis=1) == object_shapes).sum())
    confusion = confusion_matrix(raw, truth.shapes)
    return {
        "num_touches": len(logits),
        "num_objects": num_objects,
        "accuracy": right,
        "accuracy_interval": (low, high),
        "shapes": {k: asdict(v) for k, v in zip(model.shape_labels, shape_scores(confusion), strict=True)},
        "confusion": confusion.tolist(),
        "nll_raw": negative_log_likelihood(raw, truth.shapes),
        "nll_calibrated": negative_log_likelihood(calibrated, truth.shapes),
        "ece_raw": expected_calibration_error(raw, truth.shapes),
        "ece_calibrated": expected_calibration_error(calibrated, truth.shapes),
        "fused_accuracy": fused_right / num_objects,
        "fused_accuracy_interval": clopper_pearson_interval(fused_right, num_objects),
        "fused_nll": negative_log_likelihood(fused, object_shapes),
        "fused_ece": expected_calibration_error(fused, object_shapes),
    }
