"""The code of files, read once for all tests of a process."""

import ast
from functools import cache
from pathlib import Path


@cache
def tree_of(file: Path) -> ast.Module:
    """The syntax tree of a file, which nobody changes."""
    return ast.parse(file.read_text(encoding="utf-8"))


def with_smaller(path: Path, *parts: tuple[str, str]) -> str:
    """The text of a script, with smaller parts in place of those of users, each of which it must have."""
    text = path.read_text()
    for of_users, few in parts:
        assert of_users in text
        text = text.replace(of_users, few)
    return text
