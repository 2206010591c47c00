"""Measure a fresh installation without extras: its size, its start-up, and the time until searches begin.

Run: python benchmarks/install_size.py [FOLDER]        # a finished environment such as .venv; a fresh one by default

Sizes are those after the first start, which writes the bytecode of what it loads. Times are medians of new processes:
by the clock, and of the processor, which other programs on the machine hardly lengthen.
"""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent
ROUNDS = 5
HELP = ("compare", "--help")
FIRST = "run/shards/threshold-cone-00000.jsonl"
ONE_SEARCH = (
    "compare",
    "--episodes",
    "1",
    "--deciders",
    "threshold",
    "--targets",
    "cone",
    "--jobs",
    "1",
    "--out",
    "run",
)


def main(folder: Path | None) -> None:
    with tempfile.TemporaryDirectory() as holder:
        if folder is None:
            folder = Path(holder, "environment")
            venv.create(folder, with_pip=True)
            constraints = ["-c", str(ROOT / "constraints.txt")]
            install = [folder / "bin/pip", "install", "--quiet", "--no-compile", *constraints, str(ROOT)]
            subprocess.run(install, check=True)
        measure(folder.resolve(), Path(holder))


def measure(folder: Path, scratch: Path) -> None:
    command = [str(folder / "bin/python"), "-m", "activetouch"]
    times = {
        "activetouch compare --help": median_of(lambda: time_of([*command, *HELP], scratch)),
        "activetouch compare, until the first search has ended": median_of(
            lambda: time_of([*command, *ONE_SEARCH], scratch, FIRST)
        ),
    }
    [packages] = folder.glob("lib/python*/site-packages")
    sizes = {path.name: size_of(path) for path in packages.iterdir()}
    tools = sum(size for name, size in sizes.items() if name.startswith(("pip", "setuptools", "pkg_resources")))
    largest = sorted(sizes.items(), key=lambda pair: -pair[1])[:6]
    print(f"site-packages: {sum(sizes.values()):.0f} MB, of which pip and setuptools {tools:.0f} MB")
    print("largest: " + ", ".join(f"{name} {size:.0f} MB" for name, size in largest))
    for package in ("torch", "transformers", "stable_baselines3"):
        print(f"{package}: {'installed' if (packages / package).exists() else 'not installed'}")
    for what, (clock, processor) in times.items():
        print(f"{what}: {clock:.2f} s, {processor:.2f} s of the processor")


def size_of(path: Path) -> float:
    """Disk blocks of a file or a folder [MB], as ``du`` counts them."""
    files = [path, *path.rglob("*")] if path.is_dir() else [path]
    return sum(file.lstat().st_blocks for file in files) * 512 / 1e6


def median_of(measure: Callable[[], tuple[float, float]]) -> tuple[float, float]:
    """Medians of a measurement, which is made once beforehand."""
    measure()
    clock, processor = np.median([measure() for _ in range(ROUNDS)], axis=0)
    return float(clock), float(processor)


def time_of(command: list[str], folder: Path, awaited: str | None = None) -> tuple[float, float]:
    """Seconds by the clock and of the processor until a process has ended, or has written a file."""
    shutil.rmtree(folder / "run", ignore_errors=True)
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)
    while process.poll() is None and not (awaited and (folder / awaited).exists()):
        time.sleep(0.01)
    clock = time.perf_counter() - started
    if process.poll() is None:
        process.terminate()
    elif process.returncode != 0:
        sys.exit(f"{' '.join(command)} failed")
    process.wait()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
