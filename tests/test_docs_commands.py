"""Every command line of README and docs is accepted as it stands; options and functions that pages promise exist."""

import ast
import builtins
import csv
import re
import runpy
import shlex
import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from activetouch.named_scenes import SCENES
from experiments.cli import OPEN, REGISTRY, _parsed
from experiments.command_line.help import help_of
from planners.registry import DECIDERS
from tests.sources import tree_of

ROOT = Path(__file__).parent.parent
SINCE_0_1_0, PAPER_METHOD = "records/tables/since_0_1_0.md", "records/tables/paper_method.md"
PAGES = ["README.md", "CONTRIBUTING.md", *sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("docs/*.md"))]
PAGES += [SINCE_0_1_0, PAPER_METHOD, "examples/session_layouts/README.md"]


def shell_lines(text):
    """Lines of shell blocks, continued ones joined."""
    blocks = re.findall(r"```sh\n(.*?)```", text, flags=re.S)
    return [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]


def command_lines(text):
    """Command lines of shell blocks, and those in single backticks that leave nothing open and are of this commit."""
    lines = shell_lines(text)
    prose = re.sub(r"```.*?```", "", text, flags=re.S)
    lines += [
        " ".join(code.split())
        for code, commit in re.findall(r"`([^`]+)`( at `[0-9a-f]{8}`)?", prose)
        if not commit and "…" not in code and "..." not in code
    ]
    lines = [f"activetouch {line}" if line.partition(" --")[0] in REGISTRY else line for line in lines]
    return [
        line for line in lines if re.match(r"(activetouch|make|python (-m )?(benchmarks|examples/\w+\.py))\b", line)
    ]


COMMANDS = sorted({(page, line) for page in PAGES for line in command_lines((ROOT / page).read_text())})


def test_the_pages_hold_commands_of_every_group():
    used = {line.split()[1] for _, line in COMMANDS if line.startswith("activetouch ") and len(line.split()) > 1}
    assert len(used & set(REGISTRY)) >= 14


@pytest.mark.parametrize("line", sorted({line for _, line in COMMANDS if line.startswith("activetouch ")}))
def test_a_command_of_the_pages_is_accepted(line, capsys):
    line = line.replace(" FORMAT", " csv").replace(" COMMAND", " compare")
    name, *options = shlex.split(line, comments=True)[1:]
    if not options or "--config" in options:  # which reads the file of a run
        assert name in REGISTRY or name in ("--help", "--version")
        return
    try:
        _parsed([name, *options])
    except SystemExit as end:
        said = capsys.readouterr().err
        if end.code and not said.lstrip().startswith("Missing"):  # a page may name an option alone
            pytest.fail(said)


MENAGERIE = ROOT / "tests" / "fixtures" / "menagerie"
METHOD = re.findall(r"^\| (5[^|]*) \| ([^|]*) \| ([^|]*) \|$", (ROOT / PAPER_METHOD).read_text(), re.M)
PRESSES = [line for *_, cell in METHOD for line in command_lines(cell) if line.startswith("activetouch touch")]


def kind(line):
    """The options of a command, but for those that take another object or more of them."""
    return {word for word in shlex.split(line) if word.startswith("--")} - {"--shape", "--presses"}


ONE_OF_EACH_KIND = [line for n, line in enumerate(PRESSES) if kind(line) not in [kind(other) for other in PRESSES[:n]]]


def test_every_part_of_the_papers_method_has_a_command():
    assert {part for parts, *_ in METHOD for part in parts.split(", ")} >= {"5", *(f"5.{part}" for part in range(1, 9))}
    for part, words, cell in METHOD:
        assert command_lines(cell), (part, words)
    assert {shlex.split(line)[1] for *_, cell in METHOD for line in command_lines(cell)} == {
        *("touch", "explain", "collect", "train", "train-ppo", "compare", "reproduce", "examples/read_images.py")
    }


