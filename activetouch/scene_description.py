"""Scenes as JSON fields, and differences between scenes.

Checkpoints, observation models, collections and touch banks contain the fields of their scene. A difference in press,
faults, variation, presentation, moves or the proportions of a family is a *known shift* of the same sensor: a sensor
that was made for the nominal solid may be used for the family, with a warning, to measure what that costs. Other
differences need another sensor.

    >>> from activetouch import SCENES
    >>> gel, coarse = (scene_fields(SCENES[name].scene) for name in ("gel", "coarse"))
    >>> [str(difference) for difference in scene_differences(gel, coarse)][:2]
    ['pad.num_taxels is 32, not 128', 'renderer.binning is 8, not 1']
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cached_property, partial
from pathlib import Path
from types import FunctionType, ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from activetouch.errors import WrongScene
from belief.files import source_digest

if TYPE_CHECKING:
    from activetouch.scene import Scene

SHIFTS = frozenset({"press_model", "faults", "variation", "presentation", "families", "moves"})
"""Fields of a scene whose change is a known shift of the same sensor."""
OBJECTS = ("shapes", "families", "poses", "aims", "presentation", "hand")
"""Fields of a scene that are about its objects and how they are met, not about its sensor."""
SURROUNDINGS = frozenset({"height", "finger", "parking", "robot"})
"""Fields of scenes in files of earlier versions, which changed no touch."""
_DECIMALS = 8  # decimals of arrays; further ones differ between processors
_LARGEST = 64  # size of the largest array that is not replaced by its digest
_DEEPEST = 20  # level of nesting


@dataclass(frozen=True)
class SceneDifference:
    """A field in which two scenes differ: its path, such as ``pad.num_taxels``, and its values in both, as text."""

    path: str
    made_for: str
    here: str

    @property
    def is_shift(self) -> bool:
        """Whether it is a known shift of the same sensor."""
        return self.path.partition(".")[0] in SHIFTS

    def __str__(self) -> str:
        return f"{self.path} is {self.here}, not {self.made_for}"


def scene_fields(scene: Scene) -> dict[str, Any]:
    """All fields of a scene as JSON types; equal scenes have equal fields on any machine.

    Arrays are rounded to eight decimals; meshes are replaced by digests. A user's class has the digest of its source
    code, so that an edited renderer makes another scene; an object with its own ``__repr__``, unless a dataclass, is
    described by that text alone. A family is described by its nominal solid among the shapes, and by the distributions
    of its parameters in ``families``. Aims, hand, moves and families have no field in scenes without them.
    """
    named = [field.name for field in fields(scene)]
    names = [name for name in named if name not in ("aims", "hand", "moves") or getattr(scene, name)]
    found = {name: described(scene.solids if name == "shapes" else getattr(scene, name)) for name in names}
    families = getattr(scene, "families", {})
    parts = {f"{label}.{name}": given for label, family in families.items() for name, given in family.parameters}
    return found | {"robot": None} | ({"families": described(parts)} if parts else {})


def scene_differences(
    made_for: Mapping[str, Any], here: Mapping[str, Any], surroundings: bool = False
) -> tuple[SceneDifference, ...]:
    """The fields in which two scenes differ, known shifts last; ``surroundings`` adds fields that change no touch."""
    names = [name for name in {**here, **made_for} if surroundings or name not in SURROUNDINGS]
    found = [d for name in names for d in _differences(made_for.get(name), here.get(name), name)]
    return tuple(sorted(found, key=lambda difference: difference.is_shift))


def require_scene(
    what: str, made_for: Mapping[str, Any] | None, here: Mapping[str, Any], anyway: bool = False
) -> tuple[str, ...]:
    """Check that scenes differ by known shifts at most, or accept all with ``anyway``; return the differences."""
    if made_for is None:
        unknown = f"{what} does not say for which scene it was made"
        if not anyway:
            raise WrongScene(unknown)
        return (unknown,)
    found = scene_differences(made_for, here)
    if not anyway and any(not difference.is_shift for difference in found):
        raise WrongScene(f"{what} was made for another scene: {in_words(map(str, found))}")
    return tuple(map(str, found))


def in_words(differences: Iterable[str]) -> str:
    """The first six differences, joined, and the number of further ones."""
    texts = list(differences)
    return "; ".join(texts[:6]) + (f"; and {len(texts) - 6} more" if len(texts) > 6 else "")


def described(value: Any, depth: int = 0) -> Any:
    """A part of a scene as JSON types, as :func:`scene_fields` has it; a mesh by its digest."""
    if value is None or isinstance(value, bool | int | str):
        return value.value if isinstance(value, Enum) else value
    if isinstance(value, float | np.number | np.bool_):
        plain = value.item() if isinstance(value, np.generic) else float(value)
        return plain if math.isfinite(plain) else repr(plain)
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, ModuleType):
        return value.__name__
    if depth > _DEEPEST:
        return repr(value)
    if isinstance(value, Mapping):  # a list, because JSON objects have no order
        return {"entries": [[str(key), described(part, depth + 1)] for key, part in value.items()]}
    if isinstance(value, Sequence | frozenset | set):
        parts = sorted(value) if isinstance(value, frozenset | set) else value
        return [described(part, depth + 1) for part in parts]
    own = _class_of(value)
    if own == {"class": "Mesh"}:  # of :mod:`activetouch.solids.mesh`
        return {**own, "triangles": len(value.faces), "sha256": value.digest}
    return {**own, **_state(value, depth)}


def _array(value: np.ndarray) -> Any:
    if value.dtype.kind not in "biuf":
        return described(value.tolist())
    rounded = np.round(value, _DECIMALS) + 0.0 if value.dtype.kind == "f" else value  # no -0
    if value.size <= _LARGEST:
        return described(rounded.tolist())
    content = hashlib.sha256(np.ascontiguousarray(rounded.astype(np.float64)).tobytes()).hexdigest()
    return {"class": "array", "shape": list(value.shape), "sha256": content}


def _class_of(value: Any) -> dict[str, str]:
    kind = value if isinstance(value, type | FunctionType) else type(value)
    if kind.__module__.startswith(f"{__package__}."):
        return {"class": kind.__qualname__}
    return {"class": f"{kind.__module__}.{kind.__qualname__}", "class_sha256": source_digest(kind)}


def _state(value: Any, depth: int) -> dict[str, Any]:
    """The state of an object."""
    if isinstance(value, FunctionType):
        cells = [cell.cell_contents for cell in value.__closure__ or ()]
        parts = {"closure": cells, "defaults": value.__defaults__, "named_defaults": value.__kwdefaults__}
        return {name: described(part, depth + 1) for name, part in parts.items() if part}
    if isinstance(value, type):
        return {}
    if isinstance(value, partial):
        return {name: described(getattr(value, name), depth + 1) for name in ("func", "args", "keywords")}
    if is_dataclass(value):
        named = [field for field in fields(value) if field.metadata.get("changes_touches", True)]
        found = {field.name: getattr(value, field.name) for field in named}
        absent = {field.name for field in named if field.metadata.get("is_optional") and found[field.name] is None}
        return {name: described(part, depth + 1) for name, part in found.items() if name not in absent}
    if "__repr__" in {name for part in type(value).__mro__[:-1] for name in vars(part)}:
        return {"repr": repr(value)}
    cached = {name for part in type(value).__mro__ for name, m in vars(part).items() if isinstance(m, cached_property)}
    given = [part.__dict__.get("__slots__", ()) for part in type(value).__mro__]
    slots = [name for names in given for name in ((names,) if isinstance(names, str) else names)]
    members = {name: getattr(value, name) for name in slots if hasattr(value, name)} | getattr(value, "__dict__", {})
    return {name: described(part, depth + 1) for name, part in members.items() if name not in cached}


def _differences(made_for: Any, here: Any, path: str) -> Iterator[SceneDifference]:
    if made_for == here:
        return
    match made_for, here:
        case {"entries": first}, {"entries": second} if [k for k, _ in first] == [k for k, _ in second]:
            for (label, one), (_, other) in zip(first, second, strict=True):
                yield from _differences(one, other, f"{path}.{label}")
        case {"class": first}, {"class": second} if first == second:
            for name in {**here, **made_for}:
                yield from _differences(made_for.get(name), here.get(name), f"{path}.{name}")
        case list(), list() if len(made_for) == len(here) and any(isinstance(part, dict) for part in here):
            for number, (one, other) in enumerate(zip(made_for, here, strict=True)):
                yield from _differences(one, other, f"{path}.{number}")
        case _:
            yield SceneDifference(path, _short(made_for), _short(here))


def _short(value: Any) -> str:
    """A value as text of at most 60 characters."""
    match value:
        case {"entries": entries}:
            text = "[" + ", ".join(str(label) for label, _ in entries) + "]"
        case {"class": name}:
            text = str(name)
        case list():
            text = "[" + ", ".join(map(_short, value)) + "]"
        case _:
            text = str(value)
    return text if len(text) <= 60 else f"{text[:59]}…"
