"""Descriptions of pads: a layout of taxels, ranges of their response, and how they are pressed; read from TOML.

>>> pad = pad_from({"grid": {"rows": 14, "columns": 6, "pitch_mm": 3.4}, "press": {"force": [1, 15]}})
>>> pad.scene().image_shape
(14, 14)
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from activetouch.distributions import Constant, Uniform, Variation
from activetouch.named_scenes import SCENES
from activetouch.pressing.contact import Pad, Quasistatic
from activetouch.pressing.taxels import Taxels
from activetouch.rendering.response import Response, TaxelRenderer, TaxelResponse
from belief.constraints import NotNegative, Positive, check
from belief.errors import ActiveTouchError, InvalidArgument
from belief.files import require_regular_file, write_text
from belief.validation import are_finite

if TYPE_CHECKING:
    from activetouch.scene import Scene

_MOST_BYTES = 8 * 2**20
_PARTS: dict[str, tuple[str, ...]] = {
    "grid": ("rows", "columns", "pitch_mm", "mask"),
    "taxels": ("centres_mm", "normals", "area_mm2"),
    "press": ("force", "offset_mm", "depth_mm"),
}
_UNITS = {  # of numbers in files: the least and the largest one, their unit, and those of a number below or above
    "pitch_mm, or between neighbours in centres_mm,": (0.03, 100.0, "mm", "m", "µm"),
    "half the edge of the square about all taxels": (0.01, 1000.0, "mm", "m", "µm"),
    "area_mm2": (1e-3, 1e4, "mm²", "m²", "µm²"),
    "force": (0.005, 200.0, "N", "kN", "mN"),
    "offset_mm, if not 0,": (0.02, 100.0, "mm", "m", "µm"),
    "depth_mm": (0.03, 100.0, "mm", "m", "µm"),
    "full_scale_kpa": (0.2, 5e4, "kPa", "MPa", "Pa"),
    "radius_mm": (0.5, 300.0, "mm", "m", "µm"),
}


class BadPad(ActiveTouchError, ValueError):
    """A file does not describe a pad; the message names the entry."""


@dataclass(frozen=True)
class PadDescription:
    """A pad, as far as it is known.

    Attributes:
        taxels: where they are.
        response: ranges of what is not known.
        force: least and largest force of a touch [N].
        offset: largest displacement of an object from where it is aimed at, along y and z [m].
        max_depth: indentation at which the layer bottoms out [m].
        full_scale: pressure that reads full scale, for a gain of 1 [Pa].
        is_relative: whether readings are parts of the largest one of the touch, as of a sensor in unknown units;
            ``full_scale`` and the gain then mean nothing.
        dead: numbers of taxels that read nothing.

    Raises:
        InvalidArgument: a number is out of range.
    """

    taxels: Taxels
    response: Response = field(default_factory=Response)
    force: tuple[Positive, Positive] = (1.5, 3.0)
    offset: NotNegative = 0.002
    max_depth: Positive = 0.003
    full_scale: Positive = 1e5
    is_relative: bool = False
    dead: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        check(self)
        if self.force[0] > self.force[1]:
            raise InvalidArgument(f"the least force must not exceed the largest, got {self.force}")
        if set(self.dead) - set(range(len(self.taxels))) or len(self.dead) >= len(self.taxels):
            raise InvalidArgument(f"dead must be numbers of some of the {len(self.taxels)} taxels, got {self.dead}")
        for name, number in (
            ("pitch_mm, or between neighbours in centres_mm,", 1e3 * self.taxels.pitch),
            ("area_mm2", 1e6 * self.taxels.area),
            ("half the edge of the square about all taxels", 1e3 * self.taxels.half_width),
            ("force", self.force[0]),
            ("force", self.force[1]),
            ("offset_mm, if not 0,", 1e3 * self.offset),
            ("depth_mm", 1e3 * self.max_depth),
            ("full_scale_kpa", 1e-3 * self.full_scale),
        ):
            require_usual(name, number)

    @property
    def pad(self) -> Pad:
        """The pad, with the stiffness in the middle of its range."""
        low, high = self.response.stiffness.support
        return Pad.described(self.taxels, float(np.sqrt(low * high)), self.max_depth)

    def scene(self, base: Scene | None = None, share: ArrayLike | None = None) -> Scene:
        """A scene in which this pad touches the objects of another one, quasistatically.

        Args:
            base: has the objects and poses; scene ``gel`` by default.
            share: where the response lies in its ranges, ``(7,)`` in [0, 1], in the order of :class:`Response`; the
                middle by default.
        """
        base = SCENES["gel"].scene if base is None else base
        at = np.full(7, 0.5) if share is None else np.asarray(share, float)
        numbers = {name: float(one[0]) for name, one in self.response.at(at[None]).items()}
        relative, vary = numbers.pop("stiffness") / self.pad.stiffness, base.variation
        offset, force = (Uniform(-self.offset, self.offset), Uniform(*self.force))
        return replace(
            base,
            pad=self.pad,
            press_model=Quasistatic(),
            renderer=TaxelRenderer(self.full_scale),
            faults=(TaxelResponse(self.taxels, **numbers, is_relative=self.is_relative, dead=self.dead),),
            variation=Variation(vary.size, offset, force, vary.friction, Constant(relative)),
        )

    def image(self, readings: ArrayLike) -> NDArray[np.uint8]:
        """The image that a sensor of this pad reads, from the readings of its taxels.

        Args:
            readings: ``(..., N)``, or ``(..., rows, columns)`` of a full grid, in [0, 1], where 1 is full scale; or in
                any unit, if the pad ``is_relative``.

        Returns:
            ``(..., m, m)``.

        Raises:
            InvalidArgument: another number of taxels, or readings that are negative, not finite, or above 1.
        """
        given, number = np.asarray(readings, np.float64), len(self.taxels)
        if given.ndim >= 2 and given.shape[-1] != number == given.shape[-2] * given.shape[-1]:
            given = given.reshape(*given.shape[:-2], number)
        if given.shape[-1:] != (number,) or not np.isfinite(given).all():
            raise InvalidArgument(f"readings must be finite numbers of {number} taxels, got {given.shape}")
        if (given < 0.0).any():
            raise InvalidArgument(
                f"readings must be ≥ 0, got {given.min():g}: subtract those at rest, and set what is below to 0"
            )
        given = np.where(np.isin(np.arange(len(self.taxels)), self.dead), 0.0, given)
        if self.is_relative:
            largest = given.max(axis=-1, keepdims=True)
            given = given / np.where(largest > 0.0, largest, 1.0)
        elif given.max(initial=0.0) > 1.0:
            raise InvalidArgument(f"readings must be at most 1, full scale, got {given.max():g}")
        return np.rint(255 * self.taxels.shown(given)).astype(np.uint8)

    def entries(self) -> dict[str, Any]:
        """The entries of its file, as JSON types; :func:`pad_from` reads them."""
        taxels = self.taxels
        return {
            "relative": self.is_relative,
            "full_scale_kpa": _rounded(self.full_scale / 1e3),
            "dead": list(self.dead),
            "taxels": {
                "centres_mm": (1e3 * taxels.centres).round(6).tolist(),
                "normals": taxels.normals.round(9).tolist(),
                "area_mm2": _rounded(1e6 * taxels.area),
            },
            "response": {name: list(map(_rounded, ends)) for name, ends in self.response.ranges().items()},
            "press": {
                "force": list(map(_rounded, self.force)),
                "offset_mm": _rounded(1e3 * self.offset),
                "depth_mm": _rounded(1e3 * self.max_depth),
            },
        }

    def save(self, path: str | Path) -> None:
        """Write the description as TOML, as :func:`read_pad` reads it."""
        entries = self.entries()
        tables = {name: part for name, part in entries.items() if isinstance(part, dict)}
        lines = [f"{name} = {json.dumps(part)}" for name, part in entries.items() if name not in tables]
        for table, parts in tables.items():
            lines += [f"\n[{table}]", *(f"{name} = {json.dumps(part)}" for name, part in parts.items())]
        write_text(Path(path), "\n".join(lines) + "\n")


def require_usual(name: str, number: float) -> None:
    """Check that a number of a file is not as large or small as one in another unit; 0 is none."""
    low, high, unit, larger, smaller = _UNITS[name]
    if number and not low <= number <= high:
        other = larger if number < low else smaller
        raise InvalidArgument(
            f"{name} must be in [{low:g}, {high:g}] {unit}, got {number:g}: is it in {other}? In Python "
            "numbers are in m, N and Pa"
        )


def _rounded(number: float) -> float:
    return float(f"{number:.9g}")


def read_pad(path: str | Path) -> PadDescription:
    """The pad that a TOML file describes.

    Raises:
        FileNotFoundError: there is no such file.
        BadPad: it does not describe a pad.
    """
    path = require_regular_file(Path(path), BadPad)
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise BadPad(f"it has more than {_MOST_BYTES} bytes")
        return pad_from(tomllib.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise FileNotFoundError(f"there is no file {path}; relative paths start from {Path.cwd()}") from None
    except RecursionError:
        raise BadPad(f"{path} does not describe a pad: it is nested too deeply") from None
    except (OSError, ValueError) as error:  # of TOML, of the encoding, and of entries
        raise BadPad(f"{path} does not describe a pad: {error}") from error


def pad_from(entries: Mapping[str, Any]) -> PadDescription:
    """The pad of a file's entries; raises BadPad, which names the entry that is wrong."""
    known = {"relative", "full_scale_kpa", "dead", "response", *_PARTS}
    _require_known("the description", entries, known)
    for name, keys in _PARTS.items():
        if not isinstance(entries.get(name, {}), Mapping):
            raise BadPad(f"{name} must be a table, [{name}], got {entries[name]!r:.80}")
        _require_known(f"[{name}]", entries.get(name, {}), {*keys})
    if ("grid" in entries) is ("taxels" in entries):
        raise BadPad("a pad has a [grid] with rows, columns and pitch_mm, or [taxels] with centres_mm: one of them")
    response, press = entries.get("response", {}), entries.get("press", {})
    if not isinstance(response, Mapping):
        raise BadPad(f"response must be a table, [response], got {response!r:.80}")
    numbers: dict[str, Any] = {}
    for name, unit, given in (
        ("full_scale", 1e3, entries.get("full_scale_kpa")),
        ("offset", 1e-3, press.get("offset_mm")),
        ("max_depth", 1e-3, press.get("depth_mm")),
    ):
        if given is not None:
            numbers[name] = unit * _number(name, given)
    if "force" in press:
        numbers["force"] = tuple(_numbers("[press] force, [low, high]", press["force"], 2))
    dead, relative = entries.get("dead", []), entries.get("relative", False)
    if not isinstance(dead, list) or not all(type(one) is int for one in dead) or not isinstance(relative, bool):
        raise BadPad(f"dead must be a list of whole numbers, relative true or false; got {dead!r:.60}, {relative!r}")
    try:
        layout = _grid(entries["grid"]) if "grid" in entries else _taxels(entries["taxels"])
        return PadDescription(layout, Response.of(response), **numbers, is_relative=relative, dead=tuple(dead))
    except InvalidArgument as error:
        raise BadPad(str(error)) from error


