"""The scripts of the gallery are short, run, and are shown on its page."""

import re
import sys
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from activetouch.extras import EXTRAS

ROOT = Path(__file__).parent.parent
_SPEC = spec_from_file_location("gallery_of_docs", ROOT / "docs" / "generate" / "gallery.py")
gallery = module_from_spec(_SPEC)
_SPEC.loader.exec_module(gallery)
NEEDS = {"digits_through_crops": "sklearn", "a_real_sensor": "sklearn", "train_ppo": "stable_baselines3"}


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.parametrize("script", gallery.scripts(), ids=lambda script: script.stem)
def test_a_script_of_the_gallery_runs_in_short_form(script, tmp_path, monkeypatch, capsys):
    if script.stem in NEEDS and find_spec(NEEDS[script.stem]) is None:
        pytest.skip(f"{NEEDS[script.stem]} is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", list(sys.argv))
    gallery.run(script, tmp_path / "figure.png", "--short")
    assert (tmp_path / "figure.png").stat().st_size > 1000
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("script", gallery.scripts(), ids=lambda script: script.stem)
def test_a_script_is_short_and_says_what_it_shows(script):
    lines = script.read_text().splitlines()
    assert len(lines) < 80
    assert f"python examples/gallery/{script.name} [FIGURE.png]" in "\n".join(lines)
    needed = {module: extra for extra, modules in EXTRAS.items() for module in modules if extra != "train"}
    extras = {needed[word] for word in re.findall(r"^from (\w+)", script.read_text(), re.M) if word in needed}
    assert extras == set(re.findall(r'^script_needs\("(\w+)"\)', script.read_text(), re.M))
    first, paragraph = gallery.description(script)
    assert 10 < len(first) < 120
    assert len(paragraph) > 80


@pytest.mark.parametrize(
    "script", [*gallery.scripts(), *(ROOT / "examples").glob("[0-9]*.py")], ids=lambda path: path.stem
)
def test_an_example_says_how_long_it_takes(script):
    [told] = re.findall(r"^Run: python examples/.*\((\d+) s of processor time", script.read_text(), re.M)
    assert int(told) <= 60


def test_the_page_shows_every_script_with_its_figure():
    assert gallery.PAGE.read_text() == gallery.page(), "run: python docs/generate/gallery.py NONE"
    for script in gallery.scripts():
        assert (gallery.FIGURES / f"{script.stem}.png").stat().st_size < 120_000
