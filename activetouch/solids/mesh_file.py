"""Reading of mesh files: triangles in metres, with equal corners merged.

The reader of a format gives vertices ``(v, 3)`` in the file's unit, and triangles ``(f, 3)``. It raises ValueError with
the reason and the line for what it cannot read, needs memory in proportion to the size of the file whatever its header
promises, opens no other file, and divides polygons into triangles. Some formats are read by a library
(:mod:`activetouch.solids.library_file`).
"""

from __future__ import annotations

import io
import re
import shlex
import struct
from array import array
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TypeAlias

import numpy as np
import scipy  # whose parts load at first use

from activetouch.errors import BadMesh
from activetouch.extras import EXTRAS, is_installed
from activetouch.solids.library_file import MOST_BYTES, read_by_library
from activetouch.solids.polygons import ears, not_fans
from activetouch.solids.sizes import odd_size
from activetouch.solids.solid import Floats, Ints, units_that_fit
from belief.errors import install_command
from belief.files import plain_number, require_regular_file

_MOST_PAIRS = 10_000_000
_MANY = 50_000  # triangles from which a view takes more than 15 ms
_SAME_POINT = 1e-8  # distance [m]; STL repeats corners in every triangle, with seven digits
_MILLIMETRES = (15.0, 300.0)  # radii for which no other usual unit gives an object of less than 150 mm
_STL_HEADER = 84
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_MOST_INDEX, _DIGITS = 2**53, 16  # integers below, and of fewer digits, are exact as floats
_PLY_HEADER = re.compile(rb"ply\s.*?\nend_header[ \t]*\r?\n", re.DOTALL)
_NAMES = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
_ALIASES = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
_CODES = {name: code for names in (_NAMES, _ALIASES) for name, code in zip(names, "bBhHiIfd", strict=True)}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")
Take: TypeAlias = Callable[[str, int], Sequence[float]]
"""Returns so many next numbers of a row, of one code of ``struct``."""
Rows: TypeAlias = Callable[[str], Take]
"""Goes to the next row; the text names it, in case there is none."""
Element: TypeAlias = tuple[str, int, list[tuple[str, str, str]]]
"""Rows of one kind of PLY: its name, their number, and properties, each with its code, and that of a list's length."""


class SurfaceBuilder:
    """The vertices and polygons that a reader has collected."""

    def __init__(self, lines: Lines | None = None) -> None:
        self.coordinates, self.corners, self.sizes = array("d"), array("q"), array("q")
        self._lines, self._numbers = lines, array("q")  # the line number of each polygon

    @property
    def num_vertices(self) -> int:
        """Number of vertices so far."""
        return len(self.coordinates) // 3

    def add_vertex(self, words: Sequence[str]) -> None:
        """Add the vertex of the first three words; any others are weights, normals or colours."""
        if len(words) < 3:
            raise ValueError(f"a vertex has {len(words)} numbers instead of 3")
        self.coordinates.extend([plain_number(word) for word in words[:3]])

    def add_face(self, corners: Sequence[int]) -> None:
        """Add a polygon of three or more vertices, given by their indices."""
        if len(corners) < 3:
            raise ValueError(f"a face has {len(corners)} corners, it needs at least 3")
        self.corners.extend(corners)
        self.sizes.append(len(corners))
        if self._lines is not None:
            self._numbers.append(self._lines.number)

    def arrays(self) -> tuple[Floats, Ints]:
        """The vertices, and the triangles as indices of vertices; ValueError for no vertex, or sides that cross.

        >>> surface = SurfaceBuilder()
        >>> surface.coordinates.extend(range(12))
        >>> surface.add_face([0, 1, 2, 3])
        >>> surface.add_face([3, 1, 0])
        >>> surface.arrays()[1].tolist()
        [[0, 1, 2], [0, 2, 3], [3, 1, 0]]
        """
        vertices = np.array(self.coordinates, np.float64).reshape(-1, 3)
        corners, sizes = np.array(self.corners, np.intp), np.array(self.sizes, np.intp)
        starts, begins = np.cumsum(sizes) - sizes, np.cumsum(sizes - 2) - (sizes - 2)
        first = np.repeat(starts, sizes - 2)
        step = np.arange(len(first)) - np.repeat(begins, sizes - 2)
        faces = corners[np.column_stack([first, first + step + 1, first + step + 2])]
        if (wrong := faces[(faces < 0) | (faces >= len(vertices))]).size:
            raise ValueError(
                f"a face has the vertex {wrong[0]}, counted from 0, and there are {len(vertices)} vertices"
            )
        for place in not_fans(vertices, faces, begins).tolist():
            ring = corners[starts[place] : starts[place] + sizes[place]]
            try:
                faces[begins[place] : begins[place] + sizes[place] - 2] = ring[ears(vertices[ring])]
            except ValueError as error:
                where = f"line {self._numbers[place]}" if self._lines is not None else f"face {place + 1}"
                raise ValueError(f"{where}: {error}") from error
        return vertices, faces


