"""Digest of an object's settings and of the code that they run (decision 0033), and versions of the packages.

Settings are the attributes of an object, their attributes, and so on. Code is the modules of all their classes and
base classes: the text on disk, and the functions as this process has loaded them (:mod:`belief.identity`). Modules that
these import are included if they belong to :mod:`planners` or to no installed package.
"""

from __future__ import annotations

import enum
import functools
import hashlib
import importlib.metadata
import inspect
import json
import platform
import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from types import FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from belief.files import require_regular_file
from belief.identity import class_code, function_code, is_standard, module_code

_OWN = ("activetouch", "belief", "experiments")  # read by version, and by the digests that run.json has of them
_INSTALLED = ("site-packages", "dist-packages")
_PLAIN = (type(None), bool, int, float, complex, str, bytes)
_PACKAGES = ("activetouch", "mujoco-core", "numpy", "scipy", "onnxruntime")  # that a touch depends on
_CODE = ("activetouch", "belief", "planners")  # packages whose code every episode runs
_BITS = 40  # of a number: two kinds of processors may compute the last ones otherwise


def fingerprint(thing: object, target: str | None = None, given: Mapping[str, object] | None = None) -> str:
    """SHA-256 of what a thing is: equal for equal settings and equal code, in any process on any machine.

    Args:
        thing: an object such as a decider, or a function.
        target: shape that is searched for; an object with a method ``files`` is asked which files it reads for it.
        given: things by name that stand for themselves, however they are made.

    >>> from planners.stopping import PosteriorThresholds
    >>> fingerprint(PosteriorThresholds()) == fingerprint(PosteriorThresholds(confirm=0.99))
    True
    >>> fingerprint(PosteriorThresholds()) == fingerprint(PosteriorThresholds(confirm=0.9))
    False
    """
    walk = _Walk(target, {id(value): name for name, value in (given or {}).items()})
    described = walk.describe(thing)
    return _sha256(json.dumps([described, _code_of(walk.modules)]))


def modules_of(thing: object) -> set[str]:
    """Names of the modules that the classes of a thing, and of its settings, come from."""
    walk = _Walk(None, {})
    walk.describe(thing)
    return walk.modules


def files_digest(paths: Iterable[Path]) -> str:
    """SHA-256 of the content of files, wherever they lie."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(require_regular_file(path).read_bytes())
    return digest.hexdigest()


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Versions of Python and of all packages that a touch depends on."""
    return {"python": platform.python_version()} | {name: importlib.metadata.version(name) for name in _PACKAGES}


@lru_cache(maxsize=1)
def code_digests() -> dict[str, str]:
    """SHA-256 of the source text of each package that all episodes run, computed once per process."""
    root = Path(__file__).parents[2]
    found = {}
    for name in _CODE:
        digest = hashlib.sha256()
        for file in sorted((root / name).rglob("*.py")):
            digest.update(str(file.relative_to(root)).encode() + file.read_bytes())
        found[name] = digest.hexdigest()
    return found


def made_with() -> dict[str, str]:
    """Versions of packages and digests of code, on which everything that is computed depends."""
    return versions() | code_digests()


