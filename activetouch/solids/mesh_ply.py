"""The reader of PLY files, of text or bytes: vertices ``(v, 3)`` in the file's unit, and triangles ``(f, 3)``."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Protocol

from activetouch.solids.mesh_formats import Lines, SurfaceBuilder, from_text, index_of_vertex
from activetouch.solids.solid import Floats, Ints
from belief.files import plain_number

_HEADER = re.compile(rb"ply\s.*?\nend_header[ \t]*\r?\n", re.DOTALL)
_NAMES = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
_ALIASES = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
_CODES = {name: code for names in (_NAMES, _ALIASES) for name, code in zip(names, "bBhHiIfd", strict=True)}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")


class _Rows(Protocol):
    """The rows below a header."""

    def start(self, what: str) -> None:
        """Go to the next row; ``what`` names it in errors."""

    def take(self, codes: str, number: int) -> Sequence[float]:
        """The next numbers of the row, given their codes in the module ``struct``, and how many they are."""


class _TextRows:
    def __init__(self, lines: Lines) -> None:
        self._lines = lines

    def start(self, what: str) -> None:
        self._words = iter(self._lines.next(what))

    def take(self, codes: str, number: int) -> Sequence[float]:
        taken = [plain_number(word) for word in islice(self._words, number)]
        if len(taken) < number:
            raise ValueError(f"the line ends after {len(taken)} of {number} numbers")
        return taken


class _ByteRows:
    def __init__(self, content: bytes, place: int, order: str) -> None:
        self._content, self._place, self._order = content, place, order

    def start(self, what: str) -> None:
        self._what = what

    def take(self, codes: str, number: int) -> Sequence[float]:
        try:
            taken = struct.unpack_from(self._order + codes, self._content, self._place)
        except struct.error as error:
            raise ValueError(f"the file ends before {self._what}") from error
        self._place += struct.calcsize(self._order + codes)
        return taken


@dataclass
class _Element:
    """Rows of one kind, such as vertices; each property with its code, and that of the length where it is a list."""

    name: str
    number: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)

    def row(self, rows: _Rows) -> dict[str, Sequence[float]]:
        """The numbers of the next row by property."""
        found = {}
        for name, code, code_of_length in self.properties:
            length = index_of_vertex(rows.take(code_of_length, 1)[0]) if code_of_length else 1
            if length < 0:
                raise ValueError(f"a list has the length {length}")
            found[name] = rows.take(f"{length}{code}", length)
        return found


def read_ply(content: bytes) -> tuple[Floats, Ints]:
    """The faces of a PLY file of text or bytes; elements besides vertices and faces are skipped."""
    header = _HEADER.match(content)
    if header is None:
        raise ValueError("it has no header from 'ply' to 'end_header'")
    encoding, elements = _header(header[0].decode("utf-8", "replace"))
    if encoding == "ascii":
        above = b"\n" * header[0].count(b"\n")  # so that lines are counted from the beginning of the file
        return from_text(above + content[header.end() :], lambda lines, it: _fill(it, elements, _TextRows(lines)))
    surface = SurfaceBuilder()
    _fill(surface, elements, _ByteRows(content, header.end(), _ORDERS[encoding]))
    return surface.arrays()


def _header(text: str) -> tuple[str, list[_Element]]:
    """The encoding, and the elements in the order of the file."""
    encoding, elements = "", list[_Element]()
    for line in text.splitlines():
        match line.split():
            case ["format", name, *_]:
                encoding = name
            case ["element", name, number]:
                elements.append(_Element(name, index_of_vertex(plain_number(number))))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= _CODES.keys():
                elements[-1].properties.append((name, _CODES[kind], _CODES[length]))
            case ["property", kind, name] if elements and kind in _CODES:
                elements[-1].properties.append((name, _CODES[kind], ""))
            case ["element" | "property", *_]:
                raise ValueError(f"the line {line[:80]!r} of its header is not understood")
    if encoding not in ("ascii", *_ORDERS):
        raise ValueError(f"its format is {encoding[:40]!r}; ascii, {' and '.join(_ORDERS)} are read")
    for element in elements:
        names = [name for name, *_ in element.properties]
        needed = {"vertex": {"x", "y", "z"}, "face": {*_CORNERS}}.get(element.name, {*names})
        has_all = bool(needed & {*names}) if element.name == "face" else needed <= {*names}
        if not names or not has_all:
            raise ValueError(f"its element {element.name} needs the properties {sorted(needed)}, it has {names[:12]}")
    return encoding, elements


def _fill(surface: SurfaceBuilder, elements: Sequence[_Element], rows: _Rows) -> None:
    for element in elements:
        for number in range(element.number):
            rows.start(f"the end of {element.name} {number + 1} of {element.number}, which its header promises")
            row = element.row(rows)
            if element.name == "vertex":
                surface.coordinates.extend([row[axis][0] for axis in "xyz"])
            elif element.name == "face":
                corners = next(row[name] for name in _CORNERS if name in row)
                surface.add_face([index_of_vertex(corner) for corner in corners])