def _grid(grid: Mapping[str, Any]) -> Taxels:
    rows, columns, mask = grid.get("rows"), grid.get("columns"), grid.get("mask")
    if type(rows) is not int or type(columns) is not int:
        raise BadPad(f"[grid] rows and columns must be whole numbers, got {rows!r:.40} and {columns!r:.40}")
    if mask is not None and not (isinstance(mask, list) and all(isinstance(line, str) for line in mask)):
        raise BadPad(f'[grid] mask must be a list of texts such as "##..##", got {mask!r:.80}')
    return Taxels.grid(rows, columns, 1e-3 * _number("[grid] pitch_mm", grid.get("pitch_mm")), mask)


def _taxels(given: Mapping[str, Any]) -> Taxels:
    centres = _points("[taxels] centres_mm", given.get("centres_mm"))
    normals = np.tile([1.0, 0.0, 0.0], (len(centres), 1))
    if "normals" in given:
        normals = _points("[taxels] normals", given["normals"])
    area = given.get("area_mm2")
    if area is None:
        area = 1e6 * Taxels(1e-3 * centres, normals, 1e-6).pitch ** 2
    return Taxels(1e-3 * centres, normals, 1e-6 * _number("[taxels] area_mm2", area))


def _points(name: str, given: Any) -> NDArray[np.float64]:
    if not isinstance(given, list) or not given:
        raise BadPad(f"{name} must be a list of points [x, y, z], got {given!r:.80}")
    return np.array([_numbers(f"{name}[{i}]", one, 3) for i, one in enumerate(given)])


def _numbers(name: str, given: Any, number: int) -> list[float]:
    if not isinstance(given, list) or len(given) != number:
        raise BadPad(f"{name} must be {number} numbers, got {given!r:.80}")
    return [_number(name, one) for one in given]


def _number(name: str, given: Any) -> float:
    if isinstance(given, bool) or not isinstance(given, int | float) or not are_finite(given):
        raise BadPad(f"{name} must be a finite number, got {given!r:.40}")
    return float(given)


def _require_known(where: str, given: Mapping[str, Any], known: set[str]) -> None:
    if unknown := sorted(map(str, set(given) - known)):
        raise BadPad(f"{where} has no entry {unknown[0]!r}, only {', '.join(sorted(known))}")
