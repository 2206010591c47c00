"""Run a command of the pages and keep what it prints as a record: command, commit, versions, processor time, output.

Run: python docs/generate/run_record.py planners/outcomes -- python benchmarks/outcomes.py
     python docs/generate/run_record.py planners/all build/deciders.csv -- python benchmarks/deciders.py --out build

The first writes records/planners/outcomes.txt, the second also keeps a file that the command writes. The command
runs on one thread, from the root of the repository. Nothing is kept if it fails, or if the code differs from the
commit. A test compares the pages with the records.
"""

from __future__ import annotations

import os
import re
import resource
import shlex
import subprocess
import sys
import time
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from planners.fingerprint import versions

ROOT = Path(__file__).parent.parent.parent
RECORDS = ROOT / "records"
CODE = ("activetouch", "belief", "planners", "experiments", "benchmarks", "examples")
PROGRAMS = {"python": [sys.executable], "activetouch": [sys.executable, "-m", "experiments.cli"]}
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
PROGRESS = "━"  # in the lines of a progress bar
_FOLDER = re.compile(r"(?<![\w./:])/(?:[\w.+-]+/)+")


def commit() -> str:
    """The commit of the code that runs; code that is not committed is refused."""
    changed = _git("status", "--porcelain", "--", *CODE)
    if changed:
        raise SystemExit(f"commit the code before you record what it finds:\n{changed}")
    return _git("rev-parse", "--short=10", "HEAD")


def run(words: list[str]) -> tuple[str, float]:
    """What a command prints, without folders of this machine, and the processor time it takes [s]."""
    environment = os.environ | dict.fromkeys(THREADS, "1") | {"PYTHONPATH": str(ROOT), "HF_HUB_OFFLINE": "1"}
    found = subprocess.run([*PROGRAMS[words[0]], *words[1:]], cwd=ROOT, env=environment, stdout=subprocess.PIPE)
    if found.returncode:
        raise SystemExit(f"no record, because the command failed with status {found.returncode}: {shlex.join(words)}")
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return _FOLDER.sub("", found.stdout.decode().replace(f"{ROOT}/", "")), used.ru_utime + used.ru_stime


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def main(name: str, files: list[str], words: list[str]) -> None:
    """Run a command, and write its record, with the files that it wrote."""
    if not words or words[0] not in PROGRAMS:
        raise SystemExit(f"the command must begin with one of: {', '.join(PROGRAMS)}")
    made_by, started = commit(), time.time()
    printed, seconds = run(words)
    for file in files:
        if not (ROOT / file).is_file() or (ROOT / file).stat().st_mtime < started - 1.0:  # some disks round times
            raise SystemExit(f"no record, because the command did not write {file}")
    printed += "".join(f"\n{file}:\n\n{(ROOT / file).read_text(encoding='utf-8')}" for file in files)
    path = (RECORDS / name).with_suffix(".txt")
    path.parent.mkdir(parents=True, exist_ok=True)
    torch = {"torch": version("torch")} if find_spec("torch") else {}  # trains networks; searches do not need it
    made_with = ", ".join(f"{package} {number}" for package, number in (versions() | torch).items())
    header = f"command: {shlex.join(words)}\ncommit: {made_by}\nversions: {made_with}\nprocessor time: {seconds:.0f} s"
    lines = "\n".join(line.rstrip() for line in printed.splitlines() if PROGRESS not in line)
    path.write_text(f"{header}\n\n{lines.strip(chr(10))}\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    if "--" not in sys.argv[2:]:
        raise SystemExit(__doc__)
    end = sys.argv.index("--")
    main(sys.argv[1], sys.argv[2:end], sys.argv[end + 1 :])
