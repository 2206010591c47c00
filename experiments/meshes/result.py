"""What ``find`` and ``identify`` share: their options, what they say before the first touch, and their reports."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np
import tyro

from activetouch import TactileSensor
from activetouch.mesh_source import labelled_sources, warn_of_files
from activetouch.sensor.searching import UNLISTED_SHARE
from activetouch.solids.mesh import Mesh
from activetouch.solids.mesh_file import ENDINGS
from activetouch.solids.solid import Shape
from belief.constraints import Positive, Probability, Share
from belief.errors import InvalidArgument
from belief.files import claim_folder
from belief.naming import NONE_OF_THESE, index_of
from belief.statistics import wilson_interval
from belief.table import Table, Tabular, ends
from experiments.command_line.arguments import Cluster, Jobs, OnCluster, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.meshes.near_twins import NearTwins
from experiments.meshes.setting import (
    cost_words,
    read_folder,
    reader_of,
    reading_words,
    sources_of,
)
from experiments.parallel import default_jobs
from experiments.report import Report, Reported, Section
from experiments.scene_choice import SceneChoice

Bodies: TypeAlias = Path | str | Sequence[Path | str] | Mapping[str, Shape]
"""A folder of mesh files, mesh files, or solids by label."""
_MOST_TWINS = 20  # that are printed
RESULTS = ("wrong", "unsure", NONE_OF_THESE, "right")
"""What becomes of an object or a search; what needs a look comes first."""
_IN_WORDS = {"wrong": "wrong", "unsure": "unsure", NONE_OF_THESE: "rightly none of these"}
_LEGEND = (
    "What needs a look comes first. Beside the image that was felt: what the two most probable bodies would feel like. "
    "Bodies are averaged over the ways in which they may still lie; the ring is where the pad meets them, fainter on "
    "the far side. The true body is orange."
)


@dataclass(frozen=True, eq=False)
class MeshResult(Tabular, Reported):
    """Touched objects of many bodies, those that feel alike, and lines on files left out; prints as its table."""

    sensor: TactileSensor
    twins: Sequence[NearTwins]
    left_out: Sequence[str] = field(default=(), kw_only=True)
    _kind: ClassVar[str]  # what a row of the table is about, in the plural
    _columns: ClassVar[Sequence[tuple[str, str]]]
    _note: ClassVar[str]  # below the table

    @abstractmethod
    def rows(self) -> list[dict[str, Any]]:
        """One row for each search or object, with the keys ``right``, ``stated`` and ``touches``, and those shown.

        The key ``result`` is one of :data:`RESULTS`.
        """

    def _ordered(self) -> list[tuple[int, dict[str, Any]]]:
        """Numbers of the rows, from 0, and the rows: what needs a look comes first."""
        return sorted(enumerate(self.rows()), key=lambda found: RESULTS.index(found[1]["result"]))

    def table(self) -> Table:
        """The rows, those that need a look first, and how many are right."""
        rows = [row for _, row in self._ordered()]
        right = sum(row["right"] for row in rows)
        low, high = ends(*wilson_interval(right, len(rows)), ".2f")
        stated, spent = np.mean([(row["stated"], row["touches"]) for row in rows], axis=0)
        note = self._note.format(right=right, number=len(rows), low=low, high=high, stated=stated, spent=spent)
        cells = [tuple(row[name] for name, _ in self._columns) for row in rows]
        return Table(self._title, self._columns, cells, note, self._kind)

    def answer(self) -> str:
        """How many answers are right, in plain words, and with how many touches."""
        rows = self.rows()
        count = Counter(row["result"] for row in rows)
        right, touches = sum(row["right"] for row in rows), np.mean([row["touches"] for row in rows])
        shares = [f"{n} {'is' if n == 1 else 'are'} {words}" for name, words in _IN_WORDS.items() if (n := count[name])]
        doubt = f" {', '.join(shares)}." if shares else ""
        return (
            f"{right} of {len(rows)} {self._answered}, with {touches:.1f} touches on average; a guess without a touch "
            f"is right in {100 * self._by_chance:.0f} %.{doubt}"
        )

    @property
    @abstractmethod
    def _answered(self) -> str:
        """What is right in how many cases, in words."""

    @property
    @abstractmethod
    def _by_chance(self) -> float:
        """How often the best guess without a touch is right."""

    @property
    @abstractmethod
    def _title(self) -> str:
        """Title of the table."""

    @property
    @abstractmethod
    def _question(self) -> str:
        """Title of the report."""

    @abstractmethod
    def _films(self) -> list[dict[str, Any]]:
        """Some objects or searches, what needs a look first, in the form of ``film.html``."""

    def __str__(self) -> str:
        return "\n\n".join([*self.left_out, *map(str, self.twins), super().__str__()])

    def _repr_html_(self) -> str:
        """The answer and the table, for a notebook."""
        return f"<p>{escape(self.answer())}</p>{super()._repr_html_()}"

    def report(self) -> Report:
        """The answer, the table, touches one by one, and bodies that feel alike."""
        alike = [f"{twin}." for twin in self.twins] or ["No two bodies feel nearly alike."]
        sections = [Section("", [self.answer()]), Section(self._kind.capitalize(), [], [self.table()])]
        sections.append(Section("Touch by touch", [_LEGEND], films=self._films()))
        sections.append(Section("Bodies that feel alike", alike))
        sections += [Section("Files that were left out", self.left_out)] if self.left_out else []
        return Report(self._question, sections)


def result_of(is_right: bool, is_certain: bool, is_none: bool) -> str:
    """Which of :data:`RESULTS` an answer is."""
    if not is_certain:
        return "unsure"
    return "wrong" if not is_right else "none of these" if is_none else "right"


@dataclass(frozen=True, kw_only=True)
class MeshOptions(ABC):
    """Bodies, sensor, and how they are touched."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of mesh files, [@SCALE], of what the objects may be; subfolders too."""
    threshold: Share = 0.95
    """Probability of the answer at which to stop."""
    unlisted: Probability = UNLISTED_SHARE
    """Prior probability that an object is none of the bodies; 0 for a closed world, which is faster."""
    prior: str | None = None
    """Probabilities of bodies before the first touch, as a camera sees them: mug=.7,bowl=.3, or a CSV file with columns
    shape and prob. They may be wrong, so they count less than touches."""
    scale: Positive | None = None
    """Metres per unit of the files, such as 0.001."""
    sensor: str = "gel"
    """Sensor with a reader of any object, or a folder of one."""
    seed: Seed = 0
    """Seed of objects and touches."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes."""
    cluster: OnCluster = field(default_factory=Cluster)
    """Workers of other machines."""
    out: Path
    """Folder for the report."""

    def read(self, body: str | None, choice: SceneChoice | None = None) -> tuple[dict[str, Mesh], list[str]]:
        """Check the options and the name of a body, read the meshes, and say what they cost and what is left out.

        With a choice of a scene, the meshes are read there, once.
        """
        check_arguments(self)
        claim_folder(self.out)
        sources, _ = labelled_sources(*sources_of(self.folder))
        if body is not None:
            body_index(sources, body)
        reader_of(self.sensor)  # which is refused before files are read
        plain_console().print(reading_words(sources))
        solids, left_out = read_folder(self.folder, self.scale) if choice is None else choice.meshes_read
        _require_two(solids, left_out)
        plain_console().print(cost_words(solids, self.sensor, *self._expected(len(solids)), jobs=self.jobs))
        for line in left_out:
            print(line)
        return solids, left_out

    @abstractmethod
    def _expected(self, number: int) -> tuple[float, float]:
        """About how many touches are made among so many bodies, and how many of them the report shows."""

    @property
    def common(self) -> dict[str, Any]:
        """The arguments of the functions that follow from them."""
        names = ("threshold", "unlisted", "prior", "seed", "jobs", "sensor")
        return {name: getattr(self, name) for name in names}

    def report(self, found: MeshResult) -> None:
        """Print the bodies that feel alike and the table, and write the report."""
        for twin in found.twins[:_MOST_TWINS]:
            plain_console().print(f"- {twin}")
        if len(found.twins) > _MOST_TWINS:
            plain_console().print(f"- and {len(found.twins) - _MOST_TWINS} more pairs")
        print(found.table())
        if found.left_out:
            print(f"bodies: {len(found.sensor.shape_labels)}; left out, as said above: {len(found.left_out)}")
        replaced = ", in place of an earlier report" * (self.out / "report.html").exists()
        print(f"wrote {found.save(self.out)}{replaced}")


def body_index(labels: Iterable[str], name: str) -> int:
    """Index of the body with a label, or of a file with that label; raises UnknownName."""
    known = tuple(labels)
    is_file = name not in known and Path(name).suffix.lower() in ENDINGS
    return index_of("body", known, str(Path(name).with_suffix("")) if is_file else name)


def solids_of(bodies: Bodies, scale: float | None) -> tuple[Mapping[str, Shape], list[str]]:
    """Bodies by label, as given, or of mesh files; and lines on those left out, of which it warns."""
    solids, left_out = (bodies, list[str]()) if isinstance(bodies, Mapping) else read_folder(bodies, scale)
    warn_of_files(left_out)
    _require_two(solids, left_out)
    return solids, left_out


def _require_two(solids: Mapping[str, Shape], left_out: Sequence[str]) -> None:
    if len(solids) == 1:
        reasons = "".join(f"\n- {line}" for line in left_out)
        raise InvalidArgument(f"one body, {next(iter(solids))}: nothing to tell apart; add a mesh{reasons}")
