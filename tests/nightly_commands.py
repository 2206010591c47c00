"""Every shell command of README and docs, and of the paper's method, is run in the order of its page: `make nightly`.

So are the code of pages and the examples that the tests run with smaller numbers, or not at all, and searches of
committed files.

These take too long for the tests, so pytest does not collect this file by itself. A command with a size, such as a
number of episodes, gets a small one (SMALLER): what counts is that it ends well. What cannot be run here says why
(ELSEWHERE). Files that pages take for granted, such as mug.obj, are written beforehand.
"""

import os
import re
import runpy
import subprocess
import sys
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh

from activetouch import TactileSensor, read_pad
from benchmarks.pad_fits import simulated
from experiments.search.benchmark.checking import check
from tests import test_numbers, test_readme
from tests.experiments.search import test_benchmark
from tests.test_docs_commands import METHOD, PAGES, PAPER_METHOD, ROOT, command_lines, shell_lines

SMALLER = {
    "compare": {"--episodes": 4},
    "certify": {"--searches": 200},
    "collect": {"--plan.train": 8, "--plan.calibration": 8, "--plan.test": 4},
    "train": {"--steps": 2, "--change.epochs": 1, "--device": "cpu"},
    "train-ppo": {"--steps": 256, "--recipes": "paper posterior", "--targets": "cube"},
    "reproduce": {"--input-size": 32, "--episodes": 2},
    "identify": {"--objects": 2},
    "find": {"--searches": 2},
    "drawer": {"--objects": 3, "--searches": 2},
    "replay": {"--number": 1},
    "robustness": {"--searches": 1},
    "tradeoff": {"--episodes": 2},
    "recorded": {"--scenes": 2, "--rounds": 1},
    "python -m benchmarks.seeds": {"--episodes": 2},
    "python zoo.py": {"--steps": 1},
}
ELSEWHERE = {
    "pip install": "each job installs what it needs",
    "make ": "search and test are jobs of their own; the others train for hours",
    "python benchmarks/install_size.py": "the job of the wheel installs it alone",
    "mkdir -p ~": "changes the home folder",
    "activetouch --tyro-print-completion": "changes the home folder",
    "python -m benchmarks.recorded_sets": "needs recordings that are fetched by hand",
    "activetouch recorded --data cy101": "needs recordings that are fetched by hand",
    "activetouch recorded --data sdh2": "needs recordings that are fetched by hand",
    "activetouch train --scene paper --recipe paper": "fetches published weights; the tests read a small checkpoint",
    "python examples/read_images.py": "needs the reader of that training; a test reads with a shipped one",
    "activetouch compare --scene hard --episodes 1000 --cluster tcp": "needs a cluster; the tests start one",
    "activetouch reproduce --parts table1": "trains for half an hour; the tests train on less",
}
if find_spec("ap_gym") is None:
    APGYM = ('python -c "import ap_gym', "python apgym_player.py", "activetouch compare --results in_turn.csv")
    ELSEWHERE |= dict.fromkeys(APGYM, "needs the extra apgym")


if find_spec("rerun") is None:
    ELSEWHERE["activetouch live --target cone --scene coarse --view"] = "needs the extra view"


def commands(page: str) -> list[str]:
    """Lines of the shell blocks of a page, without comments; an empty one where a block begins, in the first folder."""
    blocks = re.findall(r"```sh\n.*?```", (ROOT / page).read_text(), flags=re.S)
    lines = [line for block in blocks for line in ["", *shell_lines(block)]]
    if page == PAPER_METHOD:
        lines += [line for *_, cell in METHOD for line in command_lines(cell)]
    return [re.sub(r"\s+# .*", "", line).strip() for line in lines if line != "activetouch reproduce"]  # its parts run


def smaller(line: str) -> str:
    """The same command with the sizes of SMALLER, those that it has and those that it leaves to their defaults."""
    name = next(
        (name for name in sorted(SMALLER, key=len) if re.match(rf"(activetouch )?{re.escape(name)}( |$)", line)), None
    )
    if name is None or "--results" in line:
        return line
    for option, value in SMALLER[name].items():
        line = re.sub(rf" {re.escape(option)} [^-]\S*", "", line) + f" {option} {value}"
    return line


