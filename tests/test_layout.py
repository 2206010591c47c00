"""How the product is laid out: no import circle, one folder for each thing a user does, tests beside what they test."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.sources import tree_of

ROOT = Path(__file__).parent.parent
PACKAGES = ("belief", "planners", "activetouch", "experiments")


def modules() -> dict[str, Path]:
    files = (path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    return {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in files}


def imports(path: Path, known: dict[str, Path]) -> Iterator[str]:
    """Modules of the product that a file imports anywhere: at the top, in a function, or for types only."""
    for node in ast.walk(tree_of(path)):
        names = []
        if isinstance(node, ast.Import):
            names = [(alias.name, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [(f"{node.module}.{alias.name}", node.module) for alias in node.names]
        for full, module in names:
            found = full if full in known else module
            if found in known:
                yield found


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Sets of more than one node in which each leads to every other (Kosaraju 1978)."""

    def visit(start: str, edges: dict[str, set[str]], seen: set[str]) -> list[str]:
        order, stack = [], [(start, iter(edges[start]))]
        seen.add(start)
        while stack:
            node, rest = stack[-1]
            for follower in rest:
                if follower not in seen:
                    seen.add(follower)
                    stack.append((follower, iter(edges[follower])))
                    break
            else:
                order.append(node)
                stack.pop()
        return order

    seen: set[str] = set()
    order = [node for start in graph if start not in seen for node in visit(start, graph, seen)]
    backwards: dict[str, set[str]] = {node: set() for node in graph}
    for node, followers in graph.items():
        for follower in followers:
            backwards[follower].add(node)
    seen = set()
    return [part for node in reversed(order) if node not in seen and len(part := set(visit(node, backwards, seen))) > 1]


def test_circles_are_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set()}) == [{"a", "b", "c"}]
    assert circles({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def test_no_module_is_in_an_import_circle():
    known = modules()
    assert len(known) > 200
    assert circles({name: {*imports(path, known)} - {name} for name, path in known.items()}) == []


def test_experiments_have_one_folder_for_each_thing_a_user_does():
    entries = [path for path in (ROOT / "experiments").iterdir() if path.name != "__pycache__"]
    assert len(entries) <= 18


@pytest.mark.parametrize("package", PACKAGES)
def test_tests_lie_where_the_folders_do_that_they_test(package):
    folders = {path.name for path in (ROOT / package).iterdir() if path.is_dir()}
    tested = {path.name for path in (ROOT / "tests" / package).iterdir() if path.is_dir() and any(path.glob("*.py"))}
    assert tested <= folders


def careless(source: str) -> list[int]:
    """Lines that open a file whose bytes would be others on another system, by its encoding or its line ends."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        called, named = ast.unparse(node.func), {word.arg for word in node.keywords}
        modes = [one.value for one in node.args if isinstance(one, ast.Constant) and isinstance(one.value, str)]
        modes += [one.value.value for one in node.keywords if one.arg == "mode" and isinstance(one.value, ast.Constant)]
        mode = next((text for text in modes if text and set(text) <= set("rwaxbt+")), "")
        if called == "os.open":
            is_careless = "O_WRONLY" in ast.unparse(node) and not re.search("BINARY|devnull", ast.unparse(node))
        elif called.endswith((".read_text", ".write_text")):
            is_careless = "encoding" not in named and not modes
            is_careless |= called.endswith(".write_text") and "newline" not in named
        elif called == "open" or called.endswith((".open", ".fdopen")):
            is_text = (bool(mode) or not node.args) and "b" not in mode
            is_careless = is_text and ("encoding" not in named or ("r" not in (mode or "r") and "newline" not in named))
        else:
            is_careless = False
        if is_careless and "devnull" not in ast.unparse(node):
            found.append(node.lineno)
    return found


def test_careless_openings_are_found():
    lines = (
        *("path.open()", "path.open('a')", "open(name, 'w', encoding='utf-8')", "path.read_text()"),
        *("path.write_text(text, encoding='utf-8')", "os.open(path, os.O_WRONLY | os.O_APPEND)", "os.fdopen(1, 'w')"),
    )
    assert careless("\n".join(lines)) == [*range(1, len(lines) + 1)]
    exact = (
        *("path.open('rb')", "path.open('a', encoding='utf-8', newline='')", "bz2.open(path)", "Image.open(path)"),
        *("write_text(path, text)", "path.read_text(encoding='utf-8')", "os.open(path, os.O_WRONLY | os.O_BINARY)"),
    )
    assert careless("\n".join(exact)) == []


@pytest.mark.parametrize("folder", [*PACKAGES, "benchmarks", "docs/generate", "examples"])
def test_every_file_is_read_and_written_in_one_encoding_with_its_own_line_ends(folder):
    found = {file.name: careless(file.read_text(encoding="utf-8")) for file in (ROOT / folder).rglob("*.py")}
    assert {name: lines for name, lines in found.items() if lines} == {}
