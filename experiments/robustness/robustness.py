"""``activetouch robustness``: live searches with a sensor outside the world that it was trained in.

The same objects are searched in the same episodes under every condition.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.named_scenes import NamedScene
from activetouch.scene import Scene
from activetouch.sensor import TactileSensor
from belief.constraints import Fraction
from belief.files import claim_folder, ends_claims
from belief.observation_model.doubted_sensor import DoubtedSensorModel
from belief.seeding import keyed_rng
from belief.statistics import wilson_interval
from belief.table import Table, Value, interval
from experiments.command_line.arguments import Cluster, Count, Jobs, OnCluster, Seed, check_arguments
from experiments.parallel import Shared, default_jobs, run_tasks
from experiments.report import Report, Reported, Section
from experiments.robustness.conditions import AS_TRAINED, Change, applicable_conditions
from experiments.scene_choice import SceneChoice, in_file_names
from experiments.search.comparison import compare
from experiments.search.summary import ALL
from experiments.sensor_choice import doubts, open_sensor

_DECIDER = "information_gain"
_PRESSES = 160  # of the same objects in every condition
_ABSTAIN = 0.02
_LEAST = 0.02  # share of images that a condition changes, below which it is said to change nothing


@dataclass(frozen=True)
class RobustnessReport(Reported):
    """Success and stated confidence of searches by condition, as ``numbers`` of JSON types; prints as a table."""

    numbers: Mapping[str, Any]

    def tables(self) -> list[Table]:
        """The table of the searches, and one of the conditions that do not apply, if there are any."""
        rows = self.numbers["conditions"]
        first = next(iter(rows.values()))
        is_selective = self.numbers.get("abstain") is not None
        headings = ["condition", ("changed", ".2f"), "success", "wrong", *["unsure"] * is_selective]
        headings += [("touches", ".2f"), ("stated", ".3f"), ("right", ".3f")]
        cells: list[list[Value]] = []
        for name, row in rows.items():
            ends = row["touches"], row["stated"], row["achieved"]
            success, wrong = interval(row["success"], *row["interval"]), interval(*row["wrong"])
            unsure = [interval(*row["unsure"])] if is_selective else []
            cells.append([name, row["changed"] / row["presses"], success, wrong, *unsure, *ends])
        gaps = {name: row["stated"] - row["achieved"] for name, row in rows.items() if row["stated"] is not None}
        notes = [
            f"Changed: images that differ by more than 1 of 255 levels, of {first['presses']} presses of the same "
            "objects. Stated and right: where an object is confirmed."
        ]
        if unlike := [name for name in list(rows)[1:] if rows[name]["changed"] < _LEAST * rows[name]["presses"]]:
            words = ", ".join(f"{name} ({rows[name]['changed']} of {rows[name]['presses']})" for name in unlike)
            notes.append(
                f"These conditions change hardly anything here, so their searches tell nothing about them: {words}."
            )
        if gaps:
            widest = max(gaps, key=lambda name: abs(gaps[name]))
            notes.append(f"Largest gap: {gaps[widest]:+.3f} ({widest}).")
        title = f"{self.numbers['scene']}: {first['number']} live searches by information gain in each condition"
        title += ", by a sensor that doubts its description" * self.numbers.get("doubts", False)
        found = [Table(title, headings, cells, " ".join(notes), "conditions")]
        if left_out := self.numbers["left_out"]:
            found.append(Table("left out", ("condition", ("because", "")), list(left_out.items()), name="left_out"))
        return found

    def report(self) -> Report:
        """The tables, and ``robustness.json`` with the numbers."""
        title = f"Changed worlds: the sensor of the scene “{self.numbers['scene']}”"
        files = {"robustness.json": json.dumps(self.numbers, indent=1) + "\n"}
        return Report(title, [Section("Searches", tables=self.tables())], markdown="robustness.md", files=files)


def robustness(
    sensor: TactileSensor,
    named: NamedScene,
    *,
    name: str = "scene",
    conditions: Sequence[str] | Mapping[str, Change] = (),
    searches: int = 25,
    seed: int = 0,
    abstain: float | None = None,
    jobs: int = 1,
) -> RobustnessReport:
    """Search among the same objects under changed conditions: names of ``conditions.CONDITIONS``, all by default.

    A mapping has conditions of your own: functions from a scene to the changed one, by name.

    There are so many ``searches`` for every target, by information gain, under every condition. ``abstain`` is as of
    :func:`activetouch.compare`.
    """
    scenes, left_out = applicable_conditions(named.scene, conditions)
    shared = Shared(scenes)
    images = dict(run_tasks([partial(press_paired, shared, seed, condition) for condition in scenes], jobs, "pressing"))
    found: dict[str, dict[str, Any]] = {}
    for condition, scene in scenes.items():
        changed, world = replace(sensor, scene=scene), replace(named, scene=scene)
        options: dict[str, Any] = {"seed": seed, "abstain": abstain, "anyway": True, "jobs": jobs}
        comparison = compare(world, [_DECIDER], episodes=searches, sensor=changed, **options)
        cell, stops = comparison.cells[_DECIDER, ALL], comparison.calibration[_DECIDER]
        pairs = zip(images[AS_TRAINED], images[condition], strict=True)
        found[condition] = {
            "changed": sum(bool((np.abs(one.astype(int) - other) > 1).any()) for one, other in pairs),
            "presses": _PRESSES,
            "number": cell.num_episodes,
            "success": cell.success,
            "interval": list(cell.success_interval),
            "touches": cell.touches,
            "wrong": [cell.wrong / cell.num_episodes, *wilson_interval(cell.wrong, cell.num_episodes)],
            "unsure": [cell.unsure / cell.num_episodes, *wilson_interval(cell.unsure, cell.num_episodes)],
            "stated": None if stops is None else stops.overall.mean_stated,
            "achieved": None if stops is None else stops.overall.share_right,
        }
    return RobustnessReport(
        {
            "scene": name,
            "seed": seed,
            "abstain": abstain,
            "doubts": isinstance(sensor.model, DoubtedSensorModel),
            "conditions": found,
            "left_out": left_out,
            "shift": list(sensor.shift),
        }
    )


def press_paired(scenes: Shared[dict[str, Scene]], seed: int, condition: str) -> tuple[str, list[NDArray[np.uint8]]]:
    """Name of a condition, and images of objects in its scene that differ from the usual objects by it alone."""
    trained, changed = scenes.value[AS_TRAINED], scenes.value[condition]
    images, labels = [], trained.shape_labels
    for number in range(_PRESSES):
        pose, label = number // len(labels) % len(trained.pose_labels), labels[number % len(labels)]
        usual, own = (scene.sample_object(label, keyed_rng([seed, number, 0])) for scene in (trained, changed))
        same = {name: getattr(usual, name) for name, of in _DRAWN.items() if of(trained, label) == of(changed, label)}
        rng, force_rng = (keyed_rng([seed, number, part]) for part in (1, 2))
        images.append(changed.press(replace(own, **same), pose, rng, force_rng).image)
    return condition, images


_DRAWN: Mapping[str, Callable[[Scene, str], object]] = {
    "scale": lambda scene, label: scene.variation.size,
    "friction": lambda scene, label: scene.variation.friction,
    "stiffness": lambda scene, label: scene.variation.stiffness,
    "orientation": lambda scene, label: scene.presentation,
    "member": lambda scene, label: scene.shapes[label],
}
"""Source of each attribute of an object; an attribute with an unchanged source is the usual object's."""


