"""Figures of reports and of the documentation look the same whatever style the user of matplotlib has chosen."""

import ast
import re
import sys
from importlib import import_module
from pathlib import Path

import matplotlib.style
import pytest

from experiments.report import Picture, figure

ROOT = Path(__file__).parents[2]
LARGE = {"font.size": 40.0, "figure.dpi": 30.0, "savefig.bbox": "tight", "svg.fonttype": "path"}
STYLE = ["dark_background", {"text.usetex": True, "path.sketch": (1.0, 100.0, 2.0)}, LARGE]


def draw(axes):
    axes.plot([0, 1], [0, 1], label="one")
    axes.set(xlabel="touches", title="50 % of $x$")
    axes.legend()


def of_a_report(folder):
    picture = Picture("picture", "words", [draw, draw], {"name": "C0"})
    picture.write(folder)
    return [*picture.inline(), (folder / "picture.svg").read_bytes(), (folder / "picture.png").read_bytes()]


def of_a_file(folder):
    with figure((3.0, 2.0), folder / "figure.svg") as drawn:
        draw(drawn.subplots())
    return (folder / "figure.svg").read_bytes()


def of_the_documentation(folder):
    import_module("figures").draw_drift(folder / "drift.svg", *["#ffffff", "#1f2328", "#8c959f", "#c0540a", "#1a7f5a"])
    return (folder / "drift.svg").read_bytes()


@pytest.mark.usefixtures("usual_pictures")
@pytest.mark.parametrize("made", [of_a_report, of_a_file, of_the_documentation])
def test_a_figure_is_the_same_in_every_style_of_the_user(made, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path, str(ROOT / "docs" / "generate")])
    usual = made(tmp_path)
    with matplotlib.style.context(STYLE):
        assert made(tmp_path) == usual


def test_a_style_that_is_asked_for_comes_before_the_common_one(tmp_path):
    usual = of_a_file(tmp_path)
    with figure((3.0, 2.0), tmp_path / "figure.svg", style="dark_background") as drawn:
        draw(drawn.subplots())
    assert (tmp_path / "figure.svg").read_bytes() != usual


def makes_figures(path):
    """Whether code calls ``Figure`` or changes the style of matplotlib."""
    if not re.search(r"\b(Figure|rc_context)\b", text := path.read_text()):
        return set()
    calls = [node.func for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    return {"Figure", "rc_context"} & {getattr(call, "attr", getattr(call, "id", None)) for call in calls}


def test_every_figure_begins_from_the_usual_style():
    files = [
        path
        for folder in ("activetouch", "belief", "planners", "experiments", "docs/generate")
        for path in (ROOT / folder).rglob("*.py")
    ]
    own = {path.relative_to(ROOT).as_posix() for path in files if makes_figures(path)}
    assert own == {"experiments/report.py", "docs/generate/figures.py", "experiments/search/film.py"}
    for path in own:
        assert 'matplotlib.style.context(["default"' in (ROOT / path).read_text()
        assert not {"rc_context"} & makes_figures(ROOT / path)
