"""``activetouch compare``: live searches, the same ones for every decider, and a report."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from belief import Composition, SearchProblem
from belief.errors import ActiveTouchError, UnknownName
from belief.files import require_writable, unsealed_json
from experiments.command_line.arguments import BadArgument, Count, Jobs, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.parallel import default_jobs
from experiments.scene_choice import in_file_names, renderer_named
from experiments.search.holdings import Holdings, Selection
from experiments.search.resume import play_missing, shard_sizes
from experiments.search.run_folder import BOUND, ORACLE, RunFolder
from experiments.search.setting import Setting
from experiments.search.shards import made_by
from experiments.search.summary import Comparison
from experiments.search.terminal import terminal_table
from experiments.search.verdict import verdict
from experiments.sensor_choice import command, require_policies, tell_shift
from planners.registry import DECIDERS, find_decider, summary_of

_DECIDERS_HELP = (
    "Deciders to compare, with settings where wanted, such as 'information_gain(confirm=0.97)'; or module:attribute of "
    "your own, such as 'mine:TwoLooks(touches=4)'. Known are:\n"
    + "\n".join(f"{name}: {summary_of(name)}" for name in DECIDERS)
)


@dataclass(frozen=True)
class Compare:
    """Search live in MuJoCo with several deciders on identical episodes; print a table, write a report.

    Finished episodes are kept: interrupt with Ctrl-C whenever you like, the same command goes on from there, and a
    larger ``--episodes`` extends a finished run. Several machines may work on one folder at once, on a Dask cluster
    (``--backend dask``), or each on its part (``--part 1/2``), to be united by ``activetouch merge``.

    For example:

        activetouch compare
        activetouch compare --deciders threshold information_gain --targets cone --episodes 1000 --out runs/cone
        activetouch compare --scene coarse
        activetouch compare --scenes coarse gel
        activetouch compare --renderers pressure gelsight --sensors 'runs/sensor-{scene}-{renderer}'
        activetouch compare --backend dask --scheduler tcp://10.0.0.1:8786
        activetouch compare --config runs/compare/run.json --seed 1 --out runs/again
    """

    deciders: Annotated[tuple[str, ...], tyro.conf.arg(help=_DECIDERS_HELP)] = (
        "point_based",
        "information_gain",
        "threshold",
        "random_confirm",
    )
    reference: str | None = None
    """The decider that differences are taken to; the first by default."""
    targets: tuple[str, ...] = ()
    """Shapes to search for; all by default."""
    episodes: Count = 250
    """Searches per decider and target."""
    seed: Seed = 0
    """Of the whole comparison."""
    setting: Annotated[Setting, tyro.conf.arg(name="")] = field(default_factory=Setting)
    """What the episodes have in common."""
    scenes: tuple[str, ...] = ()
    """Several scenes, one comparison each, and a page that shows them side by side; instead of --scene."""
    renderers: tuple[str, ...] = ()
    """Several renderers of every scene; instead of --renderer."""
    sensors: str | None = None
    """Where their sensors are, with {scene} and {renderer}; those that come with the scenes by default."""
    out: Path | None = None
    """Folder of the run; runs/compare, or runs/compare-SCENE for another scene than gel, by default."""
    bound: bool = False
    """Also find an upper bound on the expected return for the discretised sensor model, in which touches are
    independent given the shape; live touches are neither, so live returns can exceed it. Some minutes a target."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Processes; the results do not depend on it."""
    backend: Literal["loky", "dask"] = "loky"
    """Processes of this machine, or workers of a Dask cluster; the results do not depend on it."""
    scheduler: str | None = None
    """Address of the Dask scheduler, such as tcp://10.0.0.1:8786."""
    part: str = "1/1"
    """Play only the i-th of n parts, such as 2/8, and summarise nothing."""
    config: Path | None = None
    """The run.json of an earlier run: its arguments are the defaults of this one, except for --jobs, and its folder is
    the default of --out."""

    @classmethod
    def from_config(cls, path: Path) -> Compare:
        """The comparison that a ``run.json`` records: in the file's folder, with the default number of jobs.

        Args:
            path: the file, or the run's folder.

        Raises:
            BadArgument: it is not the ``run.json`` of a comparison.
        """
        file = path / "run.json" if path.is_dir() else path
        try:
            recorded = unsealed_json(file.read_text(encoding="utf-8"))["arguments"]
            given: dict[str, Any] = {
                key: tuple(value) if isinstance(value, list) else value for key, value in recorded.items()
            }
            del given["jobs"]
            setting = Setting.from_dict(given["setting"])
            return cls(**{**given, "setting": setting, "out": file.parent, "config": path})
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise BadArgument(f"--config {path} is not the run.json of a comparison: {error}") from error

    @property
    def folder(self) -> Path:
        """Where the run is kept."""
        if self.out is not None:
            return self.out
        scene = self.setting.choice.scene
        return Path("runs/compare" if scene == "gel" else f"runs/compare-{in_file_names(scene)}")

    def run(self) -> None:
        """Play what is missing, then summarise everything."""
        console = plain_console()
        worlds = self.worlds()
        found = {name: compare._run_one(console) for name, compare in worlds.items()}
        if len(worlds) > 1 and all(found.values()):
            from experiments.search.overview import write_overview  # loads jinja2

            root = next(iter(worlds.values())).folder.parent
            page = write_overview(root, {name: comparison for name, comparison in found.items() if comparison})
            console.print(f"all of them side by side: {page}", soft_wrap=True)

    def worlds(self) -> dict[str, Compare]:
        """A comparison for every scene and renderer that was asked for, by name; only this one if none was.

        Raises:
            BadArgument: --scene beside --scenes, or the like.
            UnknownName: a scene or renderer that does not exist.
        """
        choice = self.setting.choice
        if not self.scenes and not self.renderers:
            if self.sensors is not None:
                raise BadArgument("--sensors is for --scenes or --renderers; name a single sensor with --sensor")
            return {choice.scene: self}
        for plural, chosen in ((self.scenes, choice.scene != "gel"), (self.renderers, choice.renderer is not None)):
            if plural and chosen:
                raise BadArgument("give either --scene or --scenes, and either --renderer or --renderers")
        for name in self.renderers:
            renderer_named(name)  # or say which there are
        root, found = self.out if self.out is not None else Path("runs/compare-scenes"), {}
        for scene in dict.fromkeys(self.scenes or (choice.scene,)):
            for renderer in dict.fromkeys(self.renderers) or (choice.renderer,):
                name = in_file_names(scene if renderer is None else f"{scene}-{renderer}")
                sensor = self.setting.sensor
                if self.sensors is not None:
                    sensor = Path(
                        self.sensors.replace("{scene}", in_file_names(scene)).replace(
                            "{renderer}", in_file_names(str(renderer))
                        )
                    )
                setting = replace(self.setting, choice=replace(choice, scene=scene, renderer=renderer), sensor=sensor)
                found[name] = replace(self, scenes=(), renderers=(), sensors=None, setting=setting, out=root / name)
        return found

    def of_sensor(self, folder: Path | None) -> Compare:
        """The same comparison with the sensor in this folder."""
        return replace(self, setting=replace(self.setting, sensor=folder))

    def _run_one(self, console: Console) -> Comparison | None:
        if self.part != "1/1":
            self.fill()
            other, union = (self.folder.with_name(f"{self.folder.name}-{word}") for word in ("other", "all"))
            console.print(
                f"{self.folder} has part {self.part}. If the others are in folders of their own, here {other}, unite "
                f"them with:\n{command('merge', self.folder, other, out=union)}",
                soft_wrap=True,
            )
            return None
        comparison, report, told = self.report()
        console.print(terminal_table(comparison, console.width).rich())
        for sentence in verdict(comparison):
            console.print(textwrap.fill(sentence, 78))
        for sentence in told:
            console.print(textwrap.fill(sentence, 78))
        console.print(f"report: {report}", soft_wrap=True)
        return comparison

    def report(self) -> tuple[Comparison, Path, list[str]]:
        """Play what is missing and write the report.

        Returns:
            What was asked for, the page, and in words what else the folder holds.

        Raises:
            ActiveTouchError: as :meth:`play`.
        """
        from experiments.search.report import write_report  # loads matplotlib

        comparison = self.play()
        held, told = self.held()
        return comparison, write_report(self.folder, held, self.setting, self.seed, told), told

    def play(self) -> Comparison:
        """Play what is missing and read back what was asked for.

        ``episodes.jsonl`` tells everything that the folder holds of those who play now.

        Raises:
            BadArgument: there is nothing to play, or no such search.
            UnknownName: a decider or target that does not exist.
            RunMismatch: the folder holds another run.
            CannotWrite: the disk is full.
            NoCluster: there is no cluster.
            WorkerMismatch: a worker of the cluster has other versions.
        """
        problem, targets = self.fill()
        holdings = self._holdings()
        RunFolder(self.folder).write_episodes(holdings.episodes())
        return holdings.compare(problem, self._selection(targets), self._reference, self.seed, self.bound)

    def held(self) -> tuple[Comparison, list[str]]:
        """The largest comparison that the folder holds, and in words what else it holds; nothing is played."""
        problem, targets = self._check()
        holdings, asked = self._holdings(), self._selection(targets)
        chosen, told = holdings.largest(asked), []
        if chosen != asked:
            told.append(
                f"The report tells more than was asked for: {chosen}."
                if asked in chosen
                else f"The report keeps the larger comparison in this folder: {chosen}."
            )
        beyond = holdings.beyond(chosen)
        if beyond:
            words = ", ".join(f"{num} of {name}" for name, num in beyond.items())
            told.append(
                f"Not in the report, as not all of its deciders have played the same, are searches: {words}. They are "
                f"in {self.folder / 'episodes.jsonl'}."
            )
        reference = self._reference if self._reference in chosen.deciders else chosen.deciders[0]
        bounds = all((BOUND, target) in holdings.shards for target in chosen.targets)
        return holdings.compare(problem, chosen, reference, self.seed, bounds), told

    def fill(self) -> tuple[SearchProblem, list[str]]:
        """Play what is missing of this part; return the search and its targets. Raises as :meth:`play`."""
        problem, targets = self._check()
        tell_shift(self.setting.shift)
        sizes = shard_sizes(self._players, targets, self.episodes)
        play_missing(
            RunFolder(self.folder),
            self.setting.resolved(),
            self.seed,
            sizes,
            self._arguments(),
            part=self._part(),
            jobs=self.jobs,
            scheduler=self.scheduler,
        )
        return problem, targets

    @property
    def _players(self) -> list[str]:
        return [*dict.fromkeys(self.deciders), ORACLE, *([BOUND] if self.bound else [])]

    @property
    def _reference(self) -> str:
        return self.reference or self.deciders[0]

    def _selection(self, targets: list[str]) -> Selection:
        return Selection(tuple(dict.fromkeys(self.deciders)), tuple(targets), self.episodes)

    def _holdings(self) -> Holdings:
        """What the folder holds of those who play now, asked for or not."""
        setting, folder = self.setting.resolved(), RunFolder(self.folder)
        current: dict[str, dict[str, str]] = {}
        for decider, by_target in folder.read_run()["made_by"].items():
            for target, digest in by_target.items():
                try:
                    now = made_by(setting, decider, target)
                except (ActiveTouchError, ValueError):
                    continue  # it is no more
                if now == digest:
                    current.setdefault(decider, {})[target] = digest
        return Holdings.of(folder, current)

    def _part(self) -> tuple[int, int]:
        """Number of this part, from 0, and of all."""
        found = re.fullmatch(r"(\d+)/(\d+)", self.part)
        if found is None or not 1 <= int(found[1]) <= int(found[2]):
            raise BadArgument(f"--part must be i/n with 1 ≤ i ≤ n, such as 2/8; got {self.part!r}")
        return int(found[1]) - 1, int(found[2])

    def _check(self) -> tuple[SearchProblem, list[str]]:
        """The search and the targets, or an error before anything is started or written."""
        check_arguments(self)
        named, num_objects = self.setting.choice.named, self.setting.num_objects
        composition, shapes = self.setting.composition or named.composition, named.scene.shape_labels
        if num_objects is not None and num_objects > len(shapes) and composition == Composition.DISTINCT:
            raise BadArgument(
                f"--num-objects {num_objects}: there are only {len(shapes)} shapes ({', '.join(shapes)}), and all "
                "objects are to differ; add --composition independent, and each may have any shape"
            )
        try:
            problem = self.setting.problem
        except ValueError as error:
            raise BadArgument(str(error)) from error
        self.setting.shift  # noqa: B018  refuses the sensor of another scene
        if not self.deciders:
            raise BadArgument(f"--deciders must name one or more of {', '.join(DECIDERS)}; got none")
        if (self.backend == "dask") != (self.scheduler is not None):
            raise BadArgument("--backend dask and --scheduler ADDRESS go together; start one with: dask scheduler")
        self._part()
        require_writable(self.folder)
        for name in self.deciders:
            if isinstance(player := self.setting.player(name), str):
                find_decider(player)
        if self.reference is not None and self.reference not in self.deciders:
            raise UnknownName("reference among --deciders", self.reference, list(self.deciders))
        for target in self.targets:
            if target not in problem.shape_labels:
                raise UnknownName("target", target, list(problem.shape_labels))
        for player in map(self.setting.player, self.deciders):
            if isinstance(player, str):
                wanted = self.targets or problem.shape_labels
                require_policies(player, wanted, self.setting.choice.scene, self.setting.sensor_folder)
        return problem, list(dict.fromkeys(self.targets or problem.shape_labels))

    def _arguments(self) -> dict[str, object]:
        told = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "config"}
        return {**told, "out": str(self.folder), "setting": self.setting.to_dict()}