@dataclass(frozen=True)
class Robustness:
    """Search with a sensor under faults, among other objects and with other presses.

    Writes a page (report.html), tables (robustness.md) and robustness.json.

    For example:

        activetouch robustness --scene gel --searches 50
        activetouch robustness --scene coarse --conditions "noise × 2" "size ± 25 %"
        activetouch robustness --scene coarse --conditions "noise × 2" --as-described
    """

    scene: str = "gel"
    """The world that the sensor was trained in: paper, coarse, gel, hard, many or keyed; or module:attribute of your
    own scene."""
    sensor: Path | None = None
    """Folder from activetouch calibrate, or name of a shipped sensor; that of the scene by default."""
    conditions: tuple[str, ...] = ()
    """Conditions to measure, such as "noise × 2"; all by default."""
    searches: Count = 25
    """Number of live searches for every target, by information gain, under every condition."""
    seed: Seed = 0
    """Seed of the searches."""
    as_described: bool = False
    """Take the sensor, and the proportions of built-in solids, to be as described, and always answer. By default, as in
    live, a sensor that has both readers doubts them, and searches may end unsure."""
    unknown_state: bool = False
    """Infer the state of the sensor from the touches, as of compare."""
    doubted_state: bool = False
    """The same, but only where touches are odd, as of compare."""
    other_proportions: bool = False
    """Built-in solids may have other proportions, as of compare."""
    abstain: Fraction | None = None
    """False-alarm rate of the conflict test: searches can end with "I do not know". 0.02 by default, or none with
    --as-described."""
    out: Path | None = None
    """Folder for the results; runs/robustness-SCENE by default."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes; the results do not depend on it."""
    cluster: OnCluster = field(default_factory=Cluster)
    """Workers of other machines."""
    anyway: bool = False
    """Use the sensor in a scene that it was not made for, and take this scene as the training world."""

    @ends_claims
    def run(self) -> None:
        """Search, print and write."""
        check_arguments(self)
        choice = SceneChoice(self.scene)
        out = self.out if self.out is not None else Path(f"runs/robustness-{in_file_names(self.scene)}")
        claim_folder(out)
        options = doubts(self.as_described, self.unknown_state, self.doubted_state, self.other_proportions)
        sensor = open_sensor(self.sensor, choice, self.anyway, **options)
        found = robustness(
            sensor,
            choice.named,
            name=self.scene,
            conditions=self.conditions,
            searches=self.searches,
            seed=self.seed,
            abstain=_ABSTAIN if self.abstain is None and not self.as_described else self.abstain,
            jobs=self.jobs,
        )
        for table in found.tables():
            print(table, end="\n\n")
        print(f"wrote {found.save(out)}")
