"""Every block of code of README and docs is executed as it stands, the examples run, and what pages name exists."""

import ast
import builtins
import re
import runpy
from pathlib import Path

import pytest

from tests.sources import with_smaller

ROOT = Path(__file__).parent.parent


PRINTED = ("your_classifier", "any_decision", "adaptive_test", "diagnosis", "digits")
SHORTER = {  # what takes long is smaller here, by parts of the code; `make nightly` runs all as it stands
    "docs/any_decision.md 1": {"size=2000": "size=300", "(2000, 5)": "(300, 5)", "(2000)": "(300)", "1500": "200"},
    "docs/adaptive_test.md 1": {"num_cases=100": "num_cases=4", "size=150": "size=4", "(150, 80)": "(4, 80)"},
    "docs/digits.md 1": {"order[1300:1500]": "order[1300:1310]"},
    "docs/find.md 1": {"directions=12": "directions=4", "num_objects=3": "num_objects=1", "searches=2": "searches=1"},
    "docs/find.md 2": {"ViewPlan(12, 4)": "ViewPlan(4, 4)", "episodes=2": "episodes=1"},
    "docs/extending.md 3": {"* 10_000": "* 500", "episodes=2": "episodes=1"},
    "docs/extending.md 4": {'"point_based": "point_based"': '"point_based": "threshold"', "episodes=2": "episodes=1"},
    "docs/start.md 1": {"episodes=5": "episodes=1"},
    "docs/environments.md 2": {"256": "16"},
    "docs/your_own_objects.md 4": {"episodes=2": "episodes=1"},
    "docs/calibration.md 1": {"RandomForestClassifier(20": "RandomForestClassifier(4"},
    "docs/ppo.md 1": {"learn(2048)": "learn(1024)", '"point_based": "point_based"': '"point_based": "threshold"'},
    "examples/02_search_without_physics.py": {"NUM_EPISODES = 100": "NUM_EPISODES = 8"},
    "examples/05_where_to_touch.py": {
        '"shape_information_gain(hypotheses=256, outcomes=512)"': '"random_poses"',
        "0.98": "0.4",
    },
}


def shorter(name, code):
    return with_smaller(code, SHORTER.get(name, {}))


def prints_what_the_page_says(page, capsys, monkeypatch):
    """Whether the code of a page prints what stands there; of code that is smaller here, how many lines it prints."""
    monkeypatch.setenv("COLUMNS", "80")
    text = (ROOT / "docs" / f"{page}.md").read_text()
    blocks, agree = re.findall(r"```python\n(.*?)```.*?```text\n(.*?)```", text, flags=re.S), []
    for number, (code, printed) in enumerate(blocks, 1):
        name = f"docs/{page}.md {number}"
        exec(compile(shorter(name, code), name, "exec"), {})
        said = capsys.readouterr().out
        agree.append(said == printed or (name in SHORTER and said.count("\n") == printed.count("\n")))
    return bool(agree) and all(agree)


@pytest.mark.parametrize("page", PRINTED)
def test_the_code_of_a_page_prints_what_the_page_says(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)  # one writes a figure
    assert prints_what_the_page_says(page, capsys, monkeypatch)


PAGES = ["README.md", *sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md"))]
BLOCKS = [
    pytest.param(code, id=f"{page} {number}")
    for page in PAGES
    for number, code in enumerate(re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), flags=re.S), start=1)
]


