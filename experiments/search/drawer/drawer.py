"""``activetouch drawer``: is the object of this shape in the tray, and where? Searches with several deciders.

Every decider searches the same trays, and the same press gives every decider the same measurement. Finished searches
are kept in ``episodes.jsonl``, so that an interrupted command continues.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import tyro

from activetouch.tray.world import Tray
from belief.constraints import NotNegative, Probability, Share, Within
from belief.errors import InvalidArgument
from belief.files import claim_folder, ends_claims
from belief.statistics.comparison import wilson_interval
from belief.table import Table
from belief.validation import require_count
from experiments.command_line.arguments import Count, Jobs, Seed, check_arguments
from experiments.parallel import default_jobs, run_tasks
from experiments.report import Report, Reported, Section
from experiments.scene_choice import in_file_names
from experiments.search.drawer.page import searches_from_above
from experiments.search.drawer.searches import Key, Searches, read_searches, write_searches
from planners.certified import Certificate
from planners.tray import TrayRules
from planners.tray_session import TrayEpisode

Shapes = Mapping[str, Any] | Sequence[Path | str] | Path | None
USUAL_DECIDERS, USUAL_SEARCHES = ("information_per_cost", "raster"), 24
"""What the command plays by default."""
_Edge: TypeAlias = Annotated[float, Within(10.0, 3000.0, unit=" mm")]
_AT_ONCE = 4  # searches of a task
_FILE = "episodes.jsonl"


@dataclass(frozen=True, eq=False)
class Drawers(Reported):
    """Searches in trays, by decider; prints as their table.

    Attributes:
        searches: what determines them.
        episodes: of each decider, the same trays in the same order.
    """

    searches: Searches
    episodes: Mapping[str, Sequence[TrayEpisode]]

    def rows(self) -> list[dict[str, Any]]:
        """One row for each decider: answers that are right, targets that are found, touches, travel."""
        found = []
        for decider, listed in self.episodes.items():
            answered = [one for one in listed if one.answer != "unsure"]
            there = [one for one in listed if one.is_there]
            absent = [one for one in listed if not one.is_there]
            right, hits = sum(bool(one.success) for one in answered), sum(bool(one.success) for one in there)
            wrong = sum(one.answer == "here" for one in absent)
            found.append(
                {
                    "decider": decider,
                    "searches": len(listed),
                    "answered": len(answered) / len(listed),
                    "stated": float(np.mean([one.stated for one in answered])) if answered else None,
                    "right": right / len(answered) if answered else None,
                    "right_interval": wilson_interval(right, len(answered)) if answered else None,
                    "found": hits / len(there) if there else None,
                    "called_present": wrong / len(absent) if absent else None,
                    "touches": float(np.mean([one.num_touches for one in listed])),
                    "touches_error": _error([one.num_touches for one in listed]),
                    "travel": float(np.mean([one.travel for one in listed])),
                }
            )
        return found

    def table(self) -> Table:
        """The rows."""
        headings = [
            *("decider", ("searches", "d"), ("answered", ".3f"), ("stated", ".3f"), ("right", ".3f"), ("95 %", ".3f")),
            *(("found", ".3f"), ("absent, called present", ".3f")),
            *(("touches", ".1f"), ("± 95 %", ".1f"), ("travel [m]", ".2f")),
        ]
        rows = [list(row.values()) for row in self.rows()]
        tray = self.searches.tray
        note = (
            f"{tray.num_objects} objects in a tray of {1000 * tray.size[0]:g} x {1000 * tray.size[1]:g} mm; the target "
            f"is there in {tray.present:g} of the trays. Stated and right: of searches that were answered. Found: of "
            f"the targets that were there."
        )
        return Table("searches in a tray", headings, rows, note, "drawer")

    def __str__(self) -> str:
        return str(self.table())

    def verdict(self) -> list[str]:
        """What the searches say, in sentences."""
        first, *others = self.rows()
        said = [
            f"{first['decider']} is right in {round(first['right'] * first['answered'] * first['searches'])} of "
            f"{first['searches']} searches, after {first['touches']:.1f} touches and {first['travel']:.2f} m of travel "
            "in the mean."
            if first["right"] is not None
            else f"{first['decider']} answered in none of {first['searches']} searches."
        ]
        for row in others:
            shares = [first[name] / max(row[name], 1e-12) for name in ("touches", "travel")]
            said.append(
                f"{row['decider']} needs {row['touches']:.1f} touches and {row['travel']:.2f} m: "
                f"{first['decider']} takes {shares[0]:.2f} and {shares[1]:.2f} of it."
            )
        return said

    def report(self) -> Report:
        """Sentences, the table, and the first searches seen from above."""
        pictures = searches_from_above(self.searches, self.episodes)
        sections = [
            Section("", self.verdict(), [self.table()]),
            Section(
                "Searches from above",
                ["The finger's way, what it met, and where the target is said to be."],
                pictures=pictures,
            ),
        ]
        return Report("Where in the tray is it?", sections)


def drawer(
    deciders: Sequence[str] = USUAL_DECIDERS,
    *,
    sensor: str = "gel",
    shapes: Shapes = None,
    targets: Sequence[str] = (),
    num_searches: int = 100,
    strangers: Shapes = (),
    tray: Tray | None = None,
    rules: TrayRules | None = None,
    seed: int = 0,
    out: str | Path | None = None,
    jobs: int | None = None,
    certificate: str | Path | Certificate | None = None,
) -> Drawers:
    """Search in trays with several deciders.

    Args:
        deciders: as of :meth:`activetouch.tray.sensor.TraySensor.decider`.
        sensor: scene whose pad comes down: gel, coarse or hard.
        shapes: that the objects may have: solids by label, a folder of mesh files, or mesh files; the twelve shapes of
            the scene ``many`` by default.
        targets: shapes that are sought in turn; all by default.
        num_searches: number of searches of each decider.
        strangers: shapes of objects that are none of these, with the probability ``tray.unlisted``; as ``shapes``.
        tray: the tray; six objects on 400 x 300 mm by default.
        rules: when to stop, and what travel costs.
        seed: of objects and touches.
        out: folder in which finished searches are kept.
        jobs: number of processes; as many as processors by default.
        certificate: of ``activetouch certify --scene drawer`` for the only decider, by whose thresholds searches end.

    Raises:
        UnknownName: there is no such sensor, target or decider.
        InvalidArgument: there are fewer shapes than objects, or more deciders than the certificate is for.
        NotCertified: the certificate was made for something else.
    """
    searches = Searches(sensor, shapes, strangers, tray or Tray(), rules or TrayRules(), seed)
    return play(searches, deciders, targets, num_searches, out, jobs, certificate)


def play(
    searches: Searches,
    deciders: Sequence[str],
    targets: Sequence[str] = (),
    num_searches: int = USUAL_SEARCHES,
    out: str | Path | None = None,
    jobs: int | None = None,
    certificate: str | Path | Certificate | None = None,
) -> Drawers:
    """:func:`drawer` with one record of what determines a search."""
    require_count("num_searches", num_searches)
    made = searches.made()
    made.belief(0)  # which prepares what all searches share
    for decider in deciders:
        made.decider(decider)
    labels = list(targets) or list(made.shape_labels)
    if certificate is not None:
        if len(deciders) != 1:
            raise InvalidArgument(f"a certificate is for one decider, got {', '.join(deciders)}")
        searches = replace(searches, rules=made.certified(certificate, deciders[0], labels).rules)
    keys = [(decider, labels[number % len(labels)], number) for number in range(num_searches) for decider in deciders]
    kept = {} if out is None else read_searches(Path(out) / _FILE, searches)
    missing = [key for key in keys if key not in kept]
    tasks = [partial(_played, searches, missing[at : at + _AT_ONCE]) for at in range(0, len(missing), _AT_ONCE)]
    for found in run_tasks(tasks, jobs, "searching in trays"):
        kept |= found
        if out is not None:
            write_searches(Path(out) / _FILE, searches, kept)
    by_decider = {name: [kept[key] for key in keys if key[0] == name] for name in dict.fromkeys(deciders)}
    return Drawers(searches, by_decider)


def report(
    searches: Searches,
    deciders: Sequence[str],
    targets: Sequence[str],
    num_searches: int,
    out: Path,
    jobs: int,
    certificate: Path | None = None,
) -> None:
    """:func:`play`, print the table, and write the report."""
    claim_folder(out)
    start = time.perf_counter()
    found = play(searches, deciders, targets, num_searches, out, jobs, certificate)
    print(found.table(), end="\n\n")
    print(*found.verdict(), sep="\n")
    print(f"{time.perf_counter() - start:.0f} s; report: {found.save(out)}")


def _played(searches: Searches, keys: Sequence[Key]) -> dict[Key, TrayEpisode]:
    sensor = searches.made()
    return {key: sensor.search(key[1], key[0], (searches.seed, key[2])) for key in keys}


def _error(values: Sequence[float]) -> float:
    """Half the width of a 95 % interval of the mean."""
    return 1.96 * float(np.std(values, ddof=1)) / len(values) ** 0.5 if len(values) > 1 else 0.0


@dataclass(frozen=True)
class Drawer:
    """Find an object in a tray: places and turns of all objects are unknown, and every touch and way costs.

    Nothing is trained. What a press meets of each shape, on each face and in each turn, is computed once and kept.

    For example:

        activetouch drawer
        activetouch drawer scans --target mug --objects 5 --searches 20
        activetouch drawer --sensor coarse --deciders information_per_cost raster random --present 0.5
    """

    folder: Annotated[Path | None, tyro.conf.Positional] = None
    """Folder of mesh files that the objects may be; the twelve shapes of the scene many by default."""
    target: tuple[str, ...] = ()
    """Shapes that are sought, in turn; all by default."""
    sensor: str = "gel"
    """Scene whose pad comes down on the tray: gel, coarse or hard."""
    deciders: tuple[str, ...] = USUAL_DECIDERS
    """information_per_cost, raster or random, with or without settings; module:attribute; or process:COMMAND."""
    searches: Count = USUAL_SEARCHES
    """Searches of each decider."""
    objects: Count = 6
    """Objects in the tray."""
    present: Probability = 0.8
    """Probability that the target is in the tray."""
    size: tuple[_Edge, _Edge] = (400.0, 300.0)
    """Length and width of the tray [mm]."""
    strangers: Path | None = None
    """Folder of mesh files of other objects, which lie among these."""
    unlisted: Probability | None = None
    """Probability that an object is none of the shapes; 0.3 with --strangers, 0 without."""
    push: Annotated[float, Within(0.0, 5.0)] = 0.0
    """Largest distance along the tray's edges by which a touch moves an object [mm]."""
    travel: NotNegative = 20.0
    """Cost of a metre of travel, in touches."""
    sure: Share = 0.95
    """Stated probability from which the search ends."""
    certificate: Path | None = None
    """Certificate of activetouch certify --scene drawer, which says when searches of the only decider end."""
    seed: Seed = 0
    """Seed of objects and touches."""
    out: Path | None = None
    """Folder of the searches and the report, runs/drawer or runs/drawer-FOLDER by default; finished searches are
    kept."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes; the results do not depend on it."""

    @ends_claims
    def run(self) -> None:
        """Search, print the table, write the report."""
        check_arguments(self)
        tray = Tray(
            size=(self.size[0] / 1000.0, self.size[1] / 1000.0),
            num_objects=self.objects,
            present=self.present,
            push=self.push / 1000.0,
            unlisted=(0.0 if self.strangers is None else 0.3) if self.unlisted is None else self.unlisted,
        )
        rules = TrayRules(self.travel, self.sure)
        searches = Searches(self.sensor, self.folder, self.strangers or (), tray, rules, self.seed)
        out = self.out
        if out is None:
            out = Path("runs/drawer" if self.folder is None else f"runs/drawer-{in_file_names(self.folder.name)}")
        report(searches, self.deciders, self.target, self.searches, out, self.jobs, self.certificate)
