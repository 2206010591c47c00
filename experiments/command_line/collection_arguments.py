"""The numbers of a collection on the command line."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, TypeAlias

from activetouch.data.manifest import CollectionPlan
from experiments.command_line.arguments import Count, Seed, Within

Objects: TypeAlias = Annotated[int, Within(0, 2**32 - 1)]


@dataclass(frozen=True)
class PlanArguments:
    """Objects of each shape and split, and rounds of poses that each is touched in."""

    train: Objects = CollectionPlan.train
    """Objects of each shape to learn from."""
    calibration: Objects = CollectionPlan.calibration
    """Objects of each shape to calibrate on."""
    test: Objects = CollectionPlan.test
    """Objects of each shape to measure on."""
    seed: Seed = CollectionPlan.seed
    """Of the whole collection."""
    repeats: Count = CollectionPlan.repeats
    """Rounds of all poses that every object is touched in: 1 teaches a classifier most for the time, 6 show how far
    touches of one object in one pose repeat each other."""

    @property
    def plan(self) -> CollectionPlan:
        """The plan."""
        return CollectionPlan(**asdict(self))