@pytest.mark.parametrize("code", BLOCKS)
def test_every_name_in_a_block_of_code_is_defined_in_it(code):
    nodes = list(ast.walk(ast.parse(code)))
    names = {node.id for node in nodes if isinstance(node, ast.Name)}
    bound = {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    bound |= {node.arg for node in nodes if isinstance(node, ast.arg)}
    bound |= {node.name for node in nodes if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    for node in nodes:
        if isinstance(node, ast.Import | ast.ImportFrom):
            bound |= {(one.asname or one.name).split(".")[0] for one in node.names}
    assert not names - bound - set(dir(builtins))


NIGHTLY_BLOCKS = {  # which `make nightly` runs, and what does the same here
    "docs/find.md 1": "experiments/meshes/test_meshes.py::"
    "test_find_plays_every_decider_of_compare_and_its_run_can_be_continued",
    "docs/find.md 3": "activetouch/test_pose_belief.py::test_a_sensor_says_how_an_object_lies",
    "docs/ppo.md 1": "experiments/ppo/test_train_ppo.py::test_training_learns_and_leaves_a_policy_and_is_not_repeated",
    "docs/real_touch.md 2": "experiments/search/test_live.py::test_a_sensor_of_recorded_touches_names_objects",
    "docs/robustness.md 1": "experiments/search/test_live.py::"
    "test_a_sensor_in_an_unknown_state_tells_what_may_be_the_matter",
}
OF_PRINTED = {f"docs/{page}.md 1" for page in PRINTED}
PRINTS = {
    "docs/start.md 3": "found the cube: True",
    "docs/world.md 1": "an image of (128, 128, 3)",
    "docs/toy.md 1": "0.571",
    "docs/toy.md 4": "cube 1.000",
}


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.parametrize(
    "code",
    [
        pytest.param(*block.values, id=block.id, marks=[pytest.mark.nightly] * (block.id in NIGHTLY_BLOCKS))
        for block in BLOCKS
        if str(block.id) not in OF_PRINTED
    ],
)
def test_every_block_of_code_runs(code, few_hypotheses, tmp_path, monkeypatch, capsys, request):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    block = request.node.callspec.id
    exec(compile(shorter(block, code), block, "exec"), {})
    assert PRINTS.get(block, "") in capsys.readouterr().out


def test_the_first_live_search_fits_on_a_screen():
    code = next(block.values[0] for block in BLOCKS if block.id == "docs/start.md 3")
    assert len([line for line in code.splitlines() if line.strip()]) <= 12


def test_the_readme_is_a_screen_and_a_half():
    unfolded = re.sub(r"<details.*?</details>", "", (ROOT / "README.md").read_text(), flags=re.S)
    assert len(unfolded.splitlines()) <= 90


EXAMPLES = sorted({path.name for path in (ROOT / "examples").glob("[0-9]*.py")})
NIGHTLY = {  # which `make nightly` runs, as all others in full, and what does the same here
    "04_a_mesh_of_your_own.py": "search/test_any_object.py::test_compare_searches_for_a_mesh_without_training",
    "06_drive_a_robot.py": "search/test_live.py::test_a_search_over_a_pipe_that_is_killed_is_the_search",
}


def test_what_a_block_or_an_example_does_that_runs_nightly_has_a_test():
    assert {*NIGHTLY_BLOCKS} <= {block.id for block in BLOCKS}
    assert {*NIGHTLY} <= {*EXAMPLES}
    for test in (*NIGHTLY_BLOCKS.values(), *(f"experiments/{test}" for test in NIGHTLY.values())):
        path, function = test.split("::")
        assert function in functions_of(f"tests/{path}")


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name not in NIGHTLY])
def test_every_example_runs(name, few_hypotheses, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [name])
    (tmp_path / name).write_text(shorter(f"examples/{name}", (ROOT / "examples" / name).read_text()))
    runpy.run_path(name, run_name="__main__")
    assert capsys.readouterr().out.strip()


BOUND_IS_TOLD_IN = (
    "docs/world.md",
    "docs/planners.md",
    "docs/ppo.md",
)


@pytest.mark.parametrize("page", BOUND_IS_TOLD_IN)
def test_the_bound_is_called_what_it_is_one_of_a_discretised_sensor(page):
    text = " ".join((ROOT / page).read_text().replace('"', " ").split())
    assert "discretised sensor model" in text
    assert page == "docs/world.md" or "can exceed" in text
    for overstated in (
        "o planner can expect",
        "no decider can exceed",
        "certified possible",
        "**optimum**",
        "| optimum |",
    ):
        assert overstated not in text


@pytest.mark.parametrize("place", ["planners/probing.py", "docs/planners.md", "docs/generate/shelves.py"])
def test_the_gain_about_the_shape_is_not_said_to_save_touches_in_keyed(place):
    """In 320 paired searches of ``keyed``, the difference in touches was +0.01 [-0.27, +0.28] (decision 0037)."""
    text = " ".join((ROOT / place).read_text().split())
    for wrong in (
        "needs fewer than the gain",
        "the better one",
        "`shape_information_gain` finds the place that matters",
    ):
        assert wrong not in text
    assert re.search(r"as many touches as|need equally many", text)


KEPT = [
    *(ROOT / "records").glob("*.md"),
    *(ROOT / "records" / "tables").glob("*.md"),
    ROOT / "records/submissions/README.md",
]
KEPT.append(ROOT / "examples/session_layouts/README.md")
PROSE = ["README.md", "CONTRIBUTING.md", *PAGES[1:], *sorted(path.relative_to(ROOT).as_posix() for path in KEPT)]
FOLDERS = "activetouch|belief|planners|experiments|tests|benchmarks|examples|docs"
IN_BACKTICKS = re.compile(rf"`((?:{FOLDERS})/[\w./-]*)`")
IN_COMMANDS = re.compile(r"python ((?:benchmarks|examples)/[\w.]+\.py)")
OF_A_COMMIT = re.compile(r"`[^`]+` at `[0-9a-f]{8}`")
IDS_OF_GYMNASIUM = re.compile(r"activetouch/(Object|Tray)\w+-v\d+")


