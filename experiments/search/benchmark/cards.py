"""Task cards: what determines the searches of a task, one JSON file each; another content needs another name."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from belief.codec import from_fields, to_fields
from belief.constraints import Checked, Count
from belief.errors import UnknownName
from belief.problem import SearchProblem
from experiments.command_line.arguments import BadArgument, Seed, Trust
from experiments.search.comparison import prepared
from experiments.search.play import EPISODES_PER_BATCH, Setting
from experiments.search.run import Run
from planners import Decider
from planners.fingerprint import files_digest
from planners.solve import one_touch_bound

TASKS = Path(__file__).parent / "tasks"


@dataclass(frozen=True)
class Card(Checked):
    """A task.

    Attributes:
        name: with its version, such as ``coarse-v1``.
        summary: what is sought, in one sentence.
        setting: fields of :class:`experiments.search.play.Setting`.
        targets: shapes that are sought; all if empty.
        episodes: searches for each target.
        seed: of the development searches.
        sensor_sha256: digest of the files of the sensor.
    """

    name: str
    summary: str
    setting: Mapping[str, Any]
    episodes: Count
    seed: Seed
    sensor_sha256: str
    targets: tuple[str, ...] = ()

    @classmethod
    def named(cls, name: str) -> Card:
        """The card of a task; raises UnknownName."""
        if name not in (known := [path.stem for path in sorted(TASKS.glob("*.json"))]):
            raise UnknownName("task", name, known)
        return _read((TASKS / f"{name}.json").read_text(encoding="utf-8"))

    @classmethod
    def every(cls) -> list[Card]:
        """All cards, by name."""
        return [cls.named(path.stem) for path in sorted(TASKS.glob("*.json"))]

    @property
    def digest(self) -> str:
        """SHA-256 of the content."""
        text = json.dumps(to_fields(self), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def rules(self) -> Setting:
        """Sensor and rules of the searches."""
        return Setting.from_dict(self.setting, Trust(TASKS / f"{self.name}.json", everything=True))

    @cached_property
    def problem(self) -> SearchProblem:
        """The rules of a search."""
        return self.rules.problem

    @property
    def sought(self) -> tuple[str, ...]:
        """The targets, of which none is left out."""
        return self.targets or tuple(self.problem.shape_labels)

    @cached_property
    def bound(self) -> float:
        """The largest expected return with any sensor: one touch reveals a shape."""
        return float(np.mean([one_touch_bound(self.problem.seeking(target), target) for target in self.sought]))

    def batches(self) -> list[tuple[str, range]]:
        """Target and numbers of the searches of each batch."""
        firsts = range(0, self.episodes, EPISODES_PER_BATCH)
        numbers = [range(first, min(first + EPISODES_PER_BATCH, self.episodes)) for first in firsts]
        return [(target, some) for target in self.sought for some in numbers]

    def run(self, deciders: Mapping[str, Decider | str], jobs: int | None, seed: int | None = None) -> Run:
        """The searches of deciders, not yet played, with the card's seed or another one, which may have many bits.

        Raises:
            BadArgument: this installation has another sensor than the task.
        """
        found = files_digest(self.rules.sensor_files(self.rules.scene))
        if found != self.sensor_sha256:
            raise BadArgument(
                f"the task {self.name} is that of the sensor {self.sensor_sha256[:12]}, this version of activetouch "
                f"has {found[:12]}: play it with the version that made the task, or another task"
            )
        run = prepared(self.rules, deciders, targets=self.targets, episodes=self.episodes, seed=self.seed, jobs=jobs)
        return run if seed is None else replace(run, searches=replace(run.searches, seed=seed))


@cache
def _read(text: str) -> Card:
    """The card with this content, whose scene is made once."""
    return from_fields(Card, json.loads(text))
