"""How much of the product a command loads and runs, and how often one touch changes between its packages.

Run: python -m tests.footprint [--traced] COMMAND [OPTIONS]      prints, as JSON, what the command loaded and, traced,
                                                                 executed; pictures of its report are small
"""

import ast
import json
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from tests.small_pictures import small_pictures

ROOT = Path(__file__).parent.parent
PACKAGES = ("activetouch", "belief", "planners", "experiments")


def package_of(code: CodeType) -> str | None:
    """The package of the product that holds a function; None for all other code."""
    own = code.co_filename.startswith(f"{ROOT}/")
    name = code.co_filename[len(f"{ROOT}/") :].partition("/")[0]
    return name if own and name in PACKAGES else None


def statements(source: str) -> list[tuple[int, int]]:
    """First and last line of each statement, without its body; docstrings and imports for types alone are none."""
    found, waiting = [], list(ast.parse(source).body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        parts = ast.stmt | ast.excepthandler | ast.match_case
        body = [part for part in ast.iter_child_nodes(node) if isinstance(part, parts)]
        waiting += body
        is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        is_bare = isinstance(node, ast.AnnAssign) and node.value is None
        is_future = isinstance(node, ast.ImportFrom) and node.module == "__future__"
        if isinstance(node, ast.stmt) and not (is_text or is_bare or is_future):
            first = min([node.lineno, *(line.lineno for line in getattr(node, "decorator_list", []))])
            inner = [part.lineno for part in body if isinstance(part, ast.stmt)]
            last = max(node.lineno, inner[0] - 1) if inner else node.end_lineno or node.lineno
            last = node.lineno if isinstance(node, ast.Match) else last
            found.append((first, last))
    return found


def executed(run: Callable[[], Any]) -> dict[str, set[int]]:
    """The lines of the product that a call executes, by file."""
    lines: dict[str, set[int]] = defaultdict(set)
    left: dict[int, set[int]] = {}  # lines of each function that were not executed yet, by its id, as hashes take long
    kept: list[CodeType] = []  # so that no other one gets its id

    def local(frame: FrameType, event: str, argument: Any) -> Any:
        waiting = left[id(frame.f_code)]
        lines[frame.f_code.co_filename].add(frame.f_lineno)
        waiting.discard(frame.f_lineno)
        return local if waiting else None

    def enter(frame: FrameType, event: str, argument: Any) -> Any:
        code = frame.f_code
        if (waiting := left.get(id(code))) is None:
            kept.append(code)
            own = {line for *_, line in code.co_lines() if line} if package_of(code) else set()
            waiting = left[id(code)] = own
        return local(frame, event, argument) if waiting else None

    sys.settrace(enter)
    try:
        run()
    finally:
        sys.settrace(None)
    return lines


def changes_of_package(run: Callable[[], Any]) -> int:
    """How often a call, of anything, calls from one package of the product into another, whatever lies between."""
    packages: dict[int, tuple[CodeType, str | None]] = {}  # by id, as hashes of code take long
    stack: list[str] = []
    changes = 0

    def profile(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal changes
        code = frame.f_code
        if id(code) not in packages:
            packages[id(code)] = code, package_of(code)
        if (package := packages[id(code)][1]) is None:
            return
        if event == "call":
            changes += bool(stack) and stack[-1] != package
            stack.append(package)
        elif event == "return" and stack:
            stack.pop()

    sys.setprofile(profile)
    try:
        run()
    finally:
        sys.setprofile(None)
    return changes


def main() -> None:
    def run() -> None:
        from experiments.cli import main

        for module, name, value in small_pictures():
            setattr(module, name, value)
        main()

    is_traced = sys.argv[1] == "--traced"
    if is_traced:
        sys.argv.pop(1)
        lines = executed(run)
    else:
        run()
    loaded = sorted(name for name in sys.modules if name.partition(".")[0] in PACKAGES)
    if not is_traced:
        print(json.dumps({"modules": loaded}))
        return
    number = ran = 0
    for name in loaded:
        file = str(sys.modules[name].__file__)
        places = statements(Path(file).read_text(encoding="utf-8"))
        number += len(places)
        ran += sum(any(first <= line <= last for line in lines[file]) for first, last in places)
    print(json.dumps({"modules": loaded, "statements": number, "executed": ran}))


if __name__ == "__main__":
    main()
