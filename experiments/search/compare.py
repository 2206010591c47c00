"""``activetouch compare``: the function :func:`activetouch.compare` as a command."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from belief.codec import from_fields
from belief.files import require_regular_file, unsealed_json
from belief.table import Table
from experiments.command_line.arguments import BadArgument, Cluster, Count, InFile, Jobs, OnCluster, Seed, Trust
from experiments.parallel import default_jobs
from experiments.scene_choice import in_file_names
from experiments.search.comparison import DEFAULT_DECIDERS, Comparison, played, prepared
from experiments.search.play import Setting
from planners.registry import DECIDERS

_DECIDERS_HELP = (
    f"Deciders, with settings as in 'information_gain(confirm=0.97)', module:attribute, sb3:model.zip of "
    f"Stable-Baselines3, or policy:module:attribute, a function from observation to action: {', '.join(DECIDERS)}. "
    "The others are compared with the first."
)


@dataclass(frozen=True)
class Compare:
    """Search live in MuJoCo with several deciders on identical episodes; print a table and write a report.

    Finished episodes are kept: after an interruption, the same command continues. More --episodes extend a run.

    For example:

        activetouch compare --scene coarse --deciders information_gain threshold --targets cone --episodes 1000
        activetouch compare --scene coarse --reference --episodes 100
        activetouch compare --config runs/compare/run.json --seed 1 --out runs/again
        activetouch compare --results mine.csv theirs.csv --control unperturbed.csv
    """

    deciders: Annotated[tuple[str, ...], tyro.conf.arg(help=_DECIDERS_HELP)] = DEFAULT_DECIDERS
    reference: InFile[str | None] = None
    """Decider that the others are compared with; the first by default."""
    full_information: Annotated[bool, tyro.conf.arg(name="reference")] = False
    """Add a row with what could be reached: every object is touched in every pose, before the most probable answer."""
    targets: tuple[str, ...] = ()
    """Shapes to search for; all by default."""
    episodes: Count = 250
    """Searches per decider and target."""
    seed: Seed = 0
    """Seed of the whole comparison."""
    setting: tyro.conf.OmitArgPrefixes[Setting] = field(default_factory=Setting)
    """Sensor and rules of all searches."""
    certificate: Path | None = None
    """File from activetouch certify: its decider also plays stopping by it."""
    out: Path | None = None
    """Folder of the run; by default runs/compare for the scene gel, runs/compare-SCENE for any other. Another
    comparison in it replaces the report; searches of other deciders are kept."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes; the results do not depend on it."""
    cluster: OnCluster = field(default_factory=Cluster)
    """Workers of other machines."""
    results: tuple[Path, ...] = ()
    """Play nothing; compare these: run folders, CSV files with seed, task, success (and length), or LeRobot's JSON."""
    control: tuple[Path, ...] = ()
    """With --results: file of the same episodes without what is tested, to subtract; one for all, or one for each."""
    config: Path | None = None
    """run.json of an earlier run, whose arguments become the defaults."""
    trust: bool = False
    """Run code of your own that only files name, such as a decider module:attribute."""

    @classmethod
    def from_config(cls, path: Path) -> Compare:
        """The comparison that a ``run.json``, or a folder with one, records, with the default number of jobs."""
        file = path / "run.json" if path.is_dir() else path
        if not require_regular_file(file, BadArgument).exists():
            raise BadArgument(f"--config {path} is not the run.json of a comparison: there is no file {file}")
        try:
            given: dict[str, Any] = dict(unsealed_json(file.read_text(encoding="utf-8"))["arguments"])
            setting = Setting.from_dict(given["setting"], Trust(path, everything=True))  # run() checks what it names
            named = {name: given[name] for name in ("deciders", "reference", "targets", "episodes", "seed")}
            named |= {"full_information": given.get("full_information", False)}
            named |= {"certificate": given.get("certificate"), "setting": setting, "out": file.parent, "config": path}
            return from_fields(cls, named)
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise BadArgument(f"--config {path} is not the run.json of a comparison: {error}") from error

    @property
    def folder(self) -> Path:
        """Folder of the run."""
        if self.out is not None:
            return self.out
        scene = self.setting.choice.scene
        return Path("runs/compare" if scene == "gel" else f"runs/compare-{in_file_names(scene)}")

    def run(self) -> None:
        """Play the missing searches, print the results, then write the report."""
        if self.results or self.control:
            from experiments.search.results import compare_results

            found = compare_results(self.results, self.reference, self.control, self.seed)
            whole = [replace(table, note="", rows=found.of_all_tasks(table.rows)) for table in found.tables()]
            _say([table for table in whole if table.rows], found.verdict())
            print(f"report: {found.save(Path('runs/results') if self.out is None else self.out)}")
            return
        if self.setting.choice.is_tray:
            self._in_a_tray()
            return
        if self.config is not None:
            asked, recorded = self._names(), Compare.from_config(self.config)._names()
            Trust(self.config, everything=self.trust).require(name for name in recorded if name in asked)
        comparison = self.play()
        _say([comparison], comparison.answer(), self.setting.choice.left_out)
        print(f"report, with all differences and intervals: {comparison.save(self.folder)}")

    def _in_a_tray(self) -> None:
        """Searches among objects in a tray, whose actions are places: those of ``activetouch drawer``."""
        from experiments.search.drawer.drawer import USUAL_DECIDERS, USUAL_SEARCHES, report
        from experiments.search.drawer.searches import Searches  # whose modules no other scene needs

        usual = Compare()
        if self.full_information or self.config:
            raise BadArgument("the scene drawer takes neither --full-information nor --config")
        searches = Searches.of(self.setting, self.seed)
        deciders = USUAL_DECIDERS if self.deciders == usual.deciders else self.deciders
        each = len(self.targets) or len(searches.made().shape_labels)
        number = USUAL_SEARCHES if self.episodes == usual.episodes else self.episodes * each
        report(searches, deciders, self.targets, number, self.folder, self.jobs, self.certificate)

    def play(self) -> Comparison:
        """Play the missing searches and return the comparison, without a report."""
        run = prepared(
            self.setting,
            self.deciders,
            targets=self.targets,
            episodes=self.episodes,
            seed=self.seed,
            out=self.folder,
            reference=self.reference,
            full_information=self.full_information,
            jobs=self.jobs,
            certificate=self.certificate,
        )
        return played(run, self.reference, self.jobs)

    def _names(self) -> list[str | None]:
        """Names of scene, renderer and deciders, which can be code."""
        return [self.setting.choice.scene, self.setting.choice.renderer, *self.deciders]


def _say(tables: Sequence[Table | Comparison], verdict: Sequence[str], lines: Sequence[str] = ()) -> None:
    """Print tables, sentences, and lines as they are."""
    for table in tables:
        print(table, end="\n\n")
    for sentence in verdict:
        print(textwrap.fill(sentence, 78))
    print(*lines, sep="\n", end="\n" if lines else "", flush=True)