class Lines:
    """The lines of a text that are not empty, as words without comments; ``number`` is that of the last line."""

    def __init__(self, content: bytes) -> None:
        encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
        self._text = io.TextIOWrapper(io.BytesIO(content), encoding=encoding, errors="replace")
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
    if not (float(number).is_integer() and abs(number) < _MOST_INDEX):
        raise ValueError(f"{number:g} is not a whole number")
    return int(number)


def from_text(content: bytes, fill: Callable[[Lines, SurfaceBuilder], None]) -> tuple[Floats, Ints]:
    """The surface that a function fills from lines; its ValueErrors get the number of the line."""
    lines = Lines(content)
    surface = SurfaceBuilder(lines)
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
                num_before = surface.num_vertices
                surface.add_face([_obj_index(word, num_before) for word in words[1:]])

    return from_text(content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" "), fill)


def _obj_index(word: str, num_before: int) -> int:
    """The index, from 0, of the vertex in ``5``, ``5/1``, ``5//2`` or ``-1`` after some vertices."""
    text = word.partition("/")[0]
    is_plain = len(text) < _DIGITS and text.isascii() and text.isdigit()  # which is read much faster
    index = int(text) if is_plain else index_of_vertex(plain_number(text))
    if index == 0 or index < -num_before:
        raise ValueError(f"a face has the vertex {index}; they count from 1, or back from -1 to -{num_before}")
    return index - 1 if index > 0 else num_before + index


def _text_rows(lines: Lines) -> Rows:
    def start(what: str) -> Take:
        words = iter(lines.next(what))

        def take(code: str, number: int) -> Sequence[float]:
            taken = [plain_number(word) for word in islice(words, number)]
            if len(taken) < number:
                raise ValueError(f"the line ends after {len(taken)} of {number} numbers")
            return taken

        return take

    return start


def _byte_rows(content: bytes, place: int, order: str) -> Rows:
    def start(what: str) -> Take:
        def take(code: str, number: int) -> Sequence[float]:
            nonlocal place
            codes = f"{order}{number}{code}"
            try:
                taken = struct.unpack_from(codes, content, place)
            except struct.error as error:
                raise ValueError(f"the file ends before {what}") from error
            place += struct.calcsize(codes)
            return taken

        return take

    return start


def read_ply(content: bytes) -> tuple[Floats, Ints]:
    """The faces of a PLY file of text or bytes; elements besides vertices, faces and strips are skipped."""
    header = _PLY_HEADER.match(content)
    if header is None:
        raise ValueError("it has no header from 'ply' to 'end_header'")
    encoding, elements = _ply_header(header[0].decode("utf-8", "replace"))
    if encoding == "ascii":
        above = b"\n" * header[0].count(b"\n")  # so that lines are counted from the beginning of the file
        return from_text(
            above + content[header.end() :], lambda lines, it: _fill_from_ply(it, elements, _text_rows(lines))
        )
    surface = SurfaceBuilder()
    _fill_from_ply(surface, elements, _byte_rows(content, header.end(), _ORDERS[encoding]))
    return surface.arrays()


