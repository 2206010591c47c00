"""``activetouch identify``: which of the bodies in a folder of meshes is it? Nothing is trained for them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from activetouch import TactileSensor, TouchWorld
from belief.claims import ends_claims
from belief.observation_model.nested_bodies import NestedEvidence
from experiments.command_line.arguments import Count
from experiments.meshes.near_twins import near_twins
from experiments.meshes.result import Bodies, MeshOptions, MeshResult, body_index, solids_of
from experiments.meshes.setting import model_of, plan_of, sensor_of
from experiments.parallel import Shared, run_tasks
from planners import Decider
from planners.decider import ProbeSelector, SequentialDecider
from planners.registry import make_decider
from planners.search import Identification
from planners.search import identify as name_first
from planners.stopping import PosteriorThresholds

_BY_EVIDENCE = ("information_gain", "shape_information_gain", "value_of_information", "fixed_poses", "random_poses")
_PICTURED = 6  # objects


@dataclass(frozen=True, eq=False)
class Identified(MeshResult):
    """Simulated objects, and how they were named; prints as their table."""

    namings: Sequence[Identification]
    _kind = "objects"
    _columns = ("body", ""), ("named", ""), ("stated", ".3f"), ("touches", "d")
    _note = "{right} of {number} named rightly, {low} to {high}; stated {stated:.2f} in the mean."

    def rows(self) -> list[dict[str, Any]]:
        """One row for each object: its body, the named one, the stated probability, and touches."""
        labels = self.sensor.shape_labels
        return [
            {
                "body": labels[one.truth],
                "named": labels[one.named],
                "right": one.is_right,
                "stated": one.stated,
                "touches": len(one.poses),
                "directions": " ".join(self.sensor.pose_labels[pose] for pose in one.poses),
            }
            for one in self.namings
        ]

    @property
    def _title(self) -> str:
        return f"objects among {len(self.sensor.shape_labels)} bodies"

    @property
    def _question(self) -> str:
        return "Which body is it?"

    def _shown(self) -> Iterator[tuple[str, str, Sequence[str], Sequence[NestedEvidence]]]:
        labels = self.sensor.shape_labels
        for number, one in enumerate(self.namings[:_PICTURED], 1):
            right = "rightly" if one.is_right else f"wrongly: it is {labels[one.truth]}"
            end = f"named {labels[one.named]} with probability {one.stated:.3f}, {right}"
            sides = [f"side {self.sensor.pose_labels[pose]}" for pose in one.poses]
            evidence, after = model_of(self.sensor).start(), list[NestedEvidence]()
            for touch in one.touches:
                evidence = evidence.update(touch)
                after.append(evidence)
            yield f"Object {number}", f"After {len(one.poses)} touches {end}.", sides, after


def identify(
    bodies: Bodies,
    *,
    body: str | None = None,
    num_objects: int = 20,
    threshold: float = 0.95,
    max_touches: int = 16,
    decider: str | Decider = "shape_information_gain",
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
        threshold: probability at which to stop touching an object.
        max_touches: of an object.
        decider: its name, as of :func:`activetouch.compare`, or a decider. One that stops by the probability of the
            target chooses the poses alone; any other one is asked about the most probable body, and stops, too.
        seed: of objects and touches.
        scale: metres per unit of mesh files without a scale of their own.
        jobs: number of processes; as many as processors by default.
        setting: as of :func:`activetouch.find`.

    Raises:
        UnknownName: there is no such body.
        InvalidArgument: no mesh can be read, or the sensor has no reader of any object.
    """
    solids, left_out = solids_of(bodies, scale)
    chosen = None if body is None else body_index(solids, body)
    sensor = replace(
        sensor_of(solids, setting.pop("sensor", "gel"), plan_of(**setting), jobs), with_logits=_reads_logits(decider)
    )
    truths = np.random.default_rng([seed, 5]).permutation(np.arange(num_objects) % len(solids)).tolist()
    shared = Shared((sensor, _player(decider, sensor)))
    tasks = [
        partial(_name_one, shared, truth if chosen is None else chosen, (seed, number), max_touches, threshold)
        for number, truth in enumerate(truths)
    ]
    namings = list(run_tasks(tasks, jobs, "objects"))
    return Identified(sensor, near_twins(model_of(sensor)), namings, left_out=left_out)


def _reads_logits(decider: str | Decider) -> bool:
    """Whether a decider may look at single touches: all but those that go by posterior and evidence."""
    return not (isinstance(decider, str) and decider.partition("(")[0] in _BY_EVIDENCE)


def _player(decider: str | Decider, sensor: TactileSensor) -> Decider | ProbeSelector:
    """The decider, or the selector of its poses where posterior thresholds stop it."""
    made = make_decider(decider, sensor.model.outcome_table(), sensor.model) if isinstance(decider, str) else decider
    if isinstance(made, SequentialDecider) and isinstance(made.stopping, PosteriorThresholds):
        return made.probing
    return made


def _name_one(
    shared: Shared[tuple[TactileSensor, Decider | ProbeSelector]],
    truth: int,
    seed: tuple[int, ...],
    max_touches: int,
    threshold: float,
) -> Identification:
    sensor, player = shared.value
    world = TouchWorld.sample(sensor, [truth], np.random.default_rng([*seed, 0]))
    return name_first(world, player, sensor.model, sensor.pose_labels, seed, threshold, max_touches)


@dataclass(frozen=True, kw_only=True)
class Identify(MeshOptions):
    """Name the bodies of a folder of meshes by touch, in simulation: nothing is trained.

    The first run makes views of each body, which are kept; the next starts at once.

    For example:

        activetouch identify scans
        activetouch identify scans --body mug --objects 5 --out runs/mug
        activetouch identify scans --scale 0.001 --decider value_of_information
    """

    body: str | None = None
    """Label of the body that is pressed; random ones by default."""
    objects: Count = 20
    """Number of objects to name."""
    max_touches: Count = 16
    """Touches of an object."""
    decider: str = "shape_information_gain"
    """Decider, as of compare; one that stops by the target's probability chooses the sides alone."""
    out: Path = Path("runs/identify")
    """Folder for the report."""

    def _expected(self, number: int) -> tuple[float, float]:
        each = min(self.max_touches, 1.0 + np.log(number))  # 1.3 of 4 bodies, 2.5 of 12, 4 of 100, 8 of 999
        return self.objects * each, min(self.objects, _PICTURED) * each

    @ends_claims
    def run(self) -> None:
        """Read, make views, name, report."""
        solids, left_out = self.read(self.body)
        found = identify(
            solids,
            body=self.body,
            num_objects=self.objects,
            max_touches=self.max_touches,
            decider=self.decider,
            **self.common,
        )
        self.report(replace(found, left_out=left_out))
