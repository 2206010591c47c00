"""``activetouch identify``: which of the bodies in a folder of meshes is it? Nothing is trained for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from activetouch.solids.solid import Shape
from belief.claims import claim_folder, ends_claims
from belief.naming import index_of
from belief.statistics import wilson_interval
from experiments.command_line.arguments import Count, Jobs, Positive, Seed, Share, check_arguments
from experiments.command_line.console import plain_console
from experiments.meshes.naming import Naming, Rule, name_object
from experiments.meshes.near_twins import NearTwins, near_twins
from experiments.meshes.setting import MeshSetting, cost_words, read_folder
from experiments.parallel import Shared, default_jobs, run_tasks
from experiments.reporting.page import Section, write_page
from experiments.reporting.tables import Table

COSTS = (10, 100, 1000)
"""Numbers of bodies whose cost is told before anything is computed."""
THRESHOLDS = (0.9, 0.95)


@dataclass(frozen=True, eq=False)
class Identified:
    """Simulated objects, and how they were named. It prints as its table.

    Attributes:
        setting: bodies and sensor.
        namings: of the objects.
        twins: bodies that feel nearly alike.
    """

    setting: MeshSetting
    namings: Sequence[Naming]
    twins: Sequence[NearTwins]

    def rows(self) -> list[dict[str, Any]]:
        """One row for each object: its body, the named one, the stated probability, and touches to 0.9 and 0.95."""
        labels = self.setting.bodies.labels
        return [
            {
                "body": labels[one.truth],
                "named": labels[one.named],
                "right": one.named == one.truth,
                "stated": one.stated,
                "touches": len(one.poses),
                **{f"touches to {threshold}": one.touches_to(threshold) for threshold in THRESHOLDS},
                "directions": " ".join(self.setting.scene.pose_labels[pose] for pose in one.poses),
            }
            for one in self.namings
        ]

    def table(self) -> Table:
        """The rows, and how many are right."""
        rows = self.rows()
        right = sum(row["right"] for row in rows)
        low, high = wilson_interval(right, len(rows))
        columns = ["body", ("named", ""), ("stated", ".3f"), ("touches", "d"), *((f"to {t}", "d") for t in THRESHOLDS)]
        names = ("body", "named", "stated", "touches", *(f"touches to {t}" for t in THRESHOLDS))
        stated = np.mean([row["stated"] for row in rows])
        return Table(
            f"objects among {len(self.setting.bodies.labels)} bodies",
            columns,
            [tuple(row[name] for name in names) for row in rows],
            f"{right} of {len(rows)} named rightly, {low:.2f} to {high:.2f}; stated {stated:.2f} in the mean.",
            "objects",
        )

    def __str__(self) -> str:
        return "\n\n".join([*map(str, self.twins), self.table().markdown()])

    def save(self, folder: Path | str) -> Path:
        """Write ``report.html``, with the bodies that were still possible after each touch, and ``objects.csv``.

        Raises:
            CannotWrite: the disk is full, or the folder is not writable.
        """
        from experiments.meshes.figures import possible_pictures

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        table = self.table()
        table.write_csv(folder / "objects.csv")
        alike = [str(twin) + "." for twin in self.twins] or ["No two bodies feel nearly alike."]
        sections = [
            Section("Objects", [], [table]),
            Section("Bodies that feel alike", alike),
            *possible_pictures(self.setting, self.namings),
        ]
        write_page(folder / "report.html", "Which body is it?", sections)
        return folder / "report.html"


def identify(
    bodies: Path | str | Sequence[Path | str] | Mapping[str, Shape],
    *,
    body: str | None = None,
    num_objects: int = 20,
    rule: Rule = "information gain",
    threshold: float = 0.95,
    max_touches: int = 16,
    seed: int = 0,
    scale: float | None = None,
    jobs: int | None = None,
    **setting: Any,
) -> Identified:
    """Press simulated objects of some bodies, and name each by touch.

    Args:
        bodies: a folder of mesh files, mesh files, or solids by label.
        body: label of the objects' body; random bodies by default.
        num_objects: number of objects.
        rule: how directions are chosen.
        threshold: probability at which to stop touching an object.
        max_touches: of an object, at most 26.
        seed: of objects and touches.
        scale: metres per unit of mesh files without a scale of their own.
        jobs: number of processes; as many as processors by default.
        setting: further arguments of :meth:`MeshSetting.of`, such as ``sensor`` and ``plan``.

    Raises:
        UnknownName: there is no such body.
        InvalidArgument: no mesh can be read, or the sensor has no reader of any object.
    """
    solids = dict(bodies) if isinstance(bodies, Mapping) else read_folder(bodies, scale)[0]
    chosen = None if body is None else index_of("body", tuple(solids), body)
    made = MeshSetting.of(solids, jobs=jobs, **setting)
    return Identified(
        made, name_all(made, num_objects, chosen, rule, threshold, max_touches, seed, jobs), near_twins(made)
    )


def name_all(
    setting: MeshSetting,
    num_objects: int,
    body: int | None,
    rule: Rule,
    threshold: float,
    max_touches: int,
    seed: int,
    jobs: int | None,
) -> list[Naming]:
    """Name objects, several processes at a time; see :func:`identify`."""
    truths = np.random.default_rng([seed, 5]).permutation(np.arange(num_objects) % len(setting.bodies.labels))
    shared = Shared(setting)
    tasks = [
        partial(_name_one, shared, int(truth) if body is None else body, rule, [seed, number], max_touches, threshold)
        for number, truth in enumerate(truths)
    ]
    return list(run_tasks(tasks, jobs, "objects"))


def _name_one(
    shared: Shared[MeshSetting], truth: int, rule: Rule, seed: Sequence[int], max_touches: int, threshold: float
) -> Naming:
    obj = shared.value.scene.sample_object(truth, np.random.default_rng([*seed, 0]))
    return name_object(shared.value, obj, rule, seed, max_touches, threshold)


@dataclass(frozen=True)
class Identify:
    """Name the bodies of a folder of meshes by touch, in simulation: nothing is trained.

    The first run makes views of each body, which are kept; the next starts at once.

    For example:

        activetouch identify scans
        activetouch identify scans --body mug --objects 5 --out runs/mug
        activetouch identify scans --scale 0.001 --rule random
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of mesh files; subfolders too."""
    body: str | None = None
    """Label of the body that is pressed; random ones by default."""
    objects: Count = 20
    """Number of objects to name."""
    rule: Rule = "information gain"
    """How the next direction is chosen."""
    threshold: Share = 0.95
    """Probability of a body at which to stop."""
    max_touches: Count = 16
    """Touches of an object, at most 26."""
    scale: Positive | None = None
    """Metres per unit of files that do not say it, such as 0.001."""
    sensor: str = "gel"
    """Sensor with a reader of any object, or a folder of one."""
    seed: Seed = 0
    """Seed of objects and touches."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes."""
    out: Path = Path("runs/identify")
    """Folder for the report."""

    @ends_claims
    def run(self) -> None:
        """Read, make views, name, report."""
        check_arguments(self)
        claim_folder(self.out)
        console = plain_console()
        solids = read_and_tell(self.folder, self.scale, self.jobs)
        chosen = None if self.body is None else index_of("body", tuple(solids), self.body)
        setting = MeshSetting.of(solids, sensor=self.sensor, jobs=self.jobs)
        twins = tell_twins(setting)
        namings = name_all(
            setting, self.objects, chosen, self.rule, self.threshold, self.max_touches, self.seed, self.jobs
        )
        found = Identified(setting, namings, twins)
        console.print(found.table().rich())
        console.print(f"wrote {found.save(self.out)}")


def read_and_tell(folder: Path, scale: float | None, jobs: int) -> dict[str, Shape]:
    """Read the meshes of a folder; say what they and 10, 100 and 1 000 bodies cost, and what was left out."""
    console = plain_console()
    solids, refused = read_folder(folder, scale)
    for number in sorted({*COSTS, len(solids)}):
        console.print(cost_words(number, jobs=jobs) + (" (these)" if number == len(solids) else ""))
    for reason in refused:
        console.print(f"left out: {reason}")
    return solids


def tell_twins(setting: MeshSetting) -> list[NearTwins]:
    """Bodies that feel nearly alike, which are printed before the first touch."""
    twins, console = near_twins(setting), plain_console()
    for twin in twins[:20]:
        console.print(f"- {twin}")
    if len(twins) > 20:
        console.print(f"- and {len(twins) - 20} more pairs")
    return twins
