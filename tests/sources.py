"""The code of files, read once for all tests of a process."""

import ast
from collections.abc import Mapping
from functools import cache
from pathlib import Path


@cache
def tree_of(file: Path) -> ast.Module:
    """The syntax tree of a file, which nobody changes."""
    return ast.parse(file.read_text(encoding="utf-8"))


def with_smaller(code: str, parts: Mapping[str, str]) -> str:
    """The code of a script, with smaller parts in place of those of users, each of which it must have."""
    for of_users, few in parts.items():
        assert of_users in code
        code = code.replace(of_users, few)
    return code
