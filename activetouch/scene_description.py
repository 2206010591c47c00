"""A scene as plain fields that files carry, and what differs between two of them.

Checkpoints, observation models, collections and touch banks say with it which scene they were made for. Some
differences change what images look like, so that nothing learned from one scene holds in the other: other shapes,
poses, pad or renderer. Others are a *known shift* of the same sensor: another way to press, other faults, sizes,
forces or orientations. What stands around the pad changes no touch (decision 0010) and makes no difference.

    >>> from activetouch import SCENES
    >>> gel, coarse = (scene_fields(SCENES[name].scene) for name in ("gel", "coarse"))
    >>> [str(difference) for difference in scene_differences(gel, coarse)][:2]
    ['pad.num_taxels is 32, not 128', 'renderer.binning is 8, not 1']
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cached_property
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from activetouch.errors import WrongScene
from activetouch.solids.mesh import Mesh
from belief.identity import is_own, source_digest

if TYPE_CHECKING:
    from activetouch.scene import Scene

SHIFTS = frozenset({"press_model", "faults", "variation", "presentation"})
"""Parts of a scene whose change is a known shift of the same sensor."""
SURROUNDINGS = frozenset({"height", "finger", "parking", "robot"})
"""Parts of a scene that change no touch."""
_DECIMALS = 8  # of arrays, beyond which processors differ
_LARGEST = 64  # numbers of an array that are written out
_DEEPEST = 20


@dataclass(frozen=True)
class SceneDifference:
    """One field in which a scene is not the one that something was made for.

    Attributes:
        path: of the field, such as ``pad.num_taxels``.
        made_for: its value where the thing was made, in a few words.
        here: its value in the scene at hand.
    """

    path: str
    made_for: str
    here: str

    @property
    def is_shift(self) -> bool:
        """Whether it is a known shift, which leaves the sensor the same."""
        return self.path.partition(".")[0] in SHIFTS

    def __str__(self) -> str:
        return f"{self.path} is {self.here}, not {self.made_for}"


def scene_fields(scene: Scene) -> dict[str, Any]:
    """All of a scene as JSON types; equal scenes have equal fields, on any machine.

    Arrays are rounded to the eighth decimal, meshes told by their digest. A class that is not this distribution's is
    told together with the digest of its source, so that an edited renderer makes another scene.
    """
    return {field.name: _described(getattr(scene, field.name)) for field in fields(scene)}


def scene_differences(
    made_for: Mapping[str, Any], here: Mapping[str, Any], surroundings: bool = False
) -> tuple[SceneDifference, ...]:
    """In which fields a scene is not the one that something was made for; those that matter most come first.

    Args:
        made_for: fields of that scene, from :func:`scene_fields`.
        here: fields of the scene at hand.
        surroundings: whether to tell what changes no touch as well.
    """
    names = [name for name in {**here, **made_for} if surroundings or name not in SURROUNDINGS]
    found = [d for name in names for d in _differences(made_for.get(name), here.get(name), name)]
    return tuple(sorted(found, key=lambda difference: difference.is_shift))


def require_scene(
    what: str, made_for: Mapping[str, Any] | None, here: Mapping[str, Any], anyway: bool = False
) -> tuple[str, ...]:
    """Refuse to use something in a scene that it was not made for.

    Args:
        what: the thing, in words.
        made_for: fields of its scene; None if it does not say.
        here: fields of the scene at hand.
        anyway: whether to use it all the same.

    Returns:
        The differences that are known shifts, or that were accepted with ``anyway``, in words.

    Raises:
        WrongScene: there are differences beyond known shifts.
    """
    if made_for is None:
        if not anyway:
            raise WrongScene(f"{what} does not say for which scene it was made")
        return (f"{what} does not say for which scene it was made",)
    found = scene_differences(made_for, here)
    if not anyway and any(not difference.is_shift for difference in found):
        raise WrongScene(f"{what} was made for another scene: {in_words(map(str, found))}")
    return tuple(map(str, found))


def in_words(differences: Iterator[str] | Sequence[str], most: int = 6) -> str:
    """Differences in a row, the first few of many."""
    told = list(differences)
    return "; ".join(told[:most]) + (f"; and {len(told) - most} more" if len(told) > most else "")


def _described(value: Any, depth: int = 0) -> Any:
    if value is None or isinstance(value, bool | int | str):
        return value.value if isinstance(value, Enum) else value
    if isinstance(value, float | np.number | np.bool_):
        plain = value.item() if isinstance(value, np.generic) else float(value)
        return plain if math.isfinite(plain) else repr(plain)
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mesh):
        return {"class": "Mesh", "triangles": len(value.faces), "sha256": value.digest}
    if depth > _DEEPEST:
        return repr(value)
    if isinstance(value, Mapping):  # their order counts
        return {"entries": [[str(key), _described(part, depth + 1)] for key, part in value.items()]}
    if isinstance(value, Sequence | frozenset | set):
        return [
            _described(part, depth + 1) for part in (sorted(value) if isinstance(value, frozenset | set) else value)
        ]
    return {**_class_of(value), **_state(value, depth)}


def _array(value: np.ndarray) -> Any:
    if value.dtype.kind not in "biuf":
        return repr(value)
    rounded = np.round(value, _DECIMALS) + 0.0 if value.dtype.kind == "f" else value  # no -0
    if value.size <= _LARGEST:
        return _described(rounded.tolist())
    content = hashlib.sha256(np.ascontiguousarray(rounded.astype(np.float64)).tobytes()).hexdigest()
    return {"class": "array", "shape": list(value.shape), "sha256": content}


def _class_of(value: Any) -> dict[str, str]:
    kind = value if isinstance(value, type | FunctionType) else type(value)
    if is_own(kind):
        return {"class": kind.__qualname__}
    return {"class": f"{kind.__module__}.{kind.__qualname__}", "class_sha256": source_digest(kind)}


def _state(value: Any, depth: int) -> dict[str, Any]:
    """What makes an object beside its class."""
    if isinstance(value, type | FunctionType):
        return {}
    if is_dataclass(value):
        return {field.name: _described(getattr(value, field.name), depth + 1) for field in fields(value)}
    if "__repr__" in {name for part in type(value).__mro__[:-1] for name in vars(part)}:
        return {"repr": repr(value)}
    cached = {name for part in type(value).__mro__ for name, m in vars(part).items() if isinstance(m, cached_property)}
    members = getattr(value, "__dict__", {})
    return {name: _described(part, depth + 1) for name, part in members.items() if name not in cached}


def _differences(made_for: Any, here: Any, path: str) -> Iterator[SceneDifference]:
    if made_for == here:
        return
    match made_for, here:
        case {"entries": first}, {"entries": second} if [k for k, _ in first] == [k for k, _ in second]:
            for (label, one), (_, other) in zip(first, second, strict=True):
                yield from _differences(one, other, f"{path}.{label}")
        case {"class": first}, {"class": second} if first == second and made_for.keys() == here.keys():
            for name in here:
                yield from _differences(made_for[name], here[name], f"{path}.{name}")
        case list(), list() if len(made_for) == len(here) and any(isinstance(part, dict) for part in here):
            for number, (one, other) in enumerate(zip(made_for, here, strict=True)):
                yield from _differences(one, other, f"{path}.{number}")
        case _:
            yield SceneDifference(path, _short(made_for), _short(here))


def _short(value: Any) -> str:
    """A value in a few words."""
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