@pytest.mark.parametrize("page", PROSE)
def test_every_file_a_page_names_or_links_to_exists(page):
    text = OF_A_COMMIT.sub("", (ROOT / page).read_text())
    named = [*IN_BACKTICKS.findall(text), *IN_COMMANDS.findall(text)]
    links = [target for target in re.findall(r"\]\(([^)#\s]+?)(?:#[^)]*)?\)", text) if not target.startswith("http")]
    missing = [name for name in named if not (ROOT / name).exists() and not IDS_OF_GYMNASIUM.fullmatch(name)]
    missing += [target for target in links if not (ROOT / page).parent.joinpath(target).exists()]
    assert not missing


def anchor(heading):
    """The anchor of a heading, as GitHub makes it."""
    words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
    return re.sub(r"[^\w\- ]", "", words).replace(" ", "-")


@pytest.mark.parametrize("page", PROSE)
def test_every_section_a_page_links_to_exists(page):
    for target, section in re.findall(r"\]\(([^)#\s]*)#([^)]+)\)", (ROOT / page).read_text()):
        if not target.startswith("http"):
            text = ((ROOT / page).parent / target if target else ROOT / page).read_text()
            assert section in [anchor(line) for line in re.findall(r"^#+ (.*)$", text, flags=re.M)]


ENTRY_POINTS = {f"activetouch.{part}" for part in ("deciders", "scenes", "renderers")}


@pytest.mark.parametrize("page", PROSE)
def test_every_module_a_page_names_can_be_imported(page):
    for name in re.findall(r"`((?:belief|planners|activetouch|experiments)(?:\.\w+)+)`", (ROOT / page).read_text()):
        if name in ENTRY_POINTS:
            continue
        parts = name.split(".")
        places = [ROOT.joinpath(*parts[:n]) for n in range(len(parts), 0, -1)]
        found = next(place for place in places if place.is_dir() or place.with_suffix(".py").exists())
        rest = parts[len(found.relative_to(ROOT).parts) :]
        source = (found / "__init__.py" if found.is_dir() else found.with_suffix(".py")).read_text()
        assert not rest or re.search(rf"\b{rest[0]}\b", source), name


def test_ten_concepts_are_found_by_the_name_of_their_file():
    text = (ROOT / "docs" / "architecture.md").read_text()
    rows = re.findall(r"^\| (.+?) \| \[`(.+?)`\]\(\.\./(.+?)\) \|$", text, flags=re.M)
    assert len(rows) == 10
    for concept, named, linked in rows:
        assert named == linked
        assert (ROOT / named).is_file(), concept


def test_the_six_nouns_come_first_and_each_names_its_file():
    text = (ROOT / "docs" / "architecture.md").read_text()
    first = text[: text.index("## Packages")]
    for noun in ("World", "Touch", "ObservationModel", "Belief", "Decider", "Episode"):
        [file] = re.findall(rf"^\*\*{noun}\*\* \(`([\w/.]+)`", first, flags=re.M)
        assert re.search(rf"^class {noun}\b", (ROOT / file).read_text(), flags=re.M)


def functions_of(path):
    """Names of the functions of a file, and of the methods of its classes as ``Class.method``."""
    tree = ast.parse((ROOT / path).read_text())
    groups = [("", tree), *((f"{node.name}.", node) for node in tree.body if isinstance(node, ast.ClassDef))]
    return {prefix + node.name for prefix, group in groups for node in group.body if isinstance(node, ast.FunctionDef)}


def test_the_functions_on_the_way_of_a_touch_exist_and_readme_names_that_of_evidence():
    text = (ROOT / "docs" / "architecture.md").read_text()
    rows = re.findall(r"^\| (\w+) \| \[`(.+?)::(.+?)`\]\(\.\./(.+?)\) \|", text, flags=re.M)
    assert [step for step, *_ in rows] == ["loop", "press", "image", "read", "evidence", "belief", "decision"]
    for _, file, function, linked in rows:
        assert file == linked
        assert function in functions_of(file)
    readme = (ROOT / "README.md").read_text()
    [(file, function)] = [(file, function) for step, file, function, _ in rows if step == "evidence"]
    assert f"`{function}` (`{file}`)" in readme
    assert "docs/architecture.md#the-way-of-a-touch" in readme