def _ply_header(text: str) -> tuple[str, list[Element]]:
    """The encoding, and the elements in the order of the file."""
    encoding, elements = "", list[Element]()
    for line in text.splitlines():
        match line.split():
            case ["format", name, *_]:
                encoding = name
            case ["element", name, number]:
                elements.append((name, index_of_vertex(plain_number(number)), []))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= _CODES.keys():
                elements[-1][2].append((name, _CODES[kind], _CODES[length]))
            case ["property", kind, name] if elements and kind in _CODES:
                elements[-1][2].append((name, _CODES[kind], ""))
            case ["element" | "property", *_]:
                raise ValueError(f"the line {line[:80]!r} of its header is not understood")
    if encoding not in ("ascii", *_ORDERS):
        raise ValueError(f"its format is {encoding[:40]!r}; ascii, {' and '.join(_ORDERS)} are read")
    for kind, _, properties in elements:
        names = [name for name, *_ in properties]
        has_corners = kind in ("face", "tristrips")
        needed = {*_CORNERS} if has_corners else {"x", "y", "z"} if kind == "vertex" else {*names}
        has_all = bool(needed & {*names}) if has_corners else needed <= {*names}
        if not names or not has_all:
            raise ValueError(f"its element {kind} needs the properties {sorted(needed)}, it has {names[:12]}")
    return encoding, elements


def _fill_from_ply(surface: SurfaceBuilder, elements: Sequence[Element], rows: Rows) -> None:
    for kind, number, properties in elements:
        for place in range(1, number + 1):
            take = rows(f"the end of {kind} {place} of {number}, which its header promises")
            row = {}
            for name, code, code_of_length in properties:
                length = index_of_vertex(take(code_of_length, 1)[0]) if code_of_length else 1
                if length < 0:
                    raise ValueError(f"a list has the length {length}")
                row[name] = take(code, length)
            if kind == "vertex":
                surface.coordinates.extend([row[axis][0] for axis in "xyz"])
            elif kind in ("face", "tristrips"):
                corners = [index_of_vertex(one) for one in next(row[name] for name in _CORNERS if name in row)]
                for face in [corners] if kind == "face" else _of_strips(corners):
                    surface.add_face(face)


def _of_strips(corners: Sequence[int]) -> Iterator[tuple[int, int, int]]:
    """The triangles of strips, after each of which stands -1; every second one is turned round."""
    start = 0
    for place, (a, b, c) in enumerate(zip(corners, corners[1:], corners[2:], strict=False)):
        start = place + 1 if a == -1 else start
        if min(a, b, c) != -1:
            yield (a, b, c) if (place - start) % 2 == 0 else (b, a, c)


_OFF = re.compile(r"(?:ST)?C?N?OFF(\d*)", re.IGNORECASE)  # in some files the first number follows without a space


def read_off(content: bytes) -> tuple[Floats, Ints]:
    """The faces of an OFF file of text; colours, normals and texture coordinates are skipped."""

    def fill(lines: Lines, surface: SurfaceBuilder) -> None:
        words = lines.next("its header")
        if (found := _OFF.fullmatch(words[0])) is None:
            raise ValueError(f"it begins with {words[0][:20]!r} instead of OFF")
        counts = [*filter(None, [found[1]]), *words[1:]] or lines.next("the numbers of vertices and faces")
        if len(counts) < 2:
            raise ValueError("the numbers of vertices and faces are missing")
        num_vertices, num_faces = (index_of_vertex(plain_number(word)) for word in counts[:2])
        if min(num_vertices, num_faces) < 0:
            raise ValueError(f"its header promises {num_vertices} vertices and {num_faces} faces")
        for place in range(1, num_vertices + 1):
            surface.add_vertex(lines.next(f"vertex {place} of {num_vertices}, which its header promises"))
        for place in range(1, num_faces + 1):
            words = lines.next(f"face {place} of {num_faces}, which its header promises")
            length, *corners = (index_of_vertex(plain_number(word)) for word in words[: 1 + _corners_in(words)])
            if len(corners) < length:
                raise ValueError(f"a face has {len(corners)} of {length} corners")
            surface.add_face(corners)

    return from_text(content, fill)


def _corners_in(words: Sequence[str]) -> int:
    """The number of corners that a line of OFF begins with."""
    return max(index_of_vertex(plain_number(words[0])), 0)


