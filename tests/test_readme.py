"""The README's library example is executed as it stands, and its examples run."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LONG = {
    "04_a_mesh_of_your_own.py"
}  # trains for minutes; tests/experiments/test_own_shape.py goes the same way in small


@pytest.mark.mujoco
@pytest.mark.torch
def test_the_readmes_ten_lines_run_and_print_what_they_say():
    text = (ROOT / "README.md").read_text()
    [code] = re.findall(r"```python\n(.*?)```", text, flags=re.S)
    assert len([line for line in code.splitlines() if line.strip()]) <= 12
    namespace: dict = {}
    exec(compile(code, "README.md", "exec"), namespace)
    assert namespace["episode"].success


@pytest.mark.mujoco
def test_the_code_in_the_description_of_the_world_runs(capsys):
    [code] = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "world.md").read_text(), flags=re.S)
    exec(compile(code, "docs/world.md", "exec"), {})
    assert "an image of (128, 128, 3)" in capsys.readouterr().out


def test_the_code_in_the_guide_to_calibration_prints_what_the_guide_says(capsys):
    text = (ROOT / "docs" / "calibration.md").read_text()
    [(code, printed)] = re.findall(r"```python\n(.*?)```.*?```text\n(.*?)```", text, flags=re.S)
    exec(compile(code, "docs/calibration.md", "exec"), {})
    assert capsys.readouterr().out == printed


@pytest.mark.parametrize("name", sorted({path.name for path in (ROOT / "examples").glob("[0-9]*.py")} - LONG))
def test_every_example_runs(name, capsys):
    runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize(
    "page", ["README.md", "docs/world.md", "docs/architecture.md", "docs/calibration.md", "docs/scale.md"]
)
def test_every_file_a_page_links_to_exists(page):
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", (ROOT / page).read_text()):
        if not target.startswith("http"):
            assert (ROOT / page).parent.joinpath(target).exists(), target