@pytest.mark.mujoco
@pytest.mark.nightly  # which runs all; tests of touches and grasps draw the same
@pytest.mark.parametrize("line", ONE_OF_EACH_KIND)
def test_the_presses_of_the_papers_method_write_their_files(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("activetouch.view._FRAME", (64, 48))
    options = [str(MENAGERIE) if word == "mujoco_menagerie" else word for word in shlex.split(line)[1:]]
    _parsed(options).run()
    [written] = tmp_path.iterdir()
    assert written.name in options
    assert written.stat().st_size > 1000


@pytest.mark.mujoco
@pytest.mark.torch
def test_the_images_of_the_papers_method_are_written_in_class_folders_and_read(tmp_path, monkeypatch):
    lines = [line for *_, cell in METHOD for line in command_lines(cell)]
    [collect] = [line for line in lines if "--images" in line and line.startswith("activetouch")]
    [read] = [line for line in lines if line.startswith("python examples/")]
    monkeypatch.chdir(tmp_path)
    few = ["--plan.train", "0", "--plan.test", "1"]
    _parsed([*shlex.split(collect)[1:], *few, "--jobs", "1"]).run()
    words = shlex.split(read)[1:]
    reader = words.index("--reader")  # which a training of half an hour writes; the shipped one in its place
    monkeypatch.setattr("sys.argv", words[:reader] + words[reader + 2 :])
    runpy.run_path(str(ROOT / words[0]), run_name="__main__")
    with (tmp_path / words[-1]).open() as opened:
        rows = list(csv.DictReader(opened))
    assert {row["image"].split("/")[1] for row in rows} == {"sphere", "cube", "cylinder", "cone"}
    for row in rows:
        probs = [float(row[f"p_{shape}"]) for shape in ("sphere", "cube", "cylinder", "cone")]
        assert sum(probs) == pytest.approx(1.0)
        assert row["label"] == ("sphere", "cube", "cylinder", "cone")[probs.index(max(probs))]
    assert len(rows) == 4 * 6 * 10  # shapes, poses, windows
    assert sum(name.startswith("feature") for name in rows[0]) == 320


TAKEN = re.findall(r"^\| ([^|]*) \| ([^|]*) \|$", (ROOT / SINCE_0_1_0).read_text().partition("0.2.0 took")[2], re.M)[1:]


@pytest.mark.parametrize(("what", "now"), TAKEN)
def test_what_a_release_took_has_a_line_that_does_it_now(what, now):
    """Command lines are accepted above; a line of Python is run."""
    python = [code for code in re.findall(r"`([^`]+)`", now) if re.match("(from|import) ", code)]
    assert command_lines(now) or python, what
    for code in python:
        exec(code, {})


MAKE = (ROOT / "Makefile").read_text()


@pytest.mark.parametrize("line", sorted({line for _, line in COMMANDS if line.startswith(("make", "python"))}))
def test_a_target_or_an_option_that_the_pages_name_exists(line):
    words = shlex.split(line, comments=True)
    if words[0] == "make":
        for word in words[1:]:
            name, given, _ = word.partition("=")
            assert re.search(
                rf"^{re.escape(name)} *\??=|\$\({re.escape(name)}\)" if given else rf"^{name}:", MAKE, re.M
            )
        return
    target = words[2] if words[1] == "-m" else words[1]
    file = ROOT / (target.replace(".", "/") + ".py" if words[1] == "-m" else target)
    source = file.read_text()
    for option in re.findall(r"--[a-z-]+", line):
        assert option in source or option[2:].replace("-", "_") in source, option


def test_the_scripts_of_all_records_are_among_the_code_that_must_be_committed_before_a_record():
    named = re.search(r"^CODE = \((.*)\)$", (ROOT / "docs/generate/run_record.py").read_text(), re.M)[1]
    records = [path.read_text() for path in (ROOT / "records").rglob("*.txt")]
    scripts = {found[1] for text in records if (found := re.match(r"command: python (?:-m )?(\w+)", text))}
    assert {"benchmarks", "examples"} <= scripts <= set(re.findall(r'"(\w+)"', named))


def test_every_decision_is_in_one_record_and_code_names_the_number_of_its_file(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs/generate")
    records = import_module("pages").records_of_decisions()
    for name in ("pages", "shelves"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    never_used = {"0051", "0052", "0055", "0056"}
    assert set(records) == {f"{number:04d}" for number in range(1, int(max(records)) + 1)} - never_used
    code = [path for name in FOLDERS for path in (ROOT / name).rglob("*.py")]
    named = {number for path in code for number in re.findall(r"decisions? (\d{4})", path.read_text())}
    assert named
    assert named <= {path.name[:4] for path in records.values()}


def test_the_documentation_can_be_read():
    """Words as ``wc -w`` counts them, with code and the frames of tables; long tables are in records/tables."""
    decisions, pages = sorted((ROOT / "docs/decisions").glob("*.md")), sorted((ROOT / "docs").glob("*.md"))
    assert len(decisions) <= 35
    text = "\n".join(path.read_text() for path in (*pages, *decisions))
    assert len(text.split()) <= 45_000


PROMISES = ["CHANGELOG.md", *PAGES]
WITHDRAWN = {  # on purpose; the changelog says so
    *(
        "--readers",
        "collect --from-manifest",
        "compare --part/--merge",
        "live --serve",
    ),
    *("tradeoff --vary", "ConfusionModel(confidence_edges=)", "ObjectTestGoal", "SceneBelief.known"),
    *("activetouch.alike", "activetouch.solids.round", "straight", "entry_distance"),
    *("activetouch.hypotheses", "belief.categorical", "planners.repeats"),
}
OF_OTHERS = (
    "--index-url",
    "--extra-index-url",
    "CalibratedClassifierCV",
    "VecNormalize",
    "AutoresetMode",
    "reset_mask",
    "ACTIVETOUCH_MODELS",
)
COLUMNS = {"success_low"}  # made of two words
FOLDERS = ("activetouch", "belief", "planners", "experiments", "examples")


@cache
def trees():
    """The code of all folders."""
    return [tree_of(path) for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]


@cache
def classes():
    """The classes of all folders, by name."""
    return {node.name: node for tree in trees() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def in_backticks(page):
    """Code in the sentences of a page, without files, lines of a shell, and what is at an earlier commit."""
    prose = re.sub(r"```.*?```", "", (ROOT / page).read_text(), flags=re.S)
    found = re.findall(r"`([^`]+)`( at `[0-9a-f]{8}`)?", prose)
    codes = {" ".join(code.split()) for code, commit in found if not commit}
    return {code for code in codes if not re.match(r"(python|make|pip|uv) |.*\.jsonl?$", code)}


@cache
def options_of(name):
    """The options in the help of a command."""
    listed = [line for line in help_of(REGISTRY[name].load(), name).splitlines() if line.startswith("  -")]
    return {OPEN, "--help", "--version", *re.findall(r"--[a-z][\w.-]*", " ".join(listed))}


def defined_in(tree):
    """Names of functions, classes, attributes, arguments and imports in code; of a class with those of its bases."""
    names = set()
    for node in ast.walk(tree):
        named = [getattr(node, key, None) for key in ("name", "arg", "asname")]
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            named += [getattr(target, "id", getattr(target, "attr", None)) for target in targets]
        names |= {name for name in named if isinstance(name, str)}
    for base in getattr(tree, "bases", ()):
        if isinstance(base, ast.Name) and base.id in classes():
            names |= defined_in(classes()[base.id])
    return names


@cache
def names():
    """All names that are defined anywhere."""
    return set().union(*map(defined_in, trees())) | {*REGISTRY, *DECIDERS, *SCENES, *COLUMNS, *dir(builtins)}


def lacks_an_option(code):
    """Whether the command that is named, or every command if none is, lacks an option that is named."""
    name = code.removeprefix("activetouch ").split()[0]
    known = options_of(name) if name in REGISTRY else set().union(*map(options_of, REGISTRY))
    return any(option not in known for option in re.findall(r"(?<![\w-])--[a-z][\w.-]*", code))


def lacks_a_name(code, is_bare_too):
    """Whether there is no such function, class or attribute: ``a.b(c=1)``, ``Class.b``, and ``b`` where that counts."""
    if (found := re.fullmatch(r"((?:\w+\.)*)(\w+)(\(.*\))?", code)) is None:
        return False
    *above, name = (found[1] + found[2]).split(".")
    if above and above[-1] in classes():
        return name not in defined_in(classes()[above[-1]])
    if not (found[3] or is_bare_too) or any(ROOT.joinpath(*above, file).exists() for file in (name, f"{name}.py")):
        return False
    if above and above[0] in FOLDERS:
        homes = [ROOT.joinpath(*above, "__init__.py"), ROOT.joinpath(*above).with_suffix(".py")]
        return not any(re.search(rf"\b{name}\b", home.read_text()) for home in homes if home.exists())
    return not {name, *re.findall(r"(\w+)=", found[3] or "")} <= names()


@pytest.mark.parametrize("page", PROMISES)
def test_the_options_and_functions_that_a_page_promises_exist(page):
    is_changelog = page == "CHANGELOG.md"
    said = [code for code in in_backticks(page) if not any(other in code for other in OF_OTHERS)]
    missing = {code for code in said if lacks_an_option(code) or lacks_a_name(code, is_changelog)}
    assert missing == (WITHDRAWN if is_changelog else set())
