"""What ``find`` and ``identify`` share: their options, what they say before the first touch, and their reports."""

from __future__ import annotations

import textwrap
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeAlias

import numpy as np
import tyro

from activetouch import TactileSensor
from activetouch.mesh_source import labelled_sources, warn_of
from activetouch.solids.mesh import Mesh
from activetouch.solids.mesh_file import ENDINGS
from activetouch.solids.solid import Shape
from belief.constraints import Positive, Probability, Share
from belief.errors import InvalidArgument
from belief.files import claim_folder
from belief.naming import index_of
from belief.observation_model.nested_bodies import NestedEvidence
from belief.statistics import wilson_interval
from belief.table import Table, Tabular, ends
from belief.validation import Floats
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

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Bodies: TypeAlias = Path | str | Sequence[Path | str] | Mapping[str, Shape]
"""A folder of mesh files, mesh files, or solids by label."""
UNLISTED_SHARE = 0.05
"""Usual prior probability that an object is none of the bodies."""
_MOST_TWINS = 20  # that are printed
_SHOWN, _PROBABLE = 5, 0.01  # bodies in a picture: at most, and their least probability


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
        """One row for each search or object, with the keys ``right``, ``stated`` and ``touches``, and those shown."""

    def table(self) -> Table:
        """The rows, and how many are right."""
        rows = self.rows()
        right = sum(row["right"] for row in rows)
        low, high = ends(*wilson_interval(right, len(rows)), ".2f")
        stated, spent = np.mean([(row["stated"], row["touches"]) for row in rows], axis=0)
        note = self._note.format(right=right, number=len(rows), low=low, high=high, stated=stated, spent=spent)
        cells = [tuple(row[name] for name, _ in self._columns) for row in rows]
        return Table(self._title, self._columns, cells, note, self._kind)

    @property
    @abstractmethod
    def _title(self) -> str:
        """Title of the table."""

    @property
    @abstractmethod
    def _question(self) -> str:
        """Title of the report."""

    @abstractmethod
    def _shown(self) -> Iterator[tuple[str, str, Sequence[str], Sequence[NestedEvidence]]]:
        """Title, end, touches in words and evidence after each, for every object or search with pictures."""

    def __str__(self) -> str:
        return "\n\n".join([*self.left_out, *map(str, self.twins), super().__str__()])

    def report(self) -> Report:
        """The table, and the bodies that were still possible after each touch."""
        alike = [f"{twin}." for twin in self.twins] or ["No two bodies feel nearly alike."]
        sections = [Section(self._kind.capitalize(), [], [self.table()]), Section("Bodies that feel alike", alike)]
        sections += [Section("Files that were left out", self.left_out)] if self.left_out else []
        sections += [
            Section(title, [end], [], _pictures(self.sensor, title, touches, evidence))
            for title, end, touches, evidence in self._shown()
        ]
        return Report(self._question, sections)


def _pictures(
    sensor: TactileSensor, title: str, touches: Sequence[str], evidence: Sequence[NestedEvidence]
) -> list[Any]:
    """The bodies that are possible after each touch, as they lie in the mean; none where no body stands out."""
    from activetouch.view import Bodies, coloured
    from experiments.report import Picture

    bodies = Bodies.of(sensor)
    assert bodies is not None, "the belief is about one body"

    def draw(axes: Axes, label: str, prob: float, picture: Floats) -> None:
        axes.imshow(coloured(picture, prob), origin="lower")
        axes.set_title(f"{textwrap.fill(label, 18)}\n{prob:.2f}", fontsize=7)
        axes.set_axis_off()

    name = title.lower().replace(" ", "")
    found = []
    for number, (said, after) in enumerate(zip(touches, evidence, strict=True), 1):
        probs = after.belief.probs
        shown = bodies.likeliest(after, probs, min(_SHOWN, int((probs >= _PROBABLE).sum())))
        parts = [partial(draw, label=label, prob=prob, picture=picture) for label, prob, picture in shown]
        words = f"After touch {number}: {said}."
        found += [Picture(f"{name}-touch{number}", words, parts, size=(1.3, 1.5), is_file=False)] if parts else []
    return found


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
    warn_of(left_out, stacklevel=4)
    if len(solids) == 1:
        reasons = "".join(f"\n- {line}" for line in left_out)
        raise InvalidArgument(f"one body, {next(iter(solids))}: nothing to tell apart; add a mesh{reasons}")
    return solids, left_out
