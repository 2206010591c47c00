"""Benchmarks start in the way that their docstrings say."""

import ast
from pathlib import Path

import pytest

SCRIPTS = sorted((Path(__file__).parents[2] / "benchmarks").glob("*.py"))


def imported(script):
    """Modules that a script imports, at the top or in a function."""
    for node in ast.walk(ast.parse(script.read_text())):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_benchmark_finds_its_neighbours_when_it_is_run_as_its_docstring_says(script):
    # Python looks in the folder of a file that it runs, and in the working folder for a module.
    text = ast.get_docstring(ast.parse(script.read_text()))
    names = set(imported(script))
    if f"python benchmarks/{script.name}" in text:
        assert not {name for name in names if name.partition(".")[0] == "benchmarks"}
    if f"python -m benchmarks.{script.stem}" in text:
        assert not names & {other.stem for other in SCRIPTS}


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_benchmark_says_how_it_is_run(script):
    text = ast.get_docstring(ast.parse(script.read_text()))
    if "__main__" in script.read_text():
        assert f"python benchmarks/{script.name}" in text or f"python -m benchmarks.{script.stem}" in text
