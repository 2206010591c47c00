"""Readers of mesh files of text or bytes: vertices ``(v, 3)`` in the file's unit, and triangles ``(f, 3)``.

Every reader raises ValueError with the reason and the line for what it cannot read, needs memory in proportion to the
size of the file whatever its header promises, opens no other file, and divides polygons into fans of triangles.
"""

from __future__ import annotations

import io
import re
from array import array
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from activetouch.solids.mesh_assembly import fans, joined
from activetouch.solids.solid import Floats, Ints
from belief.files import plain_number

_STL_HEADER = 84
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_OFF = re.compile(r"(ST)?C?N?OFF", re.IGNORECASE)
_MOST = 2**53  # integers below are exact as floats


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
        faces = fans(np.array(self.corners, np.intp), np.array(self.sizes, np.intp))
        return joined([(np.array(self.coordinates, np.float64).reshape(-1, 3), faces)])


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


def read_off(content: bytes) -> tuple[Floats, Ints]:
    """The faces of an OFF file of text; normals and colours are not read."""
    return from_text(content, _fill_from_off)


def _fill_from_off(lines: Lines, surface: SurfaceBuilder) -> None:
    first = lines.next("its header")
    if not _OFF.fullmatch(first[0]):
        raise ValueError(f"it must begin with OFF, COFF, NOFF or STOFF, got {first[0][:40]!r}")
    counts = first[1:] or lines.next("the numbers of vertices and faces")
    if len(counts) < 2:
        raise ValueError(f"there must be the numbers of vertices and faces, got {' '.join(counts)[:40]!r}")
    num_vertices, num_faces = (index_of_vertex(plain_number(word)) for word in counts[:2])
    for number in range(num_vertices):
        surface.add_vertex(lines.next(f"vertex {number + 1} of {num_vertices}"))
    for number in range(num_faces):
        size, *corners = lines.next(f"face {number + 1} of {num_faces}")
        num_corners = index_of_vertex(plain_number(size))
        if num_corners > len(corners):
            raise ValueError(f"a face of {num_corners} corners has {len(corners)} indices")
        surface.add_face([index_of_vertex(plain_number(word)) for word in corners[: max(num_corners, 0)]])
