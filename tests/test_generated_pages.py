"""The pages that are made from the code describe every part, and what they show works as it stands."""

import json
import re
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


@pytest.mark.parametrize("name", ["toy", "your_classifier"])
def test_a_notebook_has_the_code_of_its_page_and_links_that_lead_somewhere_from_anywhere(name, monkeypatch):
    monkeypatch.syspath_prepend(GENERATE)
    monkeypatch.setattr(sys, "path", [*sys.path])  # the module adds to it
    hooks = import_module("hooks")
    for module in ("hooks", "pages", "shelves", "gallery"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    page = DOCS / f"{name}.md"
    cells = json.loads(hooks.notebook(page))["cells"]
    code = [cell["source"] for cell in cells if cell["cell_type"] == "code"]
    assert code == [block.strip() for block in re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.S)]
    text = "".join(cell["source"] for cell in cells if cell["cell_type"] == "markdown")
    assert all(link.startswith("https://") for link in re.findall(r"\]\(([^)]+)\)", text))
