"""Command-line arguments that describe a collection of touches."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, TypeAlias

from activetouch.data.manifest import CollectionPlan
from experiments.command_line.arguments import Count, Seed, Within

ObjectCount: TypeAlias = Annotated[int, Within(0, 2**32 - 1)]


@dataclass(frozen=True)
class PlanArguments:
    """Number of objects of each shape per split, and rounds of touches per object."""

    train: ObjectCount = CollectionPlan.train
    """Objects of each shape for training."""
    calibration: ObjectCount = CollectionPlan.calibration
    """Objects of each shape for calibration."""
    test: ObjectCount = CollectionPlan.test
    """Objects of each shape for testing."""
    seed: Seed = CollectionPlan.seed
    """Seed of the collection."""
    repeats: Count = CollectionPlan.repeats
    """Rounds of all poses per object. 1 is best for training a classifier; 6 measures how strongly repeated touches of
    one object are correlated."""

    @property
    def plan(self) -> CollectionPlan:
        """The arguments as a plan."""
        return CollectionPlan(**asdict(self))
