"""``activetouch robustness``: accuracy and calibration of a sensor outside the world it was trained in.

The same objects are touched in every pose under many conditions, so differences to the training world are paired. A
sensor with a joint observation model is compared with its own independent one. Touches of unseen shapes measure two
out-of-distribution scores by their AUROC.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch.sensor import TactileSensor
from activetouch.sensor_files import load_observation_model, observation_file
from activetouch.shapes import EXTENDED_SHAPES
from belief.claims import claim_folder, ends_claims
from belief.errors import UnknownName
from belief.files import write_text
from belief.metrics import expected_calibration_error, negative_log_likelihood
from belief.observation_model import ArrayModel
from belief.observation_model.selection import log_posteriors
from belief.out_of_distribution import MahalanobisScore, auroc_interval, energy_score
from belief.statistics import clopper_pearson_interval, paired_bootstrap
from experiments.calibration.sequences import Sequences, Stops, stops
from experiments.command_line.arguments import BadArgument, CountOrNone, Jobs, Seed, Within, check_arguments
from experiments.command_line.console import plain_console
from experiments.parallel import default_jobs
from experiments.robustness.conditions import CONDITIONS
from experiments.robustness.conflict import (
    AFTER,
    SO_FAR,
    alarms,
    log_e_values,
    stranger_scores,
    stream_scores,
    tested,
)
from experiments.robustness.kept import results_folder
from experiments.robustness.searches import CONFIDENCE, confidence_at_stops, search_scores
from experiments.robustness.shifted_touches import (
    AS_TRAINED,
    ClassifierOutputs,
    ShiftedScene,
    applicable_conditions,
    measure_touches,
)
from experiments.robustness.stranger_searches import stranger_searches
from experiments.scene_choice import SceneChoice, in_file_names
from experiments.sensor.scores import accuracy_of_objects
from experiments.sensor_choice import open_sensor, sensor_folder

INDEPENDENT_MODEL = "independent"
"""Name of the model that takes touches as independent given the shape, beside a joint one."""
_REFERENCE, _UNSEEN = "more known objects", "unseen shapes"


@dataclass(frozen=True)
class Robustness:
    """Measure a sensor under faults, other objects, other presses and unseen shapes.

    A sensor whose observation model is about one rigid body is measured beside its model that takes touches as
    independent. Writes robustness.json, tables (robustness.md) and a figure (robustness.svg and .png). Finished
    searches are kept: after an interruption, the same command plays those that are missing.

    For example:

        activetouch robustness --scene gel --objects 100
        activetouch robustness --scene coarse --searches 100
        activetouch robustness --scene coarse --conditions "noise × 2" "size ± 25 %"
        activetouch robustness --scene coarse --sensor runs/sensor-coarse
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world that the sensor was trained in."""
    sensor: Path | None = None
    """Folder from activetouch calibrate, or name of a shipped sensor; that of the scene by default."""
    objects: Annotated[int, Within(2, 10**8)] = 100
    """Number of objects of every shape, at least two; each is touched once in every pose, under every condition."""
    conditions: tuple[str, ...] = ()
    """Conditions to measure, such as "noise × 2"; all by default."""
    searches: CountOrNone = 0
    """Number of live searches for every target, by information gain with each observation model, under every
    condition, and among objects of unseen shapes."""
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
        from experiments.robustness.report import draw_conditions, robustness_tables  # loads matplotlib

        scene, name = self.choice.named.scene, self.choice.scene
        out = self.out if self.out is not None else Path(f"runs/robustness-{in_file_names(name)}")
        claim_folder(out)
        sensor = open_sensor(self.sensor, self.choice, self.anyway)
        shifted, left_out = applicable_conditions(scene, self.objects)
        for condition in self.conditions:
            if condition not in CONDITIONS:
                raise UnknownName("condition", condition, list(CONDITIONS))
        if self.conditions:
            kept = (AS_TRAINED, *self.conditions)
            shifted = {condition: some for condition, some in shifted.items() if condition in kept}
            left_out = {condition: why for condition, why in left_out.items() if condition in kept}
        conditions, novel = list(shifted), {k: v for k, v in EXTENDED_SHAPES.items() if k not in scene.shapes}
        if novel:
            shifted[_REFERENCE] = ShiftedScene(scene, self.objects, stream=1)
            shifted[_UNSEEN] = ShiftedScene(replace(scene, shapes=novel), self.objects)
        else:
            left_out[_UNSEEN] = "the sensor was trained on all known shapes"
        models = self._models(sensor)
        outputs = measure_touches(sensor, shifted, self.seed, self.jobs)
        trained = outputs[AS_TRAINED]
        scores = {c: condition_scores(outputs[c], trained, models, self.seed) for c in conditions}
        folder = sensor_folder(self.sensor, name)
        done = results_folder(out, sorted(path for path in folder.iterdir() if path.is_file()))
        if self.searches:
            scenes = {name: some.scene for name, some in shifted.items() if name in scores}
            searched = search_scores(
                sensor, models, scenes, self.choice.named, self.searches, self.seed, self.jobs, self.abstain, done
            )
            for (condition, model), found in searched.items():
                scores[condition]["models"][model]["searches"] = found
        unseen: dict[str, Any] = {}
        among_strangers: dict[str, Any] = {}
        if novel:
            unseen = out_of_distribution(outputs[_REFERENCE], trained, outputs[_UNSEEN], sensor.model, tuple(novel))
            if self.searches and sensor.model.start().log_bets is not None:
                among_strangers = stranger_searches(
                    sensor, self.choice.named, self.searches, self.seed, self.jobs, done
                )
        numbers = {
            "scene": name,
            "seed": self.seed,
            "objects_per_shape": self.objects,
            "num_poses": len(scene.poses),
            "chance": 1.0 / len(scene.shapes),
            "conditions": scores,
            "unseen": unseen,
            "among_strangers": among_strangers,
            "left_out": left_out,
            "shift": list(sensor.shift),
        }
        tables = robustness_tables(numbers)
        for table in tables:
            plain_console().print(table.rich())
        write_text(out / "robustness.json", json.dumps(numbers, indent=1) + "\n")
        write_text(out / "robustness.md", "\n\n".join(table.markdown() for table in tables) + "\n")
        draw_conditions(numbers, out / "robustness.svg", out / "robustness.png")
        print(f"wrote {out}")

    def _models(self, sensor: TactileSensor) -> dict[str, ArrayModel]:
        """The sensor's observation model, and the independent one beside a joint one, by name."""
        folder = sensor_folder(self.sensor, self.choice.scene)
        models: dict[str, ArrayModel] = {sensor.model.name: sensor.model}
        if observation_file(folder, independent=True) != observation_file(folder):
            models[INDEPENDENT_MODEL] = load_observation_model(folder, independent=True)
        return models


