"""``activetouch compare``: live searches, the same ones for every decider, and a report."""

from __future__ import annotations

import json
import math
import re
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from rich.console import Console

from activetouch.rendering import RENDERERS
from belief import SearchProblem
from belief.errors import UnknownName
from experiments.arguments import BadArgument
from experiments.console import plain_console
from experiments.episodes import Setting
from experiments.parallel import default_jobs, run_lazily
from experiments.results import BOUND, CEILING, EPISODES_PER_SHARD, RunFolder, Seconds, ShardKey, read_episode
from experiments.sensors import require_policies, tell_shift
from experiments.shards import ShardTask, identity
from experiments.summary import Comparison, compare_episodes
from experiments.terminal import render_table
from experiments.verdict import verdict
from planners import DECIDERS

_CEILING_EPISODES = 50  # per target; each costs one touch for every object and pose


def require_seed(seed: int) -> None:
    """Check that chance can be had from a seed.

    Raises:
        BadArgument: it is negative.
    """
    if seed < 0:
        raise BadArgument(f"--seed must be at least 0, got {seed}")


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
    """

    deciders: tuple[str, ...] = ("point_based", "information_gain", "threshold", "random_confirm")
    """Who searches."""
    reference: str | None = None
    """The decider that differences are taken to; the first by default."""
    targets: tuple[str, ...] = ()
    """Shapes to search for; all by default."""
    episodes: int = 250
    """Searches per decider and target."""
    seed: int = 0
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
    jobs: int = field(default_factory=default_jobs)
    """Processes; the results do not depend on it."""
    backend: Literal["loky", "dask"] = "loky"
    """Processes of this machine, or workers of a Dask cluster; the results do not depend on it."""
    scheduler: str | None = None
    """Address of the Dask scheduler, such as tcp://10.0.0.1:8786."""
    part: str = "1/1"
    """Play only the i-th of n parts, such as 2/8, and summarise nothing."""

    @property
    def folder(self) -> Path:
        """Where the run is kept."""
        scene = self.setting.choice.scene
        return self.out if self.out is not None else Path("runs/compare" if scene == "gel" else f"runs/compare-{scene}")

    def run(self) -> None:
        """Play what is missing, then summarise everything."""
        console = plain_console()
        worlds = self.worlds()
        found = {name: compare._run_one(console) for name, compare in worlds.items()}
        if len(worlds) > 1 and all(found.values()):
            from experiments.overview import write_overview  # loads jinja2

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
            if name not in RENDERERS:
                raise UnknownName("renderer", name, list(RENDERERS))
        root, found = self.out if self.out is not None else Path("runs/compare-scenes"), {}
        for scene in dict.fromkeys(self.scenes or (choice.scene,)):
            for renderer in dict.fromkeys(self.renderers) or (choice.renderer,):
                name = scene if renderer is None else f"{scene}-{renderer}"
                sensor = self.setting.sensor
                if self.sensors is not None:
                    sensor = Path(self.sensors.replace("{scene}", scene).replace("{renderer}", str(renderer)))
                setting = replace(self.setting, choice=replace(choice, scene=scene, renderer=renderer), sensor=sensor)
                found[name] = replace(self, scenes=(), renderers=(), sensors=None, setting=setting, out=root / name)
        return found

    def _run_one(self, console: Console) -> Comparison | None:
        from experiments.report import write_report  # loads matplotlib

        if self.part != "1/1":
            self.fill()
            console.print(f"{self.folder} has its part; unite the parts with: activetouch merge A B --out C")
            return None
        comparison = self.play()
        console.print(render_table(comparison))
        for sentence in verdict(comparison):
            console.print(textwrap.fill(sentence, 78))
        report = write_report(self.folder, comparison, self.setting, self.seed)
        console.print(f"report: {report}", soft_wrap=True)
        return comparison

    def play(self) -> Comparison:
        """Play what is missing and read everything back.

        Raises:
            BadArgument: there is nothing to play, or no such search.
            UnknownName: a decider or target that does not exist.
            RunMismatch: the folder holds another run.
            CannotWrite: the disk is full.
            NoCluster: there is no cluster.
            WorkerMismatch: a worker of the cluster has other versions.
        """
        problem, targets = self.fill()
        labels = tuple(problem.shape_labels)
        folder, shards = RunFolder(self.folder), range(math.ceil(self.episodes / EPISODES_PER_SHARD))
        lines: dict[tuple[str, str], list[str]] = {}
        seconds: dict[tuple[str, str], Seconds] = {}
        for decider in dict.fromkeys(self.deciders):
            for target in targets:
                keys, cell = [ShardKey(decider, target, number) for number in shards], (decider, target)
                lines[cell] = [line for key in keys for line in folder.lines(key)][: self.episodes]
                seconds[cell] = sum(map(folder.seconds, keys), Seconds())
        folder.write_episodes(line for some in lines.values() for line in some)
        episodes = {cell: [read_episode(line, labels) for line in some] for cell, some in lines.items()}
        solved = {
            target: [json.loads(line)["solved"] for key in keys for line in folder.lines(key)][: self._num_ceiling]
            for target in targets
            if (keys := [key for key in self._ceiling_keys(targets) if key.target == target])
        }
        bounds = {t: json.loads(folder.lines(_bound_key(t))[0])["bound"] for t in targets if self.bound}
        rng, reference = np.random.default_rng(self.seed), self.reference or self.deciders[0]
        return compare_episodes(problem, episodes, seconds, solved, reference, rng, bounds)

    def fill(self) -> tuple[SearchProblem, list[str]]:
        """Play what is missing of this part; return the search and its targets. Raises as :meth:`play`."""
        problem, targets = self._check()
        first, parts = self._part()
        setting = self.setting.resolved()
        folder, shards = RunFolder(self.folder), range(math.ceil(self.episodes / EPISODES_PER_SHARD))
        warning = folder.open(dict(identity(setting, self.seed)), self._arguments())
        if warning:
            print(warning, file=sys.stderr)
        keys = [ShardKey(d, t, n) for d in dict.fromkeys(self.deciders) for t in targets for n in shards]
        keys += self._ceiling_keys(targets) + [_bound_key(target) for target in targets if self.bound]
        keys = [key for key in keys[first::parts] if not folder.has(key)]
        # Whoever else fills this folder now should not be one step behind all the time, doing everything again.
        np.random.default_rng().shuffle(keys)

        def missing() -> Iterator[ShardTask]:
            return (ShardTask.of(key, setting, self.seed) for key in keys if not folder.has(key))

        for played in run_lazily(missing(), len(keys), self.jobs, "searching", self.scheduler):
            folder.write(*played)
        return problem, targets

    @property
    def _num_ceiling(self) -> int:
        return min(self.episodes, _CEILING_EPISODES)

    def _ceiling_keys(self, targets: list[str]) -> list[ShardKey]:
        shards = range(math.ceil(self._num_ceiling / EPISODES_PER_SHARD))
        return [ShardKey(CEILING, target, number) for target in targets for number in shards]

    def _part(self) -> tuple[int, int]:
        """Number of this part, from 0, and of all."""
        found = re.fullmatch(r"(\d+)/(\d+)", self.part)
        if found is None or not 1 <= int(found[1]) <= int(found[2]):
            raise BadArgument(f"--part must be i/n with 1 ≤ i ≤ n, such as 2/8; got {self.part!r}")
        return int(found[1]) - 1, int(found[2])

    def _check(self) -> tuple[SearchProblem, list[str]]:
        """The search and the targets, or an error before anything is started or written."""
        try:
            problem = self.setting.problem
        except ValueError as error:
            raise BadArgument(str(error)) from error
        tell_shift(self.setting.shift)
        if self.episodes < 1 or self.jobs < 1 or not self.deciders:
            raise BadArgument("--episodes and --jobs must be at least 1, and --deciders must name one")
        require_seed(self.seed)
        if (self.backend == "dask") != (self.scheduler is not None):
            raise BadArgument("--backend dask and --scheduler ADDRESS go together; start one with: dask scheduler")
        self._part()
        for name in self.deciders:
            if name not in DECIDERS:
                raise UnknownName("decider", name, list(DECIDERS))
        if self.reference is not None and self.reference not in self.deciders:
            raise UnknownName("reference among --deciders", self.reference, list(self.deciders))
        for target in self.targets:
            if target not in problem.shape_labels:
                raise UnknownName("target", target, list(problem.shape_labels))
        for name in self.deciders:
            wanted = self.targets or problem.shape_labels
            require_policies(name, wanted, self.setting.choice.scene, self.setting.sensor_folder)
        return problem, list(dict.fromkeys(self.targets or problem.shape_labels))

    def _arguments(self) -> dict[str, object]:
        return {**asdict(self), "out": str(self.folder), "setting": self.setting.to_dict()}


def _bound_key(target: str) -> ShardKey:
    return ShardKey(BOUND, target, 0)
