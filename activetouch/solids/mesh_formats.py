"""Readers of mesh files of text or bytes: vertices ``(v, 3)`` in the file's unit, and triangles ``(f, 3)``.

Every reader raises ValueError with the reason and the line for what it cannot read, needs memory in proportion to the
size of the file whatever its header promises, opens no other file, and divides polygons into fans of triangles.
"""

from __future__ import annotations

import io
import re
import struct
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from activetouch.solids.solid import Floats, Ints
from belief.files import plain_number

_STL_HEADER = 84
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_MOST = 2**53  # integers below are exact as floats
_PLY_HEADER = re.compile(rb"ply\s.*?\nend_header[ \t]*\r?\n", re.DOTALL)
_NAMES = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
_ALIASES = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
_CODES = {name: code for names in (_NAMES, _ALIASES) for name, code in zip(names, "bBhHiIfd", strict=True)}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")


class SurfaceBuilder:
    """The vertices and polygons that a reader found so far."""

    def __init__(self) -> None:
        self.coordinates, self.corners, self.sizes = array("d"), array("q"), array("q")

    @property
    def num_vertices(self) -> int:
        """Number of vertices so far."""
        return len(self.coordinates) // 3

    def add_vertex(self, words: Sequence[str]) -> None:
        """Add the vertex that the first three words give; the others are weights, normals or colours."""
        if len(words) < 3:
            raise ValueError(f"a vertex has {len(words)} numbers instead of 3")
        self.coordinates.extend([plain_number(word) for word in words[:3]])

    def add_face(self, corners: Sequence[int]) -> None:
        """Add a polygon of three or more vertices, given by their indices."""
        if len(corners) < 3:
            raise ValueError(f"a face has {len(corners)} corners, it needs at least 3")
        self.corners.extend(corners)
        self.sizes.append(len(corners))

    def arrays(self) -> tuple[Floats, Ints]:
        """The vertices, and the triangles as indices of vertices; raises ValueError for an index of no vertex."""
        vertices = np.array(self.coordinates, np.float64).reshape(-1, 3)
        faces = _fans(np.array(self.corners, np.intp), np.array(self.sizes, np.intp))
        if (wrong := faces[(faces < 0) | (faces >= len(vertices))]).size:
            raise ValueError(
                f"a face has the vertex {wrong[0]}, counted from 0, and there are {len(vertices)} vertices"
            )
        return vertices, faces


def _fans(corners: Ints, sizes: Ints) -> Ints:
    """The triangles ``(f, 3)`` of polygons of so many corners ``(p,)``, which are listed one after the other.

    >>> _fans(np.array([0, 1, 2, 3, 7, 8, 9]), np.array([4, 3])).tolist()
    [[0, 1, 2], [0, 2, 3], [7, 8, 9]]
    """
    num = sizes - 2
    first = np.repeat(np.cumsum(sizes) - sizes, num)
    step = np.arange(len(first)) - np.repeat(np.cumsum(num) - num, num)
    return corners[np.column_stack([first, first + step + 1, first + step + 2])]


class Lines:
    """The lines of a text that are not empty, as words without comments; ``number`` is that of the last line."""

    def __init__(self, content: bytes) -> None:
        self._text = io.TextIOWrapper(io.BytesIO(content), encoding="utf-8-sig", errors="replace")
        self.number = 0

    def __iter__(self) -> Iterator[list[str]]:
        for line in self._text:
            self.number += 1
            if words := line.partition("#")[0].split():
                yield words

    def next(self, what: str) -> list[str]:
        """The next line; raises ValueError if there is none."""
        for words in self:
            return words
        raise ValueError(f"the file ends before {what}")


def index_of_vertex(number: float) -> int:
    """A number as an integer; raises ValueError if it is none."""
    if not (float(number).is_integer() and abs(number) < _MOST):
        raise ValueError(f"{number:g} is not a whole number")
    return int(number)


def from_text(content: bytes, fill: Callable[[Lines, SurfaceBuilder], None]) -> tuple[Floats, Ints]:
    """The surface that a function fills from lines; its ValueErrors get the number of the line."""
    lines, surface = Lines(content), SurfaceBuilder()
    try:
        fill(lines, surface)
    except ValueError as error:
        raise ValueError(f"line {lines.number}: {error}") from error
    return surface.arrays()


