"""What determines a result, as digests: settings of objects, the code that they import, and versions of packages.

Code that was installed as a package is known by its version. All other code, such as that of a checkout or of a module
of a user, is known by its source text.
"""

from __future__ import annotations

import enum
import filecmp
import functools
import hashlib
import importlib.metadata
import inspect
import json
import platform
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from types import MethodType, ModuleType
from typing import Any

import numpy as np

from belief.errors import code_source
from belief.files import OWN_PACKAGES, is_installed, is_standard, require_regular_file, source_digest
from planners.registry import MadeAnew

_PLAIN = (type(None), bool, int, float, complex, str, bytes)


def fingerprint(value: object, target: str | None = None, known: Mapping[str, object] | None = None) -> str:
    """SHA-256 of the settings of an object and of the code that its classes import, the same in every process.

    Settings are the attributes of the object, their attributes, and so on. An object with a method ``files`` is asked
    which files it reads for the ``target``. Objects in ``known`` are described by their name only.

    >>> from planners.stopping import PosteriorThresholds
    >>> fingerprint(PosteriorThresholds()) == fingerprint(PosteriorThresholds(confirm=0.99))
    True
    >>> fingerprint(PosteriorThresholds()) == fingerprint(PosteriorThresholds(confirm=0.9))
    False
    """
    description = _Description(target, {id(one): name for name, one in (known or {}).items()})
    described = description.of(value)
    return digest_of([described, code_digest(*sorted(description.modules))])


def digest_of(fields: object) -> str:
    """SHA-256 of JSON types."""
    return hashlib.sha256(json.dumps(fields).encode()).hexdigest()


def files_digest(paths: Iterable[Path]) -> str:
    """SHA-256 of the content of files, wherever they lie."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(require_regular_file(path).read_bytes())
    return digest.hexdigest()


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Versions of Python, of this package and of all packages that it needs."""
    lines = [line for line in importlib.metadata.requires("activetouch") or [] if ";" not in line]  # without extras
    names = ["activetouch", *sorted(re.split(r"[^\w.-]", line)[0] for line in lines)]
    return {"python": platform.python_version()} | {name: importlib.metadata.version(name) for name in names}