def _prepare(folder: Path) -> None:
    """Write into the folder what pages take for granted: a clone, meshes, results, a policy, a style, a pad, logs."""
    rng = np.random.default_rng(0)
    for path in ROOT.iterdir():
        if path.name in ("README.md", "Makefile", "activetouch", "benchmarks", "tests", "docs", "pyproject.toml"):
            (folder / path.name).symlink_to(path)
    subprocess.run(["cp", "-r", ROOT / "examples", folder / "examples"], check=True)
    (folder / "mujoco_menagerie").symlink_to(ROOT / "tests/fixtures/menagerie")
    box = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T * [0.016, 0.012, 0.020]
    wedge, tower = box.copy(), box * [1.0, 1.0, 1.2]
    wedge[wedge[:, 2] > 0, 0] *= 0.2
    tower[tower[:, 2] > 0, :2] *= 0.4
    (folder / "scans/17").mkdir(parents=True)
    own = {"mug.obj": 1000 * box, "bracket.stl": wedge, "cup.stl": tower}
    scans = {"17/model.obj": tower, "mug.obj": box, "bracket.stl": wedge, "cup.obj": tower}
    for name, corners in {**own, **{f"scans/{name}": corners for name, corners in scans.items()}}.items():
        trimesh.PointCloud(corners).convex_hull.export(folder / name)
    for number, name in enumerate(["mine.csv", "theirs.csv", "mine_clean.csv", "theirs_clean.csv"]):
        rows = [f"{seed},cone,{int((seed + number) % (number + 2) > 0)}" for seed in range(20)]
        (folder / name).write_text("\n".join(["seed,task,success", *rows]) + "\n")
    (folder / "mine.py").write_text("def act(observation):\n    return 0\n")
    page = (ROOT / "docs/your_own_pad.md").read_text()
    (folder / "mine.toml").write_text(page.partition("```toml\n")[2].partition("```")[0])
    felt = simulated(read_pad(folder / "mine.toml"), np.full(7, 0.5), rng, 30)
    names = ["force", *(f"t{taxel}" for taxel in range(felt.readings.shape[1]))]
    table = np.column_stack([felt.forces, felt.readings])
    np.savetxt(folder / "presses.csv", table, "%.6g", ",", header=",".join(names), comments="")
    (folder / "thesis.mplstyle").write_text("font.size: 8\n")
    rows = [
        (thing, action, session, *(thing + rng.normal(size=3)))
        for thing in range(4)
        for action in "ab"
        for session in range(6)
    ]
    lines = [f"thing_{thing},{action},{session},{x:.3f},{y:.3f},{z:.3f}" for thing, action, session, x, y, z in rows]
    (folder / "my_touches").mkdir()
    (folder / "my_touches/touches.csv").write_text("\n".join(["object,action,session,f1,f2,f3", *lines]) + "\n")
    sensor = TactileSensor.shipped("coarse")
    for day in ("monday", "tuesday"):
        with closing(sensor.session("cone", num_objects=4, log=folder / f"{day}.jsonl")) as session:
            session.ask()
            session.tell(image=rng.integers(256, size=(4, 4)))


@pytest.mark.parametrize("page", [page for page in PAGES if any(commands(page))])
def test_the_commands_of_a_page_run(page, tmp_path):
    """All in one folder, in order; `cd` holds for the rest of a block."""
    _prepare(tmp_path)
    for name, code in re.findall(r"`(\w+\.py)`[^\n]*\n+```python\n(.*?)```", (ROOT / page).read_text(), flags=re.S):
        (tmp_path / name).write_text(code)
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "OMP_NUM_THREADS": "1"}
    folder, failed = tmp_path, []
    for line in commands(page):
        if not line:
            folder = tmp_path
        elif reason := next((reason for start, reason in ELSEWHERE.items() if line.startswith(start)), ""):
            print(f"not run: {line} ({reason})")
        elif line.startswith("cd "):
            folder = folder / line[3:]
        else:
            ran = subprocess.run(
                ["bash", "-c", smaller(line)],
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
            )
            if ran.returncode or "Traceback" in ran.stderr:
                failed.append(f"$ {smaller(line)}\n{ran.stdout[-2000:]}{ran.stderr[-4000:]}")
    assert not failed, "\n".join(failed)


@pytest.fixture
def in_full(tmp_path, monkeypatch):
    """An empty working folder, and nothing that is made smaller for the tests."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    monkeypatch.setattr(test_readme, "SHORTER", {})


@pytest.mark.usefixtures("in_full")
@pytest.mark.parametrize("page", test_readme.PRINTED)
def test_the_code_of_a_page_prints_what_the_page_says(page, capsys, monkeypatch):
    assert test_readme.prints_what_the_page_says(page, capsys, monkeypatch)


@pytest.mark.usefixtures("in_full")
@pytest.mark.parametrize("code", [block for block in test_readme.BLOCKS if block.id in test_readme.SHORTER])
def test_a_block_of_code_runs_in_full(code):
    exec(compile(code, "a page", "exec"), {})


@pytest.mark.parametrize("path", test_benchmark.SUBMITTED, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_searches_of_a_committed_file_are_those_that_are_played_again(path):
    [entry] = check([path], share=0.2, jobs=1)
    assert entry.faults == ()


@pytest.mark.usefixtures("in_full")
@pytest.mark.parametrize("name", test_readme.EXAMPLES)
def test_an_example_runs_in_full(name, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", [name])
    runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("page", test_numbers.tables.OF_ALL_SUBMISSIONS)
def test_the_scoreboard_is_that_of_all_committed_files(page):
    assert test_numbers.has_its_tables(page), "run python docs/generate/tables.py"
