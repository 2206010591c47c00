"""The README's library example is executed as it stands, and its examples run."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.mark.mujoco
@pytest.mark.torch
def test_the_readmes_ten_lines_run_and_print_what_they_say():
    text = (ROOT / "README.md").read_text()
    [code] = re.findall(r"```python\n(.*?)```", text, flags=re.S)
    assert len([line for line in code.splitlines() if line.strip()]) <= 12
    namespace: dict = {}
    exec(compile(code, "README.md", "exec"), namespace)
    assert namespace["episode"].success


@pytest.mark.parametrize("name", sorted(path.name for path in (ROOT / "examples").glob("[0-9]*.py")))
def test_every_example_runs(name, capsys):
    runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")
    assert capsys.readouterr().out.strip()


def test_every_file_the_readme_links_to_exists():
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", (ROOT / "README.md").read_text()):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target