def condition_scores(
    outputs: ClassifierOutputs, trained: ClassifierOutputs, models: Mapping[str, ArrayModel], seed: int
) -> dict[str, Any]:
    """Accuracy and calibration in a condition, with 95 % intervals.

    Args:
        outputs: of the classifier in this condition.
        trained: of the classifier in the training world.
        models: observation models by name, the sensor's own first.
        seed: of the bootstrap, and of the order of poses.

    Returns:
        ``num_objects`` touched; ``accuracy`` of single touches and its paired ``difference`` to the training world,
        with bootstrap intervals over objects; ``is_chance``: whether the interval contains chance; ``models``: by name
        of the model, :func:`model_scores`.
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
        "models": {name: model_scores(outputs, model, seed) for name, model in models.items()},
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
        interval; ``stops``: see :func:`stops_scores`; ``conflict``:
        :func:`~experiments.robustness.conflict.stream_scores`, None for a model without a conflict test.
    """
    num_objects, num_poses, _ = outputs.logits.shape
    probs, labels = np.exp(log_posteriors(model, outputs.singles())), outputs.shapes.repeat(num_poses)
    poses = np.tile(np.arange(num_poses), (num_objects, 1))
    touches = Sequences(
        outputs.sequences(np.random.default_rng(seed).permuted(poses, axis=1)), outputs.shapes, outputs.numbers
    )
    by_number = touches.log_posteriors(model)
    num_found = int((by_number[:, -1].argmax(axis=1) == outputs.shapes).sum())
    stopped = stops(by_number, outputs.shapes, CONFIDENCE)
    found = tested(model, touches.batch)
    return {
        "nll": negative_log_likelihood(probs, labels),
        "ece": expected_calibration_error(probs, labels),
        "fused_accuracy": num_found / num_objects,
        "fused_interval": clopper_pearson_interval(num_found, num_objects),
        "stops": stops_scores(stopped, outputs.shapes, model.shape_labels),
        "conflict": None if found is None else stream_scores(found[0], stopped, seed),
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


def out_of_distribution(
    fit: ClassifierOutputs,
    known: ClassifierOutputs,
    novel: ClassifierOutputs,
    model: ArrayModel,
    novel_labels: tuple[str, ...],
) -> dict[str, dict[str, Any]]:
    """How well two scores separate unseen from known shapes, for each unseen shape and for all together.

    Args:
        fit: outputs for known shapes that the Mahalanobis score is fitted to.
        known: outputs for other objects of known shapes.
        novel: outputs for objects of unseen shapes.
        model: gives the calibrated confidence of one touch.
        novel_labels: names of the unseen shapes.

    Returns:
        Per shape ``num_objects``; ``auroc`` by score, of touches and of means over an object's touches, each with its
        95 % interval; ``after``: by number of touches, AUROC of objects by score, those of :data:`SO_FAR` for a
        model with a conflict test only, and the fraction of known objects and of strangers for which the test fires as
        ``false_alarms`` and ``alarms``; ``taken_for``, the most frequently predicted known shape, and its ``share``;
        ``confidence``, the mean calibrated probability of the predicted shapes.
    """
    mahalanobis = MahalanobisScore.fit(np.concatenate(fit.features), fit.shapes.repeat(fit.features.shape[1]))
    scores = {
        "energy": [energy_score(outputs.logits) for outputs in (known, novel)],
        "mahalanobis": [
            mahalanobis.score(np.concatenate(outputs.features)).reshape(outputs.features.shape[:2])
            for outputs in (known, novel)
        ],
    }
    num_poses, tests = known.logits.shape[1], {}
    for place, outputs in enumerate((known, novel)):
        order = np.tile(np.arange(num_poses), (len(outputs.shapes), 1))
        found = tested(model, outputs.sequences(np.random.default_rng(place).permuted(order, axis=1)))
        if found is not None:
            tests[place] = log_e_values(found[0])
            for name, score in zip(SO_FAR, (tests[place], found[1]), strict=True):
                scores.setdefault(name, []).append(score)
    counts_of_touches = [number for number in AFTER if number <= num_poses]
    taken = novel.logits.argmax(axis=2)
    confidence = np.exp(log_posteriors(model, novel.singles())).max(axis=1).reshape(taken.shape)
    every = {label: novel.shapes == k for k, label in enumerate(novel_labels)} | {"all": novel.shapes >= 0}
    results = {}
    for label, rows in every.items():
        counts = np.bincount(taken[rows].ravel(), minlength=len(model.shape_labels))
        results[label] = {
            "num_objects": int(rows.sum()),
            "auroc": {
                name: {
                    "touch": auroc_interval(old, new[rows]),
                    "object": auroc_interval(old.mean(axis=1), new[rows].mean(axis=1)),
                }
                for name, (old, new) in scores.items()
                if name not in SO_FAR
            },
            "after": {
                str(number): {
                    "auroc": stranger_scores(
                        {name: old for name, (old, _) in scores.items()},
                        {name: new[rows] for name, (_, new) in scores.items()},
                        number,
                    ),
                    "false_alarms": alarms(tests[0], number) if tests else None,
                    "alarms": alarms(tests[1][rows], number) if tests else None,
                }
                for number in counts_of_touches
            },
            "taken_for": model.shape_labels[int(counts.argmax())],
            "share": float(counts.max() / counts.sum()),
            "confidence": float(confidence[rows].mean()),
        }
    return results
