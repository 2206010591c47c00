"""What importing costs, and that the import contracts really bite."""

import ast
import json
import re
import shutil
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from tests.footprint import changes_of_package, statements
from tests.sources import tree_of

ROOT = Path(__file__).parent.parent
PACKAGES = ("activetouch", "belief", "planners", "experiments")
HEAVY = ("torch", "transformers", "mujoco", "matplotlib", "pandas", "stable_baselines3")


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


def test_the_door_without_touch_loads_no_part_of_scipy_before_its_first_use():
    """``scipy.special`` alone takes longer than everything else that the package imports."""
    loaded = modules_loaded_by("import planners; from planners import ActiveClassification")
    assert not [name for name in loaded if re.fullmatch(r"scipy\.[a-z]\w*", name) and name != "scipy.version"]


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


@pytest.mark.slow
@pytest.mark.mujoco
@pytest.mark.parametrize("traced", [(), pytest.param(("--traced",), marks=pytest.mark.nightly)])
def test_a_comparison_loads_what_it_runs(traced, tmp_path):
    words = f"compare --scene coarse --targets cone --episodes 1 --jobs 1 --out {tmp_path / 'run'}".split()
    command = [sys.executable, "-m", "tests.footprint", *traced, *words]
    command += [] if traced else ["--deciders", "information_gain"]
    run = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    found = json.loads(run.stdout.splitlines()[-1])
    assert found["modules"]
    others = {"data", "hand", "recorded", "training", "mesh", "mesh_source", "object_search", "ppo", "certified"}
    assert [name for name in found["modules"] if others & {*name.split(".")}] == []
    assert len(found["modules"]) <= 100
    if traced:
        assert found["executed"] >= 0.63 * found["statements"]


@pytest.mark.mujoco
@pytest.mark.parametrize(("decider", "most"), [("information_gain", 40), ("point_based(rounds=[9])", 40)])
def test_a_touch_seldom_changes_between_packages(decider, most):
    from activetouch import TactileSensor

    sensor, touches = TactileSensor.shipped("coarse"), []
    sensor.search("cone", decider, seed=1)  # what is computed once
    changes = changes_of_package(
        lambda: touches.extend(sensor.search("cone", decider, seed=seed).num_touches for seed in range(2, 6))
    )
    assert 10 * sum(touches) < changes <= most * sum(touches)


def test_statements_are_counted_once_each_without_their_bodies():
    source = """
def double(x):
    '''Twice.'''
    try:
        return (
            2 * x)
    except TypeError:
        raise
match 3:
    case 3:
        y: int = 4
"""
    assert sorted(statements(source)) == [(2, 2), (4, 4), (5, 6), (8, 8), (9, 9), (11, 11)]


@pytest.mark.parametrize("package", ["belief", "belief.calibration", "belief.metrics", "belief.observation_model"])
def test_a_name_that_loads_late_is_no_module_of_its_package(package):
    module = import_module(package)
    source = Path(module.__file__)
    [late] = [node for node in ast.parse(source.read_text()).body if isinstance(node, ast.If)]
    names = {alias.name for node in late.body for alias in node.names}
    assert names <= {*module.__all__} <= {*dir(module)}
    assert not [name for name in names if (source.parent / f"{name}.py").exists()]  # which would hide it
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'nothing'"):
        getattr(module, "nothing")  # noqa: B009


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
    ("activetouch/scene.py", "import experiments"): "activetouch is not allowed to import experiments",
}


def test_imports_that_break_contracts_are_caught(tmp_path):
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("models", "__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for file, line in BROKEN:
        with (tmp_path / file).open("a") as source:
            source.write(f"\n{line}\n")
    violated = lint_imports(tmp_path)
    assert violated.returncode != 0
    told = " ".join(violated.stdout.split())
    assert [said for said in BROKEN.values() if said not in told] == []


LAYERS = ("belief", "planners", "activetouch", "experiments")
DOORS = {"activetouch/__init__.py", "activetouch/__main__.py"}  # activetouch.compare, python -m activetouch


@pytest.mark.parametrize("package", LAYERS)
def test_no_package_calls_one_above_it_by_a_string(package):
    above = LAYERS[LAYERS.index(package) + 1 :]
    for file in (ROOT / package).rglob("*.py"):
        texts = {node.value for node in ast.walk(tree_of(file)) if isinstance(node, ast.Constant)}
        parts = [text.split(".") for text in texts if isinstance(text, str) and re.fullmatch(r"\w+(\.\w+)+", text)]
        called = [part for part in parts if part[0] in above and any(ROOT.glob("/".join(part[:2]) + "*"))]
        assert not called or file.relative_to(ROOT).as_posix() in DOORS, (file, called)


POSIX_ONLY = {"crypt", "fcntl", "grp", "nis", "posix", "pty", "pwd", "resource", "spwd", "syslog", "termios", "tty"}
POSIX_NAMES = {
    *("os.fork", "os.getuid", "os.geteuid", "os.getpgid", "os.killpg", "os.mkfifo", "os.sysconf", "os.uname"),
    *("signal.SIGKILL", "signal.SIGHUP", "signal.SIGALRM", "signal.SIGUSR1", "signal.SIGPIPE", "signal.alarm"),
}


@pytest.mark.parametrize("package", ["activetouch", "belief", "experiments", "planners"])
def test_no_module_needs_at_its_import_what_only_posix_has(package):
    for file in (ROOT / package).rglob("*.py"):
        waiting = list(tree_of(file).body)
        while waiting:
            node = waiting.pop()
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
                waiting += [*node.args.defaults, *getattr(node, "decorator_list", [])]
                continue
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            assert not POSIX_ONLY & {name.partition(".")[0] for name in names}, file
            assert not (isinstance(node, ast.Attribute) and ast.unparse(node) in POSIX_NAMES), file
            waiting += ast.iter_child_nodes(node)


PUBLIC_SEEDS = {"int", "int | None", "int | Sequence[int]", "int | Sequence[int | None] | None"}


def test_every_public_function_and_class_takes_a_number_as_its_seed():
    """Annotations say it, and mypy holds the code to them. An episode keeps its seed as the words that it has."""
    seen = set()
    for package in ("activetouch", "belief", "planners"):
        for file in (ROOT / package).rglob("*.py"):
            for node in ast.walk(tree_of(file)):
                if isinstance(node, ast.FunctionDef) and (not node.name.startswith("_") or node.name == "__init__"):
                    for argument in [*node.args.args, *node.args.kwonlyargs]:
                        if argument.arg == "seed" and node.name != "of":
                            assert ast.unparse(argument.annotation) in PUBLIC_SEEDS, (file, node.name)
                            seen.add(node.name)
    assert {"search", "touch_rng", "arrangement_rng", "deciding_rng", "reset", "__init__"} <= seen
