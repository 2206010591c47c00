"""``activetouch identify``: which of the bodies in a folder of meshes is it? Nothing is trained for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from activetouch.solids.solid import Shape
from belief.claims import ends_claims
from belief.naming import index_of
from belief.statistics import wilson_interval
from belief.table import Table
from experiments.command_line.arguments import Count
from experiments.meshes.naming import Naming, Rule, name_object
from experiments.meshes.near_twins import NearTwins, near_twins
from experiments.meshes.result import MeshOptions, MeshResult, solids_of
from experiments.meshes.setting import MeshSetting
from experiments.parallel import Shared, run_tasks
from experiments.reporting.page import Section

THRESHOLDS = (0.9, 0.95)


@dataclass(frozen=True, eq=False)
class Identified(MeshResult):
    """Simulated objects, and how they were named. It prints as its table.

    Attributes:
        namings: of the objects.
    """

    namings: Sequence[Naming]
    _kind = "objects"

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

    @property
    def _question(self) -> str:
        return "Which body is it?"

    def _pictures(self) -> list[Section]:
        from experiments.meshes.figures import possible_pictures

        return possible_pictures(self.setting, self.namings)


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
    begun: Callable[[Sequence[NearTwins]], None] | None = None,
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
        begun: called before the first touch, with the bodies that feel nearly alike.
        setting: further arguments of :meth:`MeshSetting.of`, such as ``sensor`` and ``plan``.

    Raises:
        UnknownName: there is no such body.
        InvalidArgument: no mesh can be read, or the sensor has no reader of any object.
    """
    solids = solids_of(bodies, scale)
    chosen = None if body is None else index_of("body", tuple(solids), body)
    made = MeshSetting.of(solids, jobs=jobs, **setting)
    twins = near_twins(made)
    if begun is not None:
        begun(twins)
    truths = np.random.default_rng([seed, 5]).permutation(np.arange(num_objects) % len(solids))
    shared = Shared(made)
    tasks = [
        partial(
            _name_one, shared, int(truth) if chosen is None else chosen, rule, [seed, number], max_touches, threshold
        )
        for number, truth in enumerate(truths)
    ]
    return Identified(made, twins, list(run_tasks(tasks, jobs, "objects")))


def _name_one(
    shared: Shared[MeshSetting], truth: int, rule: Rule, seed: Sequence[int], max_touches: int, threshold: float
) -> Naming:
    obj = shared.value.scene.sample_object(truth, np.random.default_rng([*seed, 0]))
    return name_object(shared.value, obj, rule, seed, max_touches, threshold)


@dataclass(frozen=True, kw_only=True)
class Identify(MeshOptions):
    """Name the bodies of a folder of meshes by touch, in simulation: nothing is trained.

    The first run makes views of each body, which are kept; the next starts at once.

    For example:

        activetouch identify scans
        activetouch identify scans --body mug --objects 5 --out runs/mug
        activetouch identify scans --scale 0.001 --rule random
    """

    body: str | None = None
    """Label of the body that is pressed; random ones by default."""
    objects: Count = 20
    """Number of objects to name."""
    max_touches: Count = 16
    """Touches of an object, at most 26."""
    out: Path = Path("runs/identify")
    """Folder for the report."""

    @ends_claims
    def run(self) -> None:
        """Read, make views, name, report."""
        found = identify(
            self.read(), body=self.body, num_objects=self.objects, max_touches=self.max_touches, **self.common
        )
        self.report(found)
