"""What ``find`` and ``identify`` share: their options, what they say before the first touch, and their reports."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from activetouch.solids.solid import Shape
from belief.claims import claim_folder
from belief.table import Table, Tabular
from experiments.command_line.arguments import Jobs, Positive, Seed, Share, check_arguments
from experiments.command_line.console import plain_console
from experiments.meshes.naming import Rule
from experiments.meshes.near_twins import NearTwins
from experiments.meshes.setting import MeshSetting, cost_words, read_folder, reader_of
from experiments.parallel import default_jobs
from experiments.reporting.page import Section, write_page

COSTS = (10, 100, 1000)
"""Numbers of bodies whose cost is told before anything is computed."""
_MOST_TWINS = 20  # that are printed


@dataclass(frozen=True, eq=False)
class MeshResult(Tabular, ABC):
    """Touched objects of many bodies. It prints as its table.

    Attributes:
        setting: bodies and sensor.
        twins: bodies that feel nearly alike.
    """

    setting: MeshSetting
    twins: Sequence[NearTwins]
    _kind: ClassVar[str]  # what a row of the table is about, in the plural

    @abstractmethod
    def table(self) -> Table:
        """One row for each search or object, and how many are right."""

    @property
    @abstractmethod
    def _question(self) -> str:
        """Title of the report."""

    @abstractmethod
    def _pictures(self) -> list[Section]:
        """Sections with the bodies that were still possible after each touch."""

    def __str__(self) -> str:
        return "\n\n".join([*map(str, self.twins), super().__str__()])

    def save(self, folder: Path | str) -> Path:
        """Write ``report.html``, with the bodies that were still possible after each touch, and the table as CSV.

        Returns:
            Path of the report.

        Raises:
            CannotWrite: the disk is full, or the folder is not writable.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        table = self.table()
        table.write_csv(folder / f"{self._kind}.csv")
        alike = [f"{twin}." for twin in self.twins] or ["No two bodies feel nearly alike."]
        sections = [Section(self._kind.capitalize(), [], [table]), Section("Bodies that feel alike", alike)]
        write_page(folder / "report.html", self._question, [*sections, *self._pictures()])
        return folder / "report.html"


@dataclass(frozen=True, kw_only=True)
class MeshOptions:
    """Bodies, sensor, and how they are touched."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of mesh files, of what the objects may be; subfolders too."""
    rule: Rule = "information gain"
    """How the next direction is chosen."""
    threshold: Share = 0.95
    """Probability of the answer at which to stop."""
    scale: Positive | None = None
    """Metres per unit of files that do not say it, such as 0.001."""
    sensor: str = "gel"
    """Sensor with a reader of any object, or a folder of one."""
    seed: Seed = 0
    """Seed of objects and touches."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes."""
    out: Path
    """Folder for the report."""

    def read(self) -> dict[str, Shape]:
        """Check the options and read the meshes; say what they and 10, 100 and 1 000 bodies cost, and what is left out.

        Raises:
            BadArgument: an option is invalid.
            CannotWrite: the folder of the report cannot be written, or another process writes there.
            InvalidArgument: no mesh can be read, or the sensor has no reader of any object.
        """
        check_arguments(self)
        claim_folder(self.out)
        solids, refused = read_folder(self.folder, self.scale)
        console, width = plain_console(), reader_of(self.sensor).card.embedding
        for number in sorted({*COSTS, len(solids)}):
            console.print(cost_words(number, width, jobs=self.jobs) + (" (these)" if number == len(solids) else ""))
        for reason in refused:
            console.print(f"left out: {reason}")
        return solids

    @property
    def common(self) -> dict[str, Any]:
        """The arguments of the functions that follow from them."""
        names = ("rule", "threshold", "seed", "jobs", "sensor")
        return {name: getattr(self, name) for name in names} | {"begun": tell_twins}

    def report(self, found: MeshResult) -> None:
        """Print the table, and write the report."""
        print(found.table())
        print(f"wrote {found.save(self.out)}")


def solids_of(bodies: Path | str | Sequence[Path | str] | Mapping[str, Shape], scale: float | None) -> dict[str, Shape]:
    """Bodies by label, as given, or of mesh files; see :func:`experiments.meshes.setting.read_folder`."""
    return dict(bodies) if isinstance(bodies, Mapping) else read_folder(bodies, scale)[0]


def tell_twins(twins: Sequence[NearTwins]) -> None:
    """Print the bodies that feel nearly alike."""
    console = plain_console()
    for twin in twins[:_MOST_TWINS]:
        console.print(f"- {twin}")
    if len(twins) > _MOST_TWINS:
        console.print(f"- and {len(twins) - _MOST_TWINS} more pairs")
