"""Task cards: what determines the searches of a task, one JSON file each; another content needs another name."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from belief.codec import OPTIONAL, from_fields, to_fields
from belief.constraints import Checked, Count
from belief.errors import UnknownName
from belief.problem import SearchProblem
from belief.table import Table
from experiments.command_line.arguments import BadArgument, Seed, Trust
from experiments.parallel import run_tasks
from experiments.search.benchmark.submission import PlayedBatch, batches_of
from experiments.search.comparison import prepared
from experiments.search.play import EPISODES_PER_BATCH, Setting
from experiments.search.run import Run
from experiments.search.verdict import GUESS, failure_sentence
from planners import Decider
from planners.fingerprint import files_digest
from planners.registry import DECIDERS
from planners.solve import one_touch_bound

if TYPE_CHECKING:
    from experiments.search.benchmark.trays import TrayTask

TASKS = Path(__file__).parent / "tasks"
BASELINES = Path(__file__).parent / "baselines.json"
"""Written by docs/generate/tables.py from the submissions that are committed."""


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
        oracle: return of an agent that is told what each touch meets, where no bound is known, as in trays.
    """

    name: str
    summary: str
    setting: Mapping[str, Any]
    episodes: Count
    seed: Seed
    sensor_sha256: str
    targets: tuple[str, ...] = ()
    oracle: Annotated[float | None, OPTIONAL] = None

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
    def tray(self) -> TrayTask | None:
        """The task, if its objects lie in a tray."""
        if "scene" not in self.setting:
            return None
        from experiments.search.benchmark.trays import TrayTask  # whose modules no other task needs

        return from_fields(TrayTask, self.setting)

    @cached_property
    def problem(self) -> SearchProblem:
        """The rules of a search."""
        return self.rules.problem

    @property
    def sought(self) -> tuple[str, ...]:
        """The targets, of which none is left out."""
        return self.targets or (self.tray.made.shape_labels if self.tray else tuple(self.problem.shape_labels))

    @property
    def num_objects(self) -> int:
        """Objects of a search."""
        return self.tray.made.tray.num_objects if self.tray else self.problem.num_objects

    @property
    def deciders(self) -> Mapping[str, Any]:
        """The deciders of this package that can play, by name."""
        if self.tray:
            from activetouch.tray.sensor import DECIDERS as IN_TRAYS

            return IN_TRAYS
        return DECIDERS

    @cached_property
    def bound(self) -> float:
        """The largest expected return with any sensor: one touch reveals a shape; in a tray, that of the oracle."""
        if self.oracle is not None:
            return self.oracle
        return float(np.mean([one_touch_bound(self.problem.seeking(target), target) for target in self.sought]))

    def beside(self) -> Table:
        """Agents of this package on the development searches: the baseline, and a guess; without rows for others."""
        known = json.loads(BASELINES.read_text(encoding="utf-8")).get(self.name, {})
        return Table(
            "Beside it, on the development seeds",
            ["agent", ("success", ".3f"), ("touches", ".2f"), ("return", ".3f")],
            [(name, *found) for name, found in known.items()],
            f"{GUESS} answers without a touch." * (GUESS in known),
        )

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
        self.require_sensor()
        run = prepared(self.rules, deciders, targets=self.targets, episodes=self.episodes, seed=self.seed, jobs=jobs)
        return run if seed is None else replace(run, searches=replace(run.searches, seed=seed))

    def play(
        self, name: str, player: Decider | str, jobs: int, seed: int | None = None
    ) -> tuple[list[PlayedBatch], str]:
        """All batches, played by an agent, and why it failed, in words; arguments and errors as of :meth:`run`."""
        if self.tray is None:
            run = self.run({name: player}, jobs, seed)
            run.play(jobs)
            played = [*batches_of(run, name)]
            return [batch for batch, _ in played], failure_sentence(name, [one for _, some in played for one in some])
        self.require_sensor()
        self.tray.made.belief(0)  # which prepares what all processes share
        seed = self.seed if seed is None else seed
        tasks = [partial(self.tray.batch, seed, target, numbers, player) for target, numbers in self.batches()]
        found = {(batch.target, batch.first): batch for batch in run_tasks(tasks, jobs, "searching in trays")}
        return [found[target, numbers.start] for target, numbers in self.batches()], ""

    def require_sensor(self) -> None:
        """Raise BadArgument if this installation has another sensor than the task."""
        tray = self.tray
        found = tray.made.identity if tray else files_digest(self.rules.sensor_files(self.rules.scene))
        if found != self.sensor_sha256:
            raise BadArgument(
                f"the task {self.name} is that of the sensor {self.sensor_sha256[:12]}, this version of activetouch "
                f"has {found[:12]}: play it with the version that made the task, or another task"
            )


@cache
def _read(text: str) -> Card:
    """The card with this content, whose scene is made once."""
    return from_fields(Card, json.loads(text))