def read_msh(content: bytes) -> tuple[Floats, Ints]:
    """The triangles of an MSH file of MuJoCo: four counts, vertices, normals, texture coordinates, triangles."""
    if content.startswith(b"$MeshFormat"):
        raise ValueError("it is MSH of Gmsh, only that of MuJoCo is read; export STL, OBJ or PLY")
    counts = struct.unpack_from("<4i", content) if len(content) >= 16 else (-1,) * 4
    num_vertices, num_normals, num_coordinates, num_faces = counts
    size = 16 + 12 * (num_vertices + num_normals + num_faces) + 8 * num_coordinates
    if min(counts) < 0 or size != len(content):
        raise ValueError(f"its header {counts} does not fit its {len(content)} bytes")
    surface = SurfaceBuilder()
    surface.coordinates.frombytes(np.frombuffer(content, "<f4", 3 * num_vertices, 16).astype(np.float64).tobytes())
    corners = np.frombuffer(content, "<i4", 3 * num_faces, size - 12 * num_faces)
    surface.corners.frombytes(corners.astype(np.int64).tobytes())
    surface.sizes.extend([3] * num_faces)
    return surface.arrays()


_READERS = {".stl": read_stl, ".obj": read_obj, ".ply": read_ply, ".off": read_off, ".msh": read_msh}
_BY_LIBRARY = (".glb", ".gltf", ".dae", ".3mf")
ENDINGS = (*_READERS, *_BY_LIBRARY)
"""Endings of the files that can be read, some of them with the extra ``meshes``."""
_CONVERTED = {".glb": "", ".gltf": "", ".3mf": " networkx lxml", ".dae": " pycollada"}
_CONVERTED |= {".step": " cascadio", ".stp": " cascadio"}  # and the packages that trimesh needs
OTHERS = (
    *(".step", ".stp", ".fbx", ".blend", ".usd", ".usda", ".usdc", ".usdz", ".wrl", ".vrml", ".x3d", ".3ds", ".amf"),
    *(".iges", ".igs", ".brep", ".3dm", ".sldprt", ".catpart", ".ipt", ".f3d", ".skp", ".max", ".ma", ".mb", ".c4d"),
    *(".abc", ".lwo", ".ctm", ".vtk", ".vtp", ".vtu"),
)
"""Endings of files of meshes that are not read."""


def why_not(path: Path) -> str | None:
    """What to do about a file whose format is not read, or not without an extra; None if it is read."""
    kind = path.suffix.lower()
    if kind in OTHERS:
        return conversion(path)
    if kind not in _BY_LIBRARY or all(map(is_installed, EXTRAS["meshes"])):
        return None
    return f"{install_command('meshes')} reads {kind[1:].upper()} files; without it, {conversion(path)}"


def conversion(path: Path) -> str:
    """Instructions for the conversion of a file of another format to one that can be read.

    >>> print(conversion(Path("mug.step")))
    STEP is not read; pip install trimesh cascadio, then this writes mug.step.stl: python -c "import sys, trimesh; \
trimesh.load(sys.argv[1], force='mesh').export(sys.argv[1] + '.stl')" mug.step
    """
    kind = path.suffix.lower()
    if kind not in _CONVERTED:
        return f"{kind[1:].upper()} is not read; export STL, OBJ or PLY from a program that reads it, such as Blender"
    return (
        f"{kind[1:].upper()} is not read; pip install trimesh{_CONVERTED[kind]}, then this writes {path.name}.stl: "
        "python -c \"import sys, trimesh; trimesh.load(sys.argv[1], force='mesh').export(sys.argv[1] + '.stl')\" "
        f"{shlex.quote(str(path))}"
    )


@np.errstate(over="ignore", invalid="ignore")  # such vertices are rejected later
def read_triangles(path: Path) -> tuple[Floats, Ints, float | None]:
    """Vertices in the unit of a file, ``(v, 3)``, triangles, ``(f, 3)``, and metres per unit if the file says so."""
    kind = path.suffix.lower()
    if not path.exists():
        raise FileNotFoundError(f"there is no mesh file {path}; relative paths start from {Path.cwd()}")
    if (reason := why_not(path)) is not None or kind not in ENDINGS:
        raise BadMesh(f"{path}: meshes are read from {', '.join(ENDINGS)} files" + (f"; {reason}" if reason else ""))
    require_regular_file(path, BadMesh)
    try:
        if (size := path.stat().st_size) > MOST_BYTES:
            raise ValueError(f"it has {size} bytes, {MOST_BYTES} are the most; simplify it")
        if not (content := path.read_bytes()):
            raise ValueError("it is empty")
        if kind in _READERS:
            return *_READERS[kind](content), None
        (vertices, faces), unit = read_by_library(path, content)
        return vertices, faces, unit
    except (OSError, ValueError, OverflowError) as error:
        raise BadMesh(f"{path.name}: cannot be read as {kind[1:].upper()}: {error}") from error