def commit_of_code() -> str:
    """Git commit of this code, marked if there are uncommitted changes; empty outside a Git checkout."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""


_IN_WORDS = {
    "problem": "objects or costs of a search (--num-objects, --composition, --touch-cost, --abstain)",
    "scene_code_sha256": "code of the scene",
    "sensor_sha256": "sensor",
    "observation_model_code_sha256": "code of the observation model",
}


def differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """What differs between two identities, in words."""
    keys = sorted(key for key in {*one, *other} if one.get(key) != other.get(key))
    return ", ".join(_IN_WORDS.get(key, key) for key in keys)


class _Walk:
    """Describes a tree of objects in words that JSON knows, and notes the modules of their classes."""

    def __init__(self, target: str | None, given: Mapping[int, str]) -> None:
        self.modules: set[str] = set()
        self._target, self._given = target, given
        self._seen: dict[int, object] = {}  # holds on to what it has seen, so that no number is used again

    def describe(self, value: Any) -> Any:
        """What a value is."""
        if id(value) in self._given:
            return ["given", self._given[id(value)]]
        if isinstance(value, float | np.floating):
            return ["float", _rounded(np.asarray(value, np.float64))]
        if isinstance(value, np.generic):
            return self.describe(value.item())
        if isinstance(value, enum.Enum):
            return [*self._class(type(value)), value.name]
        if isinstance(value, _PLAIN):
            return repr(value)
        if isinstance(value, np.ndarray):
            return ["array", str(value.dtype), list(value.shape), _rounded(value)]
        if isinstance(value, Path):
            return ["path", _content(value)]
        if id(value) in self._seen:
            return ["seen", list(self._seen).index(id(value))]
        self._seen[id(value)] = value
        if isinstance(value, Mapping):
            return ["mapping", [[self.describe(key), self.describe(one)] for key, one in value.items()]]
        if isinstance(value, list | tuple):
            return [type(value).__name__, [self.describe(one) for one in value]]
        if isinstance(value, set | frozenset):
            return ["set", sorted(json.dumps(self.describe(one)) for one in value)]
        return self._callable(value) if callable(value) and not _is_instance(value) else self._object(value)

    def _callable(self, value: Any) -> Any:
        if isinstance(value, type):
            return ["class", *self._class(value)]
        if isinstance(value, MethodType):
            return ["method", self.describe(value.__self__), value.__name__]
        if isinstance(value, functools.partial):
            return ["partial", *map(self.describe, (value.func, value.args, value.keywords))]
        function = inspect.unwrap(value)
        self._note(getattr(function, "__module__", None))
        cells = [cell.cell_contents for cell in getattr(function, "__closure__", None) or ()]
        return ["function", getattr(function, "__qualname__", ""), function_code(function), *map(self.describe, cells)]

    def _object(self, value: Any) -> Any:
        described = [*self._class(type(value))]
        if callable(files := getattr(value, "files", None)) and self._target is not None:
            described.append([[path.name, _content(path)] for path in files(self._target)])
        for name, one in _settings(value).items():
            if not (files and isinstance(one, Path)):
                described.append([name, self.describe(one)])
        return described

    def _class(self, cls: type) -> list[Any]:
        """Names of a class, and what it and its bases are as loaded."""
        bases = [base for base in cls.__mro__ if not is_standard(base.__module__)]
        for base in bases:
            self._note(base.__module__)
        return [f"{cls.__module__}.{cls.__qualname__}", [class_code(base) for base in bases]]

    def _note(self, module: str | None) -> None:
        if module is not None and not is_standard(module):
            self.modules.add(module)


def _is_instance(value: object) -> bool:
    """Whether it is an object with settings, though it may be called."""
    known = type, FunctionType, MethodType, functools.partial
    return not isinstance(value, known) and not hasattr(value, "__wrapped__") and hasattr(value, "__dict__")


def _settings(value: Any) -> dict[str, Any]:
    """Attributes that were given to it; not those that it keeps for itself, where it says which."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value) if field.init}
    slots = [name for cls in type(value).__mro__ for name in getattr(cls, "__slots__", ())]
    return {name: getattr(value, name) for name in slots if hasattr(value, name)} | dict(getattr(value, "__dict__", {}))


def _content(path: Path) -> Any:
    """Digest of a file, or of all files of a folder by name; None where there is nothing."""
    if path.is_dir():
        return [[str(file.relative_to(path)), _content(file)] for file in sorted(path.rglob("*")) if file.is_file()]
    return files_digest([path]) if path.is_file() else None


def _rounded(values: NDArray[Any]) -> str:
    if values.dtype.kind != "f":
        return _sha256(values.tobytes()) if values.dtype.kind != "O" else _sha256(repr(values.tolist()))
    mantissa, exponent = np.frexp(values.astype(np.float64))
    rounded = np.round(mantissa * 2.0**_BITS)
    up = np.abs(rounded) == 2.0**_BITS  # to a power of two, whose own mantissa is ½
    return _sha256(np.where(up, rounded / 2, rounded).tobytes() + (exponent + up).tobytes())


def _code_of(modules: Iterable[str]) -> list[list[Any]]:
    """Text and loaded functions of modules, and of what they import of :mod:`planners` or of a user's own."""
    known: dict[str, list[Any]] = {}
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        module = sys.modules.get(name)
        if name in known or module is None:
            continue
        file = getattr(module, "__file__", None)
        text = files_digest([Path(file)]) if file and Path(file).is_file() else None
        known[name] = [name, text, module_code(module)]
        if not _is_installed(module):
            waiting += [one for value in list(vars(module).values()) if (one := _home(value)) and _is_followed(one)]
    return [known[name] for name in sorted(known)]


def _home(value: Any) -> str | None:
    """The module that something in a module's namespace comes from."""
    if isinstance(value, ModuleType):
        return value.__name__
    home = getattr(value, "__module__", None) or type(value).__module__
    return home if isinstance(home, str) else None


def _is_followed(name: str) -> bool:
    top, module = name.partition(".")[0], sys.modules.get(name)
    if module is None or is_standard(name) or top in _OWN:
        return False
    return top == "planners" or not _is_installed(module)


def _is_installed(module: ModuleType) -> bool:
    """Whether it came as a package: its version tells what it is. What this distribution holds never counts as such."""
    if module.__name__.partition(".")[0] in ("planners", *_OWN):
        return False
    return any(part in _INSTALLED for part in Path(getattr(module, "__file__", None) or "").parts)


def _sha256(content: str | bytes) -> str:
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()