def read_stl(content: bytes) -> tuple[Floats, Ints]:
    """The triangles of an STL file, binary or text, each with corners of its own."""
    promised, size = int.from_bytes(content[80:_STL_HEADER], "little"), _STL_TRIANGLE.itemsize
    rest = len(content) - _STL_HEADER
    if rest >= 0 and rest == promised * size:
        corners = np.frombuffer(content, _STL_TRIANGLE, offset=_STL_HEADER)["corners"].reshape(-1, 3)
        return corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3)
    if b"\0" not in content:
        return from_text(content, _fill_from_stl)
    raise ValueError(
        f"its header promises {promised} triangles, {_STL_HEADER + promised * size} bytes; the file has {len(content)} "
        f"bytes, which hold {max(rest, 0) // size} triangles"
    )


def _fill_from_stl(lines: Lines, surface: SurfaceBuilder) -> None:
    """Read the triangles of text; normals are not used."""
    first = 0
    for words in lines:
        keyword = words[0].lower()
        if keyword == "vertex":
            surface.add_vertex(words[1:])
        elif keyword == "endloop" or (keyword == "endsolid" and surface.num_vertices > first):
            if surface.num_vertices != first + 3:
                raise ValueError(f"a triangle has {surface.num_vertices - first} corners instead of 3")
            surface.add_face((first, first + 1, first + 2))
            first = surface.num_vertices
    if surface.num_vertices > first:
        raise ValueError("the file ends within a triangle")


def read_obj(content: bytes) -> tuple[Floats, Ints]:
    """The faces of all objects of an OBJ file; a negative index counts back from the line that it is in."""

    def fill(lines: Lines, surface: SurfaceBuilder) -> None:
        for words in lines:
            if words[0] == "v":
                surface.add_vertex(words[1:])
            elif words[0] == "f":
                surface.add_face([_obj_index(word, surface.num_vertices) for word in words[1:]])

    return from_text(content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" "), fill)


def _obj_index(word: str, num_before: int) -> int:
    """The index, from 0, of the vertex in ``5``, ``5/1``, ``5//2`` or ``-1`` after some vertices."""
    index = index_of_vertex(plain_number(word.partition("/")[0]))
    if index == 0 or index < -num_before:
        raise ValueError(f"a face has the vertex {index}; they count from 1, or back from -1 to -{num_before}")
    return index - 1 if index > 0 else num_before + index


class _TextRows:
    """The rows of a text: ``start`` goes to the next, ``take`` gives its next numbers by their codes of ``struct``."""

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
    """The same of bytes."""

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

    def row(self, rows: _TextRows | _ByteRows) -> dict[str, Sequence[float]]:
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
    header = _PLY_HEADER.match(content)
    if header is None:
        raise ValueError("it has no header from 'ply' to 'end_header'")
    encoding, elements = _ply_header(header[0].decode("utf-8", "replace"))
    if encoding == "ascii":
        above = b"\n" * header[0].count(b"\n")  # so that lines are counted from the beginning of the file
        return from_text(
            above + content[header.end() :], lambda lines, it: _fill_from_ply(it, elements, _TextRows(lines))
        )
    surface = SurfaceBuilder()
    _fill_from_ply(surface, elements, _ByteRows(content, header.end(), _ORDERS[encoding]))
    return surface.arrays()


def _ply_header(text: str) -> tuple[str, list[_Element]]:
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


def _fill_from_ply(surface: SurfaceBuilder, elements: Sequence[_Element], rows: _TextRows | _ByteRows) -> None:
    for element in elements:
        for number in range(element.number):
            rows.start(f"the end of {element.name} {number + 1} of {element.number}, which its header promises")
            row = element.row(rows)
            if element.name == "vertex":
                surface.coordinates.extend([row[axis][0] for axis in "xyz"])
            elif element.name == "face":
                corners = next(row[name] for name in _CORNERS if name in row)
                surface.add_face([index_of_vertex(corner) for corner in corners])