def read_surface(path: Path, scale: float | None) -> tuple[Floats, Ints, tuple[str, ...], float]:
    """Vertices in metres, ``(v, 3)``, triangles, ``(f, 3)``, what was guessed or is unusual in words, and the scale."""
    vertices, faces, unit = read_triangles(path)
    return in_metres(path.name, vertices, faces, unit if scale is None else scale)


@np.errstate(over="ignore", invalid="ignore")  # such vertices are rejected later
def in_metres(
    name: str, vertices: Floats, faces: Ints, scale: float | None
) -> tuple[Floats, Ints, tuple[str, ...], float]:
    """:func:`read_surface` of what was read."""
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    if not (len(used) and np.isfinite(np.square(np.ptp(vertices, axis=0)).sum())):
        return vertices, faces, (), 1.0  # rejected later
    scale, remarks = _scale(name, vertices, scale)
    vertices, faces = _welded(name, vertices * scale, faces)
    if len(faces) > _MANY:
        remarks = (*remarks, f"{len(faces)} triangles make touches slow; a program for meshes reduces them")
    return vertices, faces, remarks, scale


def _scale(name: str, vertices: Floats, given: float | None) -> tuple[float, tuple[str, ...]]:
    """Metres per unit, and remarks on it: as given, or 0.001 if only millimetres make a suitable object, or 1."""
    extent = np.ptp(vertices, axis=0)
    radius = float(np.linalg.norm(extent) / 2)
    if given is not None or not _MILLIMETRES[0] < radius < _MILLIMETRES[1]:
        remark = odd_size(radius) if given is None else None
        return 1.0 if given is None else given, () if remark is None else (remark,)
    size = " × ".join(f"{length:.3g}" for length in extent)
    return 0.001, (
        f"read in millimetres ({size} mm), because an object of {extent.max():.3g} m is too large for a pad; write "
        f"{name}@0.001, or @0.001 behind its folder, to say so. Its scale is {units_that_fit(radius)}",
    )


def _welded(name: str, vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """The triangles with equal corners merged, without degenerate triangles and without repeated ones."""
    kept, same = _merged(name, vertices)
    vertices, faces = vertices[kept], same[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    order = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3
    first, _ = _distinct(np.take_along_axis(faces, order, axis=1))
    return vertices, faces[np.sort(first)]


def _distinct(rows: Floats | Ints) -> tuple[Ints, Ints]:
    """First of each group of equal rows, and group of each row, ``(n,)``; faster than :func:`numpy.unique`."""
    order = np.lexsort(rows.T[::-1])
    is_new = np.append(True, (rows[order[1:]] != rows[order[:-1]]).any(axis=1))[: len(rows)]
    group = np.empty(len(rows), np.intp)
    group[order] = np.cumsum(is_new) - 1
    return order[is_new], group


def _merged(name: str, points: Floats) -> tuple[Ints, Ints]:
    """The first point of each group of neighbours, ``(g,)``, and the group of each point, ``(n,)``."""
    first, same = _distinct(points)
    tree, size = scipy.spatial.cKDTree(points[first]), len(first)
    if (num_pairs := (tree.count_neighbors(tree, _SAME_POINT) - size) // 2) > _MOST_PAIRS:
        raise BadMesh(
            f"{name}: {num_pairs} pairs of corners are within {_SAME_POINT} m of each other; is the scale right?"
        )
    pairs = tree.query_pairs(_SAME_POINT, output_type="ndarray")
    links = scipy.sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (size, size))
    num_groups, group = scipy.sparse.csgraph.connected_components(links, directed=False)
    kept = np.full(num_groups, len(points))
    np.minimum.at(kept, group, first)
    order = np.lexsort(np.round(points[kept] / _SAME_POINT).T[::-1])
    return kept[order], np.argsort(order)[group[same]]