def commit_of_code() -> str:
    """Git commit of this code, marked if there are uncommitted changes.

    It is that of the clone which the code is in or was installed from; empty if there is none, or if the clone holds
    other code than was installed.
    """
    (clone, commit), root = code_source(), Path(__file__).parents[1]
    if commit or not isinstance(clone, Path):
        return commit[:12]
    git = ["git", f"--git-dir={clone / '.git'}", f"--work-tree={clone}"]  # of no other repository around it
    try:
        for file in (path for package in OWN_PACKAGES for path in (root / package).rglob("*.py") if clone != root):
            if not filecmp.cmp(file, clone / file.relative_to(root), shallow=False):
                return ""
        described = [*git, "describe", "--always", "--dirty", "--abbrev=12"]
        return subprocess.run(described, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""


@lru_cache(maxsize=1)
def code_versions() -> dict[str, str]:
    """The :func:`versions`, the commit of this code, and a digest of its source."""
    root = Path(__file__).parents[1]
    files = sorted(path for package in OWN_PACKAGES for path in (root / package).rglob("*.py"))
    return versions() | {"commit": commit_of_code(), "code": files_digest(files)[:12]}


def code_digest(*modules: str) -> str:
    """SHA-256 of the source of modules and of all that they import, except what is installed as a package."""
    known: dict[str, str] = {}
    waiting = [name for name in modules if name in sys.modules]
    while waiting:
        name = waiting.pop()
        file = getattr(sys.modules[name], "__file__", None)
        if name in known or file is None or is_standard(name) or is_installed(file):
            continue
        known[name] = files_digest([Path(file)]) if Path(file).is_file() else ""
        homes = {_home(value, name) for value in list(vars(sys.modules[name]).values())}
        waiting += [home for home in homes if home in sys.modules]
    return digest_of(sorted(known.items()))


def _home(value: Any, name: str) -> str:
    """The module that a value in the namespace of the module ``name`` comes from.

    A submodule does not count: it is in the namespace of its package as soon as anything has imported it.
    """
    if isinstance(value, ModuleType):
        return name if value.__name__.startswith(f"{name}.") else value.__name__
    home = getattr(value, "__module__", None)
    return home if isinstance(home, str) else type(value).__module__


class _Description:
    """Describes a tree of objects as JSON types, and notes the modules of their classes."""

    def __init__(self, target: str | None, known: Mapping[int, str]) -> None:
        self.modules: set[str] = set()
        self._target, self._known = target, known
        self._seen: dict[int, object] = {}  # keeps the objects, so that no id is used again

    def of(self, value: Any) -> Any:
        """The description of a value."""
        if id(value) in self._known:
            return ["known", self._known[id(value)]]
        if isinstance(value, MadeAnew):
            value = value.decider
        if isinstance(value, np.generic | np.ndarray) and value.dtype.kind != "O":
            return ["array", str(value.dtype), list(value.shape), hashlib.sha256(value.tobytes()).hexdigest()]
        if isinstance(value, enum.Enum):
            return [self._code(type(value)), value.name]
        if isinstance(value, _PLAIN):
            return repr(value)
        if isinstance(value, Path):
            return ["path", _content(value)]
        if id(value) in self._seen:
            return ["seen", list(self._seen).index(id(value))]
        self._seen[id(value)] = value
        if isinstance(value, Mapping):
            return ["mapping", [[self.of(key), self.of(one)] for key, one in value.items()]]
        if isinstance(value, list | tuple | np.ndarray):
            return [type(value).__name__, [self.of(one) for one in value]]
        if isinstance(value, set | frozenset):
            return ["set", sorted(json.dumps(self.of(one)) for one in value)]
        if isinstance(value, type):
            return ["class", self._code(value)]
        if isinstance(value, MethodType):
            return ["method", self.of(value.__self__), value.__name__]
        if isinstance(value, functools.partial):
            return ["partial", *map(self.of, (value.func, value.args, value.keywords))]
        if inspect.isroutine(value) or hasattr(value, "__wrapped__"):
            function = inspect.unwrap(value)
            cells = [cell.cell_contents for cell in getattr(function, "__closure__", None) or ()]
            return ["function", self._code(function), *map(self.of, cells)]
        return self._object(value)

    def _object(self, value: Any) -> Any:
        described: list[Any] = [self._code(type(value))]
        if callable(files := getattr(value, "files", None)) and self._target is not None:
            described.append([[path.name, _content(path)] for path in files(self._target)])
        for name, one in _settings(value).items():
            if not (files and isinstance(one, Path)):
                described.append([name, self.of(one)])
        return described

    def _code(self, kind: Any) -> list[str]:
        """Name of a class or function, and the digest of its code, with that of the base classes."""
        module = getattr(kind, "__module__", None) or "builtins"
        self.modules |= {base.__module__ for base in kind.__mro__} if isinstance(kind, type) else {module}
        is_python = inspect.isfunction(kind) or (isinstance(kind, type) and not is_standard(module))
        return [f"{module}.{kind.__qualname__}", source_digest(kind) if is_python else ""]


def _settings(value: Any) -> dict[str, Any]:
    """Attributes of an object; of a dataclass only its constructor arguments."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value) if field.init}
    slots = [name for cls in type(value).__mro__ for name in getattr(cls, "__slots__", ())]
    return {name: getattr(value, name) for name in slots if hasattr(value, name)} | dict(getattr(value, "__dict__", {}))


def _content(path: Path) -> Any:
    """Digest of a file, or of all files of a folder by name; None where there is nothing."""
    if path.is_dir():
        return [[str(file.relative_to(path)), _content(file)] for file in sorted(path.rglob("*")) if file.is_file()]
    return files_digest([path]) if path.is_file() else None
