"""Measure a fresh installation without extras: its size, its start-up, and the time until searches begin.

Run: python benchmarks/install_size.py [FOLDER]        # a finished environment such as .venv; a fresh one by default

Sizes are those after the first start, which writes the bytecode of what it loads. Times are medians of new processes:
by the clock, and of the processor, which other programs on the machine hardly lengthen.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent
ROUNDS = 5
FIRST_EPISODE = """
import sys, experiments.search.shards as shards
def begin(*arguments):
    raise SystemExit(0)
shards.play = begin
sys.argv = ["activetouch", "compare", "--jobs", "1", "--out", sys.argv[1]]
from experiments.cli import main
main()
"""

COMMANDS = {
    "activetouch compare --help": ["-m", "activetouch", "compare", "--help"],
    "activetouch compare, until the first episode": ["-c", FIRST_EPISODE, "run"],
}


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
    times = {what: time_of([str(folder / "bin/python"), *command], scratch) for what, command in COMMANDS.items()}
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


def time_of(command: list[str], folder: Path) -> tuple[float, float]:
    """Seconds of a process by the clock and of the processor, after a first start: medians."""
    found = np.array([_run(command, folder) for _ in range(ROUNDS + 1)])[1:]
    clock, processor = np.median(found, axis=0)
    return float(clock), float(processor)


def _run(command: list[str], folder: Path) -> tuple[float, float]:
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(done.stderr)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - started, used


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
