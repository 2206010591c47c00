"""Measure this version against an earlier one, in one interleaved run, and print ratios.

Run: git worktree add ../before ece93d3
     python benchmarks/versions.py ../before                    the parts of a touch
     python benchmarks/versions.py ../before --only "live touch"    some of these
     python benchmarks/versions.py ../before --commands         whole commands; some minutes
     python benchmarks/versions.py ../before --images           how far forces and images of the same presses agree

Each version has a process of its own, and the two take turns in short rounds. A ratio is taken within each round; the
table shows the median and the quartiles over rounds. Times are processor seconds of one thread. Commands are timed as
whole processes with one worker, start-up and report included.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent.parent
PER_ROUND, NUM_PRESSES = 48, 300
SEARCH, SEARCHES, NUM_TARGETS = "searches of compare", 5, 4
_PLAN = "--plan.train 250 --plan.calibration 1 --plan.test 1"
COMMANDS = {
    "compare --scene many, 2 of 12 targets": "compare --scene many --episodes 25 --targets cone torus --out {out}",
    "compare --scene many --episodes 25": "compare --scene many --episodes 25 --out {out}",
    "compare --scene gel": "compare --scene gel --out {out}",
    "compare --scene coarse (make search)": "compare --scene coarse --out {out}",
    "collect, quasistatic": f"collect --fidelity quasistatic {_PLAN} --out {{out}}",
    "collect, dynamic": f"collect {_PLAN} --out {{out}}",
    "collect, dynamic, coarse": f"collect --scene coarse {_PLAN} --out {{out}}",
}


def cases() -> dict[str, Callable[[int], object]]:
    """What to time in the version that this process imports, as functions of a running number."""
    from activetouch import SCENES, Quasistatic, TactileSensor, TouchWorld

    found: dict[str, Callable[[int], object]] = {}
    for name in ("gel", "coarse", "paper"):
        scene, rng = SCENES[name].scene, np.random.default_rng(0)
        sensor = TactileSensor.shipped(name)
        things = [scene.sample_object(index % len(scene.shapes), rng) for index in range(PER_ROUND)]
        worlds = [TouchWorld(sensor, [thing]) for thing in things]
        found[f"{name}: live touch, pressed and read"] = _touch(worlds)
        found[f"{name}: press and image"] = _press(scene, things)
        if name != "paper":
            found[f"{name}: quasistatic press and image"] = _press(replace(scene, press_model=Quasistatic()), things)
        images = np.stack([scene.press(thing, 0, rng).image for thing in things])
        found[f"{name}: one image read"] = _read(sensor, images)
        if name != "paper":
            found[f"{name}: {SEARCH}"] = _search(name)
    return found


def _touch(worlds: list[Any]) -> Callable[[int], object]:
    return lambda index: worlds[index].touch(index % 6, np.random.default_rng(index))


def _press(scene: Any, things: list[Any]) -> Callable[[int], object]:
    return lambda index: scene.press(things[index], index % 6, np.random.default_rng(index))


def _read(sensor: Any, images: np.ndarray[Any, Any]) -> Callable[[int], object]:
    return lambda index: sensor.read(images[index : index + 1], [0])


def _search(scene: str) -> Callable[[int], object]:
    """Play the searches of one target as ``activetouch compare`` does: its four deciders."""
    from experiments.scene_choice import SceneChoice
    from experiments.search.comparison import DEFAULT_DECIDERS, prepared
    from experiments.search.play import Setting, play_episodes

    run, numbers = prepared(Setting(SceneChoice(scene)), DEFAULT_DECIDERS, seed=1, jobs=1), range(SEARCHES)

    def play(target: int) -> None:
        for decider in run.deciders.values():
            play_episodes(run.searches, decider, target, numbers)

    return play


def serve() -> None:
    """Time a case for each line of the standard input, and answer with milliseconds per call."""
    known = cases()
    print("|".join(known), flush=True)
    for line in sys.stdin:
        name = line.strip()
        number = NUM_TARGETS if SEARCH in name else PER_ROUND
        started = time.process_time()
        for index in range(number):
            known[name](index)
        print(1e3 * (time.process_time() - started) / number, flush=True)


def press_all() -> None:
    """Print force and image digest of the same presses in every scene."""
    from activetouch import SCENES

    for name, named in SCENES.items():
        for index in range(NUM_PRESSES):
            rng = np.random.default_rng([7, index])
            thing = named.scene.sample_object(index % len(named.scene.shapes), rng)
            pressed = named.scene.press(thing, index % 6, rng)
            print(name, pressed.contact.force, hashlib.sha256(pressed.image.tobytes()).hexdigest())


def compare_images(before: Path) -> None:
    """Print how far forces and images of the same presses agree, in every scene that both versions have."""
    found: list[dict[str, list[tuple[float, str]]]] = []
    for folder in (before, HERE):
        command, pressed = [sys.executable, __file__, "--press-all"], defaultdict(list)
        output = subprocess.run(command, check=True, capture_output=True, text=True, env=environment(folder)).stdout
        for scene, force, digest in map(str.split, output.splitlines()):
            pressed[scene].append((float(force), digest))
        found.append(pressed)
    for scene in (scene for scene in found[1] if scene in found[0]):
        pairs = list(zip(found[0][scene], found[1][scene], strict=True))
        same = sum(one[1] == other[1] for one, other in pairs)
        worst = max(abs(other[0] / one[0] - 1.0) for one, other in pairs if one[0] > 0.0)
        print(f"{scene}: {same} of {len(pairs)} images identical, force differs by at most {worst:.2g} (relative)")


class Version:
    """A process that imports one version of the packages."""

    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, __file__, "--serve"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment(folder),
        )
        self.names = self._line().split("|")

    def time(self, name: str) -> float:
        """Milliseconds per call of a case."""
        assert self.process.stdin is not None
        print(name, file=self.process.stdin, flush=True)
        return float(self._line())

    def end(self) -> None:
        """End the process, and wait for it, so that its time counts."""
        self.process.communicate()

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()


def environment(folder: Path) -> dict[str, str]:
    """The environment in which Python imports the packages of a folder and uses one thread."""
    own = {"PYTHONPATH": str(folder.resolve()), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
    return {**os.environ, **own}


def compare(names: Iterable[str], measure: Callable[[str], tuple[float, float]], rounds: int, unit: str) -> None:
    """Measure both versions of everything that is named, and print a row for each."""
    print(f"{'median over rounds':<42}{'before':>10}{'now':>10}{'now / before':>20}")
    for name in names:
        times = []
        for round_ in range(rounds + 1):  # the first round compiles and warms up, and writes bytecode
            times.append(measure(name))
            if unit == "s":
                print(f"    round {round_}: {times[-1][0]:.1f} {unit}, {times[-1][1]:.1f} {unit}", flush=True)
        before, now = np.array(times[1:]).T
        low, middle, high = np.quantile(now / before, [0.25, 0.5, 0.75])
        print(
            f"{name:<42}{np.median(before):10.3f}{np.median(now):10.3f} {unit:2}{middle:8.2f} [{low:.2f}, {high:.2f}]",
            flush=True,
        )


def _seconds(folder: Path, arguments: str) -> float:
    """Processor seconds of a command and its workers."""
    with tempfile.TemporaryDirectory() as out:
        command = [
            sys.executable,
            "-m",
            "experiments.cli",
            *arguments.format(out=Path(out) / "run").split(),
            "--jobs",
            "1",
        ]
        started = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            command,
            check=True,
            cwd=out,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=environment(folder),
        )
        ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return ended.ru_utime + ended.ru_stime - started.ru_utime - started.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("before", nargs="?", type=Path, help="folder of the earlier version")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--only", nargs="*", default=[], help="time the parts whose names hold one of these words")
    parser.add_argument("--commands", nargs="*", help="time whole commands; words of their names select some")
    parser.add_argument("--images", action="store_true", help="compare forces and images instead of times")
    parser.add_argument("--press-all", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve()
        return
    if arguments.press_all:
        press_all()
        return
    if arguments.before is None or not (arguments.before / "activetouch").is_dir():
        parser.error("give the folder of an earlier version, such as a git worktree of its commit")
    if arguments.images:
        compare_images(arguments.before)
        return
    words = arguments.only if arguments.commands is None else arguments.commands

    def chosen(names: Iterable[str]) -> list[str]:
        return [name for name in names if not words or any(word in name for word in words)]

    if arguments.commands is None:
        earlier, this = Version(arguments.before), Version(HERE)
        compare(chosen(this.names), lambda name: (earlier.time(name), this.time(name)), arguments.rounds, "ms")
        for version in (earlier, this):
            version.end()
        return

    def seconds(name: str) -> tuple[float, float]:
        return tuple(_seconds(folder, COMMANDS[name]) for folder in (arguments.before, HERE))

    compare(chosen(COMMANDS), seconds, arguments.rounds, "s")


if __name__ == "__main__":
    main()
