"""Measure this version against an earlier one, in one interleaved run, and print ratios.

Run: git worktree add ../before ece93d3
     python benchmarks/versions.py ../before                    the parts of a touch
     python benchmarks/versions.py ../before --only "live touch"    some of these
     python benchmarks/versions.py ../before --commands         whole commands; some minutes
     python benchmarks/versions.py ../before --images           how far forces and images of the same presses agree

Each version has a process of its own. The two take turns in short rounds, so that other load and changes of the
processor's speed affect both; a ratio is taken within each round, and the table shows the median and the quartiles over
rounds. Times are processor seconds of one thread. Commands are timed as whole processes with one worker, start-up and
report included.
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
from collections.abc import Callable
from contextlib import suppress
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
    """Plays the searches of one target as ``activetouch compare`` does: its four deciders and the oracle."""
    from experiments.scene_choice import SceneChoice
    from experiments.search.oracle import solved_by_full_information
    from experiments.search.setting import Setting, play_episodes

    setting, numbers = Setting(SceneChoice(scene)), range(SEARCHES)

    def play(target: int) -> None:
        shared: list[Any] = []  # images of touches that several deciders make, in versions that keep them
        with suppress(ImportError):
            from experiments.search.touch_memo import TouchMemo

            shared.append(TouchMemo())
        for decider in ("point_based", "information_gain", "threshold", "random_confirm"):
            play_episodes(setting, decider, target, 1, numbers, *shared)
        solved_by_full_information(setting, target, 1, numbers, *shared)

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
    found: list[list[list[str]]] = []
    for folder in (before, HERE):
        command = [sys.executable, __file__, "--press-all"]
        output = subprocess.run(command, check=True, capture_output=True, text=True, env=environment(folder)).stdout
        found.append([line.split() for line in output.splitlines()])
    for scene in dict.fromkeys(name for name, *_ in found[1]):
        pairs = [(one, other) for one, other in zip(*found, strict=True) if other[0] == scene]
        same = sum(one[2] == other[2] for one, other in pairs)
        worst = max(abs(float(other[1]) / float(one[1]) - 1.0) for one, other in pairs if float(one[1]) > 0.0)
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

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()


def environment(folder: Path) -> dict[str, str]:
    """The environment in which Python imports the packages of a folder and uses one thread."""
    own = {"PYTHONPATH": str(folder.resolve()), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
    return {**os.environ, **own}


def row(name: str, before: list[float], after: list[float], unit: str) -> None:
    ratios = np.array(after) / np.array(before)
    low, middle, high = np.quantile(ratios, [0.25, 0.5, 0.75])
    print(
        f"{name:<42}{np.median(before):10.3f}{np.median(after):10.3f} {unit}{middle:8.2f} [{low:.2f}, {high:.2f}]",
        flush=True,
    )


def compare_parts(before: Path, rounds: int, chosen: list[str]) -> None:
    versions = [Version(before), Version(HERE)]
    for name in versions[1].names:
        if chosen and not any(word in name for word in chosen):
            continue
        times: list[list[float]] = [[], []]
        for round_ in range(rounds + 1):
            for version, found in zip(versions, times, strict=True):
                milliseconds = version.time(name)
                if round_:  # the first round compiles and warms up
                    found.append(milliseconds)
        row(name, times[0], times[1], "ms")


def compare_commands(before: Path, rounds: int, chosen: list[str]) -> None:
    for name, arguments in COMMANDS.items():
        if chosen and not any(word in name for word in chosen):
            continue
        times: list[list[float]] = [[], []]
        with tempfile.TemporaryDirectory() as plans:
            for round_ in range(rounds + 1):
                taken = [_seconds(folder, arguments, Path(plans)) for folder in (before, HERE)]
                print(f"    round {round_}: {taken[0]:.1f} s, {taken[1]:.1f} s", flush=True)
                if round_:  # the first one writes bytecode and plans
                    for seconds, found in zip(taken, times, strict=True):
                        found.append(seconds)
        row(name, times[0], times[1], "s ")


def _seconds(folder: Path, arguments: str, plans: Path) -> float:
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
            env={**environment(folder), "ACTIVETOUCH_PLANS": str(plans)},
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
    print(f"{'median over rounds':<42}{'before':>10}{'now':>10}{'now / before':>20}")
    if arguments.commands is None:
        compare_parts(arguments.before, arguments.rounds, arguments.only)
    else:
        compare_commands(arguments.before, arguments.rounds, arguments.commands)


if __name__ == "__main__":
    main()
