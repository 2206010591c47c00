"""Build the wheel, install it alone in a fresh environment, and measure its size and the time to the first result.

Run: python benchmarks/install_size.py [ARGUMENTS OF compare]        # --scene coarse --episodes 25 by default

The first result is the table, the verdict and the report of the README's comparison. Seconds are by the clock and of
the processor, in the first process of a new installation, which writes bytecode, and again in a new folder. Sizes are
sums of file lengths in site-packages: without bytecode, after the first result, and with all bytecode.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

ROOT = Path(__file__).parent.parent
COMPARE = ["--scene", "coarse", "--episodes", "25"]
TOOLS = ("pip", "setuptools", "pkg_resources", "_distutils_hack")  # in a new environment before anything is installed


def main(arguments: list[str]) -> None:
    with tempfile.TemporaryDirectory() as holder:
        scratch = Path(holder).resolve()
        pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
        # Setuptools would also pack files that an earlier build left here.
        shutil.rmtree(ROOT / "build" / "lib", ignore_errors=True)
        subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", holder, str(ROOT)], check=True)
        [wheel] = scratch.glob("*.whl")
        print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB")
        venv.create(scratch / "environment", with_pip=True)
        constraints = ["-c", str(ROOT / "constraints.txt")]
        python = str(scratch / "environment/bin/python")
        took, _ = time_of(
            [python, "-m", "pip", "install", "--quiet", "--no-compile", *constraints, str(wheel)], scratch
        )
        print(f"installed in {took:.0f} s; Python {sys.version.split()[0]}, {os.cpu_count()} processors")
        [packages] = (scratch / "environment").glob("lib/python*/site-packages")
        print_size(packages, "without bytecode")
        command = [str(scratch / "environment/bin/activetouch"), "compare", *arguments]
        for which in ("first", "second"):
            folder = scratch / which
            folder.mkdir()
            load = os.getloadavg()[0]
            clock, processor = time_of(command, folder)
            report = next(folder.rglob("report.html"))
            print(
                f"{which} activetouch compare {' '.join(arguments)}: {clock:.1f} s by the clock, {processor:.1f} s of "
                f"the processor, at load {load:.1f} before; report {report.stat().st_size / 1e6:.1f} MB"
            )
            if which == "first":
                print_size(packages, "after the first result")
        subprocess.run([python, "-m", "compileall", "-q", str(packages)], check=False, capture_output=True)
        print_size(packages, "with all bytecode")


def print_size(packages: Path, when: str) -> None:
    """Print the total length of all files of an environment, and the largest packages."""
    sizes = {path.name: size_of(path) for path in packages.iterdir()}
    tools = sum(size for name, size in sizes.items() if name.startswith(TOOLS))
    largest = sorted(sizes.items(), key=lambda pair: -pair[1])[:5]
    print(
        f"{when}: {sum(sizes.values()) - tools:.0f} MB, and pip and setuptools {tools:.0f} MB; largest: "
        + ", ".join(f"{name} {size:.0f}" for name, size in largest)
        + f"; torch {'' if 'torch' in sizes else 'not '}installed"
    )


def size_of(path: Path) -> float:
    """Length of a file, or of all files in a folder [MB]."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.lstat().st_size for file in files if file.is_file()) / 1e6


def time_of(command: list[str], folder: Path, more: dict[str, str] | None = None) -> tuple[float, float]:
    """Seconds by the clock and of the processor of a command and its children."""
    known = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, cwd=folder, env=known | (more or {}), stdout=subprocess.DEVNULL)
    clock = time.perf_counter() - started
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main(sys.argv[1:] or COMPARE)
