"""What importing costs, and that the import contracts really bite."""

import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("activetouch", "belief", "planners", "experiments")
HEAVY = ("torch", "transformers", "mujoco", "matplotlib", "stable_baselines3")


@cache
def modules_loaded_by(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return set(run.stdout.split())


@pytest.mark.parametrize("statement", ["from belief import *", "from planners import *", "import activetouch.world"])
def test_importing_a_package_loads_nothing_heavy(statement):
    loaded = modules_loaded_by(statement)
    assert not loaded & set(HEAVY)
    assert ("gymnasium" in loaded) == ("activetouch" in statement)  # which registers the environments


@pytest.mark.parametrize("package", ["belief", "activetouch"])
def test_a_package_alone_loads_no_observation_model(package):
    assert not modules_loaded_by(f"import {package}") & {"scipy.special", "belief.observation_model"}


def test_asking_for_help_loads_nothing_heavy():
    loaded = modules_loaded_by("from experiments.cli import commands; commands()")
    assert not loaded & set(HEAVY)


@pytest.mark.mujoco
def test_one_process_collects_touches_without_joblib(tmp_path):
    plan = "--plan.train 0 --plan.calibration 1 --plan.test 0"
    words = f"collect --scene coarse --fidelity quasistatic {plan} --out {tmp_path / 'touches'} --jobs 1".split()
    loaded = modules_loaded_by(f"from experiments.cli import main; sys.argv[1:] = {words}; main()")
    assert "mujoco" in loaded
    assert "joblib" not in loaded


def test_belief_needs_numpy_and_scipy_only():
    loaded = {name.split(".")[0] for name in modules_loaded_by("from belief import *")}
    others = (*PACKAGES, *HEAVY, "gymnasium", "joblib", "rich", "tyro", "jinja2", "PIL")
    ours = {name for name in loaded if name in others}
    assert ours == {"belief"}


@pytest.mark.parametrize("package", ["activetouch", "belief", "planners"])
def test_every_public_name_exists(package):
    module = __import__(package)
    assert module.__all__
    assert all(hasattr(module, name) for name in module.__all__)


def lint_imports(folder: Path) -> subprocess.CompletedProcess:
    command = [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, env={"PYTHONPATH": str(folder)})


BROKEN = {
    ("belief/bayes.py", "import torch"): "belief is not allowed to import torch",
    ("belief/bayes.py", "import planners"): "belief is not allowed to import planners",
    ("planners/search.py", "import activetouch"): "planners is not allowed to import activetouch",
    ("planners/search.py", "import mujoco"): "planners is not allowed to import mujoco",
}


def test_imports_that_break_contracts_are_caught(tmp_path):
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("models", "__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    clean = lint_imports(tmp_path)
    assert clean.returncode == 0, clean.stdout
    for file, line in BROKEN:
        with (tmp_path / file).open("a") as source:
            source.write(f"\n{line}\n")
    violated = lint_imports(tmp_path)
    assert violated.returncode != 0
    told = " ".join(violated.stdout.split())
    assert [said for said in BROKEN.values() if said not in told] == []
