"""The main job runs with the base installation alone, and what needs more says which extra to install."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from importlib.metadata import metadata, requires
from pathlib import Path
from types import SimpleNamespace

import pytest

from activetouch.extras import EXTRAS, extra_of, require_extra, script_needs
from belief import errors
from belief.errors import MissingPackage, install_command
from planners import fingerprint
from tests.sources import tree_of

ROOT = Path(__file__).parent.parent
HIDDEN = sorted({module for modules in EXTRAS.values() for module in modules})
HIDE = f"""
import sys
from importlib.machinery import PathFinder

class WithoutExtras(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name.partition(".")[0] in {HIDDEN} else super().find_spec(name, path, target)

sys.meta_path[sys.meta_path.index(PathFinder)] = WithoutExtras
"""


@pytest.fixture
def python(tmp_path):
    """Runs Python in processes in which no module of an extra can be found."""
    (tmp_path / "hidden").mkdir()
    (tmp_path / "hidden" / "sitecustomize.py").write_text(HIDE)
    path = os.pathsep.join([str(tmp_path / "hidden"), str(ROOT)])
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}

    def run(*words):
        return subprocess.run(
            [sys.executable, *words], capture_output=True, text=True, cwd=tmp_path, env=environment, timeout=300
        )

    return run


@pytest.mark.mujoco
def test_searches_need_no_training_stack(python, tmp_path):
    deciders = ("information_gain", "threshold", "ppo_goal")
    words = ("--scene", "coarse", "--targets", "cone", "--episodes", "1", "--jobs", "1", "--out", "run")
    done = python("-m", "activetouch", "compare", *words, "--deciders", *deciders)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "report.html").stat().st_size > 10_000


NEED = {
    ("train",): "train",
    ("live", "--target", "cone", "--view", "session.rrd"): "view",
    ("reproduce", "--parts", "table1"): "train",
    ("train-ppo",): "rl",
    ("train-ppo", "--tensorboard", "logs"): "rl",
    ("compare", "--deciders", "pouct", "--episodes", "1", "--jobs", "1"): "pomdp",
}
ONE_AFTER_THE_OTHER = f"""
import sys
from experiments.cli import main

for words in {list(NEED)}:
    sys.argv = ["activetouch", *words]
    try:
        main()
    except SystemExit as end:
        print("code", end.code, file=sys.stderr)
    print("next", file=sys.stderr)
"""


def test_a_command_that_needs_an_extra_names_it_before_any_work(python, tmp_path):
    done = python("-c", ONE_AFTER_THE_OTHER)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    told = done.stderr.split("next\n")[:-1]
    assert len(told) == len(NEED)
    for said, extra in zip(told, NEED.values(), strict=True):
        assert f"pip install '{ROOT}[{extra}]'" in said  # of a clone, from another folder
        assert said.startswith("code activetouch: ")  # a message as the code is exit status 1
    assert not (tmp_path / "runs").exists()


IMPORTED_IN_TURN = """
from importlib import import_module

for name in ("object_test", "object_search", "batched_episodes", "sb3"):
    try:
        import_module(f"activetouch.envs.{name}")
    except Exception as error:
        print(f"{type(error).__name__}: {error}")
"""


def test_an_environment_names_the_extra_that_it_needs(python):
    said = python("-c", IMPORTED_IN_TURN).stdout
    assert said.count(f"MissingPackage: gymnasium is not installed: pip install '{ROOT}[rl]'") == 4


def test_every_module_of_an_extra_is_required_by_it_and_by_nothing_else():
    distributions = {"sklearn": "scikit-learn", "collada": "pycollada", "rerun": "rerun-sdk"} | {
        module: module.replace("_", "-") for module in ("stable_baselines3", "sb3_contrib", "pomdp_py")
    }
    needed = [line.replace('"', "'") for line in requires("activetouch")]
    for extra, modules in EXTRAS.items():
        for module in modules:
            name = distributions.get(module, module)
            found = [line for line in needed if line.startswith(name) and not line[len(name)].isalpha()]
            assert any(f"extra == '{extra}'" in line for line in found), (module, extra)
            assert all("extra == " in line for line in found), module


def test_no_module_needs_an_extra_to_be_imported_that_its_tests_do_without():
    """The doctests of every module are collected where the extra ``dev`` is installed, and no other."""
    [dev] = [line for line in requires("activetouch") if re.match(r"activetouch\[.*extra == .dev.", line)]
    installed = set(re.search(r"\[(.*)\]", dev)[1].split(","))
    assert installed < set(metadata("activetouch").get_all("Provides-Extra"))
    missing = {module for extra in set(EXTRAS) - installed for module in EXTRAS[extra]}
    files = [
        path
        for package in ("activetouch", "belief", "planners", "experiments")
        for path in (ROOT / package).rglob("*.py")
    ]
    assert len(files) > 200
    for path in files:
        for line in tree_of(path).body:
            named = [line.module or ""] if isinstance(line, ast.ImportFrom) else []
            named += [name.name for name in line.names] if isinstance(line, ast.Import) else []
            assert not missing & {name.partition(".")[0] for name in named}, f"{path}: {named}"


def test_extras_are_found_by_module(monkeypatch):
    assert extra_of("onnxscript.ir") == "train"
    assert extra_of("numpy") is None
    require_extra("train")
    monkeypatch.setattr("activetouch.extras.find_spec", lambda name: None)
    monkeypatch.chdir(ROOT)
    assert install_command("rl") == "pip install '.[rl]'"
    with pytest.raises(SystemExit, match=r"gymnasium.* are not installed: pip install '\.\[rl\]'"):
        script_needs("rl")
    monkeypatch.setattr(errors, "__file__", "/somewhere/site-packages/belief/errors.py")
    assert install_command("rl") == "pip install 'activetouch[rl]'"  # the clone that pip names is not this one
    with pytest.raises(MissingPackage, match=r"onnx and onnxscript are not installed: .*\[train\]"):
        require_extra("train")


@pytest.fixture
def origin(tmp_path, monkeypatch):
    """Set what pip wrote about the origin of a copy in ``tmp_path / "site-packages"``."""
    for module, path in ((errors, "belief/errors.py"), (fingerprint, "planners/fingerprint.py")):
        monkeypatch.setattr(module, "__file__", str(tmp_path / "site-packages" / path))

    def be(written):
        copy = SimpleNamespace(read_text=lambda name: json.dumps(written) if written else None)
        monkeypatch.setattr("importlib.metadata.distribution", lambda name: copy)

    be(None)
    return be


FOLDER, FILE = "{clone}", "{clone}/activetouch-0.3.0-py3-none-any.whl"
GIT = "https://example.org/activetouch.git"


@pytest.mark.parametrize(
    ("written", "command"),
    [
        ({"url": f"file://{FOLDER}", "dir_info": {}}, f"'{FOLDER}[rl]'"),
        ({"url": f"file://{FILE}", "archive_info": {"hash": "sha256=1"}}, f"'{FILE}[rl]'"),
        ({"url": GIT, "vcs_info": {"vcs": "git", "commit_id": "a" * 40}}, f"'activetouch[rl] @ git+{GIT}@{'a' * 40}'"),
        ({"url": "https://example.org/a.whl", "archive_info": {}}, "'activetouch[rl] @ https://example.org/a.whl'"),
        ({"url": "file:///no/longer/there", "dir_info": {}}, "'activetouch[rl]'"),
        ({"url": f"file://{FOLDER}", "dir_info": {"editable": True}}, "'activetouch[rl]'"),
        (None, "'activetouch[rl]'"),
        ([], "'activetouch[rl]'"),
    ],
)
def test_a_missing_extra_is_installed_from_where_the_copy_came_from(written, command, origin, tmp_path, monkeypatch):
    clone = tmp_path / "my clone"
    clone.mkdir()
    (clone / Path(FILE).name).touch()
    as_url = json.dumps(written).replace("{clone}", clone.as_posix().replace(" ", "%20"))
    origin(json.loads(as_url))
    assert install_command("rl") == f"pip install {command.replace('{clone}', str(clone))}"
    monkeypatch.chdir(clone)
    assert install_command("rl") == f"pip install {command.replace(FOLDER + '[', '.[').replace('{clone}', str(clone))}"


def git(folder, *words):
    who = ("-c", "user.name=a", "-c", "user.email=a@example.org")
    return subprocess.run(["git", *who, *words], cwd=folder, check=True, capture_output=True, text=True).stdout.strip()


def test_the_commit_of_an_installed_copy_is_that_of_the_clone_it_was_installed_from(origin, tmp_path):
    clone, copy = tmp_path / "clone", tmp_path / "site-packages"
    (clone / "belief").mkdir(parents=True)
    (clone / "belief" / "code.py").write_text("x = 1")
    git(tmp_path, "init", "--quiet")  # another repository around both
    git(tmp_path, "commit", "--quiet", "--allow-empty", "--message=other")
    origin({"url": clone.as_uri(), "dir_info": {}})
    shutil.copytree(clone, copy)
    assert fingerprint.commit_of_code() == ""
    git(clone, "init", "--quiet")
    git(clone, "add", ".")
    git(clone, "commit", "--quiet", "--message=first")
    commit = git(clone, "rev-parse", "--short=12", "HEAD")
    assert fingerprint.commit_of_code() == commit
    (clone / "belief" / "code.py").write_text("x = 2")
    assert fingerprint.commit_of_code() == ""  # the copy is of neither
    (copy / "belief" / "code.py").write_text("x = 2")
    assert fingerprint.commit_of_code() == f"{commit}-dirty"
    origin({"url": GIT, "vcs_info": {"vcs": "git", "commit_id": "a" * 40}})
    assert fingerprint.commit_of_code() == "a" * 12
    origin(None)
    assert fingerprint.commit_of_code() == ""
    (copy / "pyproject.toml").touch()  # code in a clone itself, which is no repository
    assert fingerprint.commit_of_code() == ""
    git(copy, "init", "--quiet")
    git(copy, "add", ".")
    git(copy, "commit", "--quiet", "--message=second")
    assert fingerprint.commit_of_code() == git(copy, "rev-parse", "--short=12", "HEAD")
