"""``activetouch robustness``: live searches with a sensor outside the world that it was trained in.

The same objects are searched in the same episodes under every condition.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from activetouch.named_scenes import NamedScene
from activetouch.sensor import TactileSensor
from belief.claims import claim_folder, ends_claims
from belief.files import write_text
from belief.statistics import wilson_interval
from belief.table import Table, Value, interval
from experiments.command_line.arguments import Count, Jobs, Seed, check_arguments
from experiments.parallel import default_jobs
from experiments.robustness.conditions import applicable_conditions
from experiments.scene_choice import SceneChoice, in_file_names
from experiments.search.comparison import compare
from experiments.search.summary import ALL
from experiments.sensor_choice import open_sensor

_DECIDER = "information_gain"


@dataclass(frozen=True)
class RobustnessReport:
    """Success and stated confidence of searches by condition; it prints as a table.

    Attributes:
        numbers: all figures, of JSON types.
    """

    numbers: Mapping[str, Any]

    def tables(self) -> list[Table]:
        """The table of the searches, and that of the conditions that do not apply, if there are some."""
        rows = self.numbers["conditions"]
        first = next(iter(rows.values()))
        headings = ["condition", "success", "wrong", ("touches", ".2f"), ("stated", ".3f"), ("right", ".3f")]
        cells: list[list[Value]] = []
        for name, row in rows.items():
            ends = row["touches"], row["stated"], row["achieved"]
            cells.append([name, interval(row["success"], *row["interval"]), interval(*row["wrong"]), *ends])
        gaps = {name: row["stated"] - row["achieved"] for name, row in rows.items() if row["stated"] is not None}
        notes = ["Stated and right: where an object is confirmed."]
        if gaps:
            widest = max(gaps, key=lambda name: abs(gaps[name]))
            notes.append(f"Largest gap: {gaps[widest]:+.3f} ({widest}).")
        title = f"{self.numbers['scene']}: {first['number']} live searches by information gain in each condition"
        found = [Table(title, headings, cells, " ".join(notes))]
        if left_out := self.numbers["left_out"]:
            found.append(Table("left out", ("condition", ("because", "")), list(left_out.items())))
        return found

    def __str__(self) -> str:
        return "\n\n".join(table.markdown() for table in self.tables())

    def save(self, folder: Path) -> None:
        """Write report.html, tables (robustness.md) and robustness.json into a folder.

        Raises:
            CannotWrite: the disk is full, or the folder cannot be written.
        """
        from experiments.reporting.page import Section, write_page

        write_text(folder / "robustness.json", json.dumps(self.numbers, indent=1) + "\n")
        write_text(folder / "robustness.md", f"{self}\n")
        title = f"Changed worlds: the sensor of the scene “{self.numbers['scene']}”"
        write_page(folder / "report.html", title, [Section("Searches", tables=self.tables())])


def robustness(
    sensor: TactileSensor,
    named: NamedScene,
    *,
    name: str = "scene",
    conditions: Sequence[str] = (),
    searches: int = 25,
    seed: int = 0,
    jobs: int = 1,
) -> RobustnessReport:
    """Search among the same objects under changed conditions.

    Args:
        sensor: to measure.
        named: the scene that the sensor was trained in, and its search.
        name: of the scene.
        conditions: keys of :data:`~experiments.robustness.conditions.CONDITIONS`; all by default.
        searches: for every target, by information gain, under every condition.
        seed: of the searches.
        jobs: number of processes; the results do not depend on it.

    Raises:
        UnknownName: there is no such condition.
        UnstablePress: an object could not be pressed.
    """
    scenes, left_out = applicable_conditions(named.scene, conditions)
    found: dict[str, dict[str, Any]] = {}
    for condition, scene in scenes.items():
        changed, world = replace(sensor, scene=scene), replace(named, scene=scene)
        comparison = compare(world, [_DECIDER], episodes=searches, seed=seed, sensor=changed, anyway=True, jobs=jobs)
        cell, stops = comparison.cells[_DECIDER, ALL], comparison.calibration[_DECIDER]
        found[condition] = {
            "number": cell.num_episodes,
            "success": cell.success,
            "interval": list(cell.success_interval),
            "touches": cell.touches,
            "wrong": [cell.wrong / cell.num_episodes, *wilson_interval(cell.wrong, cell.num_episodes)],
            "stated": None if stops is None else stops.overall.mean_stated,
            "achieved": None if stops is None else stops.overall.share_right,
        }
    return RobustnessReport(
        {"scene": name, "seed": seed, "conditions": found, "left_out": left_out, "shift": list(sensor.shift)}
    )


@dataclass(frozen=True)
class Robustness:
    """Search with a sensor under faults, among other objects and with other presses.

    Writes a page (report.html), tables (robustness.md) and robustness.json.

    For example:

        activetouch robustness --scene gel --searches 50
        activetouch robustness --scene coarse --conditions "noise × 2" "size ± 25 %"
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
    out: Path | None = None
    """Folder for the results; runs/robustness-SCENE by default."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes; the results do not depend on it."""
    anyway: bool = False
    """Use the sensor in a scene that it was not made for, and take this scene as the training world."""

    @ends_claims
    def run(self) -> None:
        """Search, print and write."""
        check_arguments(self)
        choice = SceneChoice(self.scene)
        out = self.out if self.out is not None else Path(f"runs/robustness-{in_file_names(self.scene)}")
        claim_folder(out)
        sensor = open_sensor(self.sensor, choice, self.anyway)
        found = robustness(
            sensor,
            choice.named,
            name=self.scene,
            conditions=self.conditions,
            searches=self.searches,
            seed=self.seed,
            jobs=self.jobs,
        )
        for table in found.tables():
            print(table, end="\n\n")
        found.save(out)
        print(f"wrote {out / 'report.html'}")
