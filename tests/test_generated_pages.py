"""The pages that are made from the code describe every part, and what they show works as it stands."""

import json
import re
import shutil
import sys
from importlib import import_module
from pathlib import Path

import pytest

from activetouch.named_scenes import SCENES
from activetouch.sensor_files import MODELS, POLICIES
from planners.registry import DECIDERS, NEED_FILES, trained_state

DOCS = Path(__file__).parent.parent / "docs"
GENERATE = DOCS / "generate"


@pytest.fixture(scope="module")
def made():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(GENERATE)
        yield import_module("pages").generated()
    for name in ("pages", "shelves"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    "page", [*(f"deciders/{name}.md" for name in DECIDERS), *(f"worlds/{name}.md" for name in SCENES)]
)
def test_every_decider_and_every_scene_is_described(made, page):
    assert "Not described yet" not in made[page]


def test_the_layout_says_of_every_folder_of_the_packages_what_is_in_it(made):
    rows = dict(re.findall(r"^\| `([\w/]+)/` \| (.*) \|$", made["reference/layout.md"], re.M))
    packages = ("belief", "planners", "activetouch", "experiments")
    root = DOCS.parent
    with_code = {file.parent.relative_to(root).as_posix() for name in packages for file in (root / name).rglob("*.py")}
    assert set(rows) == with_code
    assert all(text.endswith((".", ",")) and len(text) > 20 for text in rows.values()), rows


@pytest.mark.parametrize("name", sorted(NEED_FILES))
def test_the_code_on_the_page_of_a_decider_with_files_runs(made, name):
    [code] = re.findall(r"```python\n(.*?)```", made[f"deciders/{name}.md"], flags=re.S)
    exec(compile(code, name, "exec"), {})


@pytest.mark.parametrize("name", sorted(name for name in NEED_FILES if trained_state(name)))
def test_the_command_on_the_page_of_a_trained_decider_names_a_sensor_that_has_its_policies(made, name):
    [command] = re.findall(r"```sh\n(.*?)```", made[f"deciders/{name}.md"], flags=re.S)
    named = re.search(r"--sensor (\S+)", command) or re.search(r"--scene (\S+)", command)
    assert list((MODELS / named[1] / POLICIES).glob(f"{trained_state(name)}[-.]*"))


def test_no_page_compares_a_decider_with_itself(made):
    for name in DECIDERS:
        [first, second] = re.search(r"--deciders (\S+) (\S+)", made[f"deciders/{name}.md"]).groups()
        assert first == name != second


@pytest.fixture
def hooks(monkeypatch):
    monkeypatch.syspath_prepend(GENERATE)
    monkeypatch.setattr(sys, "path", [*sys.path])  # the module adds to it
    hooks = import_module("hooks")
    for module in ("hooks", "pages", "shelves", "gallery", "notebooks"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    return hooks


@pytest.mark.parametrize("name", ["toy", "your_classifier"])
def test_a_notebook_has_the_code_of_its_page_and_links_that_lead_somewhere_from_anywhere(name, monkeypatch):
    monkeypatch.syspath_prepend(GENERATE)
    monkeypatch.setattr(sys, "path", [*sys.path])  # the module adds to it
    notebooks = import_module("notebooks")
    monkeypatch.delitem(sys.modules, "notebooks")
    page = DOCS / f"{name}.md"
    cells = json.loads(notebooks.notebook(page))["cells"]
    install, *code = [cell["source"] for cell in cells if cell["cell_type"] == "code"]
    assert "google.colab" in install
    assert code == [block.strip() for block in re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.S)]
    text = "".join(cell["source"] for cell in cells if cell["cell_type"] == "markdown")
    assert all(link.startswith("https://") for link in re.findall(r"\]\(([^)]+)\)", text))


def test_the_notebooks_that_colab_opens_are_those_of_the_pages(monkeypatch):
    monkeypatch.syspath_prepend(GENERATE)
    notebooks = import_module("notebooks")
    monkeypatch.delitem(sys.modules, "notebooks")
    assert {path.stem for path in notebooks.FOLDER.glob("*.ipynb")} == {*notebooks.NOTEBOOKS}
    for name in notebooks.NOTEBOOKS:
        held = (notebooks.FOLDER / f"{name}.ipynb").read_text(encoding="utf-8")
        assert held == f"{notebooks.notebook(DOCS / f'{name}.md')}\n", "run python docs/generate/notebooks.py"


SITE = {
    "boosted": {"location": "explains/", "title": "Press a cup", "text": "<p>A cup is pressed.</p>", "boost": 1.0},
    "api": {"location": "reference/", "title": "cup", "text": "<p>cup cup cup</p>", "boost": 0.3},
    "tagged": {"location": "systems/", "title": "Systems", "text": "<p>Linux.</p>", "tags": ["Windows"]},
    "named": {"location": "reference/#windows", "title": "windows", "text": "<p>Images.</p>"},
}


@pytest.mark.skipif(shutil.which("node") is None, reason="the search of the site runs in Node.js")
def test_the_check_of_the_search_knows_boosts_and_tags_and_notices_what_is_missed(hooks, tmp_path, monkeypatch):
    import material

    workers = "assets/javascripts/workers"
    shutil.copytree(Path(material.__file__).parent / "templates" / workers, tmp_path / workers)
    fields = {"title": {"boost": 1000}, "text": {"boost": 1}, "tags": {"boost": 3000}}
    config = {"lang": ["en"], "separator": "[\\s\\-]+", "pipeline": ["stopWordFilter"], "fields": fields}
    (tmp_path / "search").mkdir()
    index = {"config": config, "docs": list(SITE.values())}
    (tmp_path / "search/search_index.json").write_text(json.dumps(index))
    monkeypatch.setattr(hooks, "QUERIES", {"cup": "explains/", "Windows": "systems/"})
    assert hooks.misses(tmp_path) == []
    monkeypatch.setattr(hooks, "QUERIES", {"cup": "reference/", "Windows": "systems/", "glove": "explains/"})
    assert hooks.misses(tmp_path) == ["'cup' finds explains/", "'glove' finds nothing"]


def test_what_people_type_leads_to_pages_that_are_there(hooks):
    assert len(hooks.QUERIES) >= 8
    targets = [*hooks.QUERIES.values(), *(new.partition("#")[0] for new in hooks.MOVED.values() if "#" in new)]
    for page in {*hooks.WORDS, *(f"{place.rstrip('/')}.md" for place in targets)}:
        assert (DOCS / page).exists(), page


def test_screen_readers_are_told_what_a_section_and_an_empty_head_of_a_column_are(hooks):
    page = """<nav class="md-nav" data-md-level="1" aria-labelledby="__nav_1_label" aria-expanded="true">
      <label class="md-nav__title" for="__nav_1">
        <span class="md-nav__icon md-icon"></span>
        First steps
      </label></nav><nav class="md-tabs" aria-label="Tabs"></nav>
      <tr><th></th><th style="text-align: right;"></th><th>touches</th></tr>"""
    read = hooks.on_post_page(page, None, None)
    assert 'data-md-level="1" aria-label="First steps" aria-expanded="true"' in read
    assert "aria-labelledby" not in read
    assert '<td></td><td style="text-align: right;"></td><th>touches</th>' in read
