"""How the product is laid out: no import circle, one folder for each thing a user does, tests beside what they test."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("belief", "planners", "activetouch", "experiments")


def modules() -> dict[str, Path]:
    files = (path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    return {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in files}


def imports(path: Path, known: dict[str, Path]) -> Iterator[str]:
    """Modules of the product that a file imports anywhere: at the top, in a function, or for types only."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
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
