"""Files of meshes: what the formats allow is read, and what is damaged is refused, quietly and by name."""

import os
import struct
import warnings

import numpy as np
import pytest
import trimesh

from activetouch.errors import BadMesh, MeshWarning
from activetouch.shapes import Mesh
from activetouch.solids.mesh_file import SurfaceBuilder, read_surface
from activetouch.solids.polygons import ears
from tests.rays import entry

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([triangle for a, b, c, d in QUADS for triangle in ((a, b, c), (a, c, d))])
BOX = CORNERS * [0.005, 0.010, 0.0025]  # 10 × 20 × 5 mm
TRIANGLES = trimesh.Trimesh(BOX, FACES, process=False)


def obj(vertices, faces, offset=1):
    """An OBJ file."""
    lines = ["v {:.12g} {:.12g} {:.12g}".format(*vertex) for vertex in vertices]
    return "\n".join([*lines, *(" ".join(["f", *(str(i + offset) for i in face)]) for face in faces)]) + "\n"


def ply(kind, faces, order="<"):
    """A PLY file with colours, an element before the vertices, and lists of two lengths."""
    head = f"ply\nformat {kind} 1.0\ncomment it is a box\nelement camera 1\nproperty int16 id\n"
    head += f"element vertex {len(BOX)}\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_index\nproperty list uint8 float texcoord\n"
    rows = [(order + "h", 7), *((order + "fffB", *vertex, 255) for vertex in BOX.tolist())]
    rows += [(order + f"B{len(face)}iB2f", len(face), *face, 2, 0.5, 0.25) for face in faces]
    if kind == "ascii":
        return (head + "end_header\n" + "".join(" ".join(map(str, row[1:])) + "\n" for row in rows)).encode()
    return (head + "end_header\n").encode() + b"".join(struct.pack(*row) for row in rows)


def stl(header, num_promised=12):
    """A binary STL file of the box."""
    rows = (struct.pack("<12fH", *(np.nan,) * 3, *BOX[list(face)].ravel(), 0) for face in FACES)
    return header.ljust(80) + struct.pack("<I", num_promised) + b"".join(rows)


def strips():
    """A PLY file of the box as Stanford's are: two strips of a triangle, and one of two for each other side."""
    head = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    each = [*FACES[:2].tolist(), *((a, b, d, c) for a, b, c, d in QUADS[1:])]
    corners = [number for strip in each for number in (*strip, -1)]
    return head + "\n".join(" ".join(map(str, row)) for row in [*BOX.tolist(), [len(corners), *corners]]) + "\n"


STL_TEXT = trimesh.exchange.stl.export_stl_ascii(TRIANGLES)
FULL = [*FACES[:2].tolist(), *QUADS[1:]]
BOXES = {
    "plain.obj": obj(BOX, FACES),
    "quads.obj": obj(BOX, QUADS).replace("\n", "\r\n"),
    "marks.obj": "# a comment\nmtllib no.mtl\no box\nvt 0 0\nvn 0 0 1\n"
    + obj(BOX, FULL).replace("f 1 ", "f 1/1/1 \\\n"),
    "colours.obj": obj(np.hstack([BOX, CORNERS]), FACES),
    "relative.obj": obj(BOX, FACES, -8) + "o curve\n" + obj(BOX * [1, 0.4, 3], []) + "l -8 -7 -6 -5\n",
    "soup.obj": "".join(obj(BOX[face], []) + "f -3 -2 -1\n" for face in FACES),
    "wide.obj": obj(BOX, QUADS).encode("utf-16"),
    "text.ply": ply("ascii", FULL),
    "strips.ply": strips(),
    "little.ply": ply("binary_little_endian", FULL),
    "big.ply": ply("binary_big_endian", FULL, ">"),
    "solid.stl": stl(b"solid box"),
    "text.stl": STL_TEXT,
    "two.stl": STL_TEXT.replace("solid", "solid vertex 7") + "solid empty\nendsolid empty\n",
    "normals.stl": STL_TEXT.replace("facet normal", "facet normal none 1e999 1_0"),
}


def write(folder, name, content):
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize("name", BOXES)
def test_every_way_to_write_a_box_gives_the_box(name, tmp_path, capfd):
    mesh = Mesh.from_file(write(tmp_path, name, BOXES[name]))
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [0.010, 0.020, 0.005], atol=1e-5)
    np.testing.assert_allclose(np.abs(mesh.vertices), np.tile([0.005, 0.010, 0.0025], (8, 1)), atol=1e-5)
    assert len(mesh.faces) == 12
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("shift", [0.0, 0.002500005, 1e-9])
def test_corners_are_merged_by_their_distance_wherever_they_are(shift, tmp_path):
    corners = (np.sign(CORNERS) * 0.0025 + shift)[FACES].reshape(-1, 3)
    apart = np.array([[1.0], [-1.0]])[np.arange(36) % 2] / np.sqrt(3.0)  # along a diagonal
    triangles = np.arange(36).reshape(-1, 3)
    for distance in (2e-12, 9.9e-9):
        mesh = Mesh.from_file(write(tmp_path, "near.obj", obj(corners + 0.5 * distance * apart, triangles)))
        assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)
    with pytest.warns(MeshWarning, match=r"30 open edges; 0\.0% of"):
        Mesh.from_file(write(tmp_path, "far.obj", obj(corners + 0.5 * 1.1e-8 * apart, triangles)))


def test_corners_that_are_all_near_each_other_are_refused_before_their_pairs_are_listed(tmp_path):
    crowd = obj(np.random.default_rng(0).normal(size=(6000, 3)), np.arange(6000).reshape(-1, 3))
    with pytest.raises(BadMesh, match=r"pairs of corners are within 1e-08 m of each other; is the scale right"):
        Mesh.from_file(write(tmp_path, "crowd.obj", crowd), scale=1e-10)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        (
            "long.stl",
            stl(b"") + bytes(17),
            "promises 12 triangles, 684 bytes; the file has 701 bytes, which hold 12 tri",
        ),
        ("short.stl", stl(b"")[:-30], "promises 12 triangles, 684 bytes; the file has 654 bytes, which hold 11"),
        ("cut.stl", STL_TEXT[: STL_TEXT.rindex("vertex")], "the file ends within a triangle"),
        ("two.stl", STL_TEXT.replace("vertex", "x", 1), "line 7: a triangle has 2 corners instead of 3"),
        ("few.obj", "v 1 2\n", "line 1: a vertex has 2 numbers instead of 3"),
        ("back.obj", obj(BOX, [(0, 1, -10)]), "line 9: a face has the vertex -9; they count from 1, or back from -1"),
        ("far.obj", obj(BOX, [(0, 1, 8)]), "a face has the vertex 8, counted from 0, and there are 8 vertices"),
        ("two.obj", obj(BOX, [(0, 1)]), "line 9: a face has 2 corners, it needs at least 3"),
        ("score.obj", "v 1_0 2 3\n", "line 1: '1_0' is not a decimal number"),
        ("arabic.obj", "v \u0661\u0662 2 3\n", "is not a decimal number"),
        ("far.ply", ply("ascii", [*FULL, (0, 1, 8)]), "vertex 8, counted from 0, and there are 8"),
        ("text.ply", ply("ascii", FULL).replace(b"3 0", b"9 0"), "line 24: the line ends after 6 of 9 numbers"),
        ("cut.ply", ply("binary_big_endian", FULL, ">")[:-1], "ends before the end of face 7 of 7, which its header"),
        ("none.ply", b"ply\nformat ascii 1.0\nelement face 4000000000\nend_header\n", "needs the properties"),
        (
            "vast.ply",
            ply("binary_little_endian", FULL).replace(b"face 7", b"face 4000000000"),
            "the file ends before the end of face 8 of 4000000000",
        ),
    ],
)
def test_a_damaged_file_says_what_it_promises_and_holds(name, content, words, tmp_path):
    path = write(tmp_path, name, content)
    with pytest.raises(BadMesh, match=f"{name}: cannot be read as {name[-3:].upper()}: .*{words}"):
        Mesh.from_file(path)


def test_a_pipe_is_refused_and_so_is_a_file_larger_than_the_limit(tmp_path):
    os.mkfifo(tmp_path / "pipe.stl")
    with pytest.raises(BadMesh, match=r"pipe\.stl is a pipe, not a regular file"):
        Mesh.from_file(tmp_path / "pipe.stl")
    with (tmp_path / "huge.obj").open("wb") as file:
        file.truncate(2**40)  # without room on the disk
    with pytest.raises(BadMesh, match=r"huge\.obj: .*it has 1099511627776 bytes, 268435456 are the most"):
        Mesh.from_file(tmp_path / "huge.obj")


OUTLINE = [(0, 0), (20, 0), (20, 10), (10, 10), (10, 20), (0, 20)]  # an L; its corners [mm]


def prism(outline, kind, corners=0):
    """A prism of 5 mm whose two caps are polygons, as the bytes of a file; the first corners of its top repeated."""
    number = len(outline)
    vertices = np.array([(x, y, z) for z in (0, 5) for x, y in outline]) * 1e-3
    top = [corner for corner in range(number, 2 * number) for _ in range(1 + (corner < number + corners))]
    faces = [list(range(number))[::-1], top]
    faces += [[i, (i + 1) % number, (i + 1) % number + number, i + number] for i in range(number)]
    if kind == "obj":
        return obj(vertices, faces).encode()
    rows = [" ".join(map(str, [*row])) for row in vertices.tolist()]
    head = f"ply\nformat {'ascii' if kind == 'ply' else 'binary_little_endian'} 1.0\nelement vertex {len(rows)}\n"
    head += "property float x\nproperty float y\nproperty float z\n"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    if kind == "ply":
        return (head + "\n".join([*rows, *(" ".join(map(str, [len(face), *face])) for face in faces)]) + "\n").encode()
    rows = [struct.pack("<3f", *row) for row in vertices.tolist()]
    return head.encode() + b"".join([*rows, *(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)])


def volume(mesh):
    first, second, third = mesh.vertices[mesh.faces.T]
    return (first * np.cross(second, third)).sum() / 6


@pytest.mark.parametrize("kind", ["obj", "ply", "binary.ply"])
@pytest.mark.parametrize("start", range(6))
def test_a_concave_face_leaves_its_notch_open_whichever_corner_it_begins_with(start, kind, tmp_path):
    content = prism(OUTLINE[start:] + OUTLINE[:start], kind if kind in ("obj", "ply") else "binary")
    mesh = Mesh.from_file(write(tmp_path, f"ell.{kind}", content), 1.0)
    assert volume(mesh) == pytest.approx(300 * 5e-9, rel=1e-6)
    assert len(mesh.faces) == 20
    middle = np.array([0.15 / 18, 0.15 / 18, 0.0025])  # centre of mass; a pad on the top feels the two arms alone
    at = np.array([(15, 5, 9), (5, 15, 9), (5, 5, 9), (15, 15, 9), (11, 11, 9), (10.5, 18, 9)]) * 1e-3 - middle
    felt = entry(mesh, at.T, np.array([0.0, 0.0, -1.0]))
    np.testing.assert_allclose(felt, [0.004] * 3 + [np.inf] * 3, atol=1e-5)


HOLE = [*[(0, 0), (20, 0), (20, 20), (0, 20)], (0, 0), *[(5, 5), (5, 15), (15, 15), (15, 5)], (5, 5)]
STAR = [
    (10 * r * np.cos(a), 10 * r * np.sin(a)) for a, r in zip(np.arange(48) * np.pi / 24, [1, 0.4] * 24, strict=True)
]


@pytest.mark.parametrize(
    ("outline", "area"),
    {
        "a hole that is joined to the outline": (HOLE, 300),
        "corners on a line": ([(0, 0), (10, 0), (20, 0), (20, 10), (15, 10), (10, 10), (10, 20), (0, 20), (0, 9)], 300),
        "a star": (STAR, 24 * 0.4 * 100 * np.sin(np.pi / 24)),
        "an arrow": ([(0, 0), (20, 0), (5, 5), (0, 20)], 100),
        "far from the origin": ([(x + 900, y - 700) for x, y in OUTLINE], 300),
    }.values(),
    ids=["hole", "line", "star", "arrow", "far"],
)
@pytest.mark.parametrize("turned", [False, True])
def test_every_flat_polygon_is_covered_once(outline, area, turned):
    for start in range(len(outline)):
        ring = [*outline[start:], *outline[:start]]
        corners = np.array([(x, 0.5 * x + 0.2 * y, y) for x, y in (ring[::-1] if turned else ring)])
        first, second, third = corners[ears(corners)].transpose(1, 0, 2)
        sides = np.cross(second - first, third - first)[:, 1]  # twice the areas as seen along y
        assert np.abs(sides).sum() / 2 == pytest.approx(area, rel=1e-6)
        assert len(sides) == len(ring) - 2


def test_repeated_corners_of_a_face_change_nothing(tmp_path):
    mesh = Mesh.from_file(write(tmp_path, "twice.obj", prism(OUTLINE, "obj", corners=4)), 1.0)
    assert volume(mesh) == pytest.approx(300 * 5e-9, rel=1e-6)


def test_faces_of_several_corners_that_are_convex_stay_fans():
    surface = SurfaceBuilder()
    for x, y in [(np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 40, endpoint=False)]:
        surface.coordinates.extend([round(x, 6), round(y, 6), 0.0])
    surface.add_face(list(range(40)))
    surface.add_face([5, 6, 7])
    assert surface.arrays()[1].tolist() == [*([0, i, i + 1] for i in range(1, 39)), [5, 6, 7]]


@pytest.mark.parametrize("outline", [[(0, 0), (20, 20), (20, 0), (0, 20)], [(0, 0), (20, 20), (20, 0), (0, 15)]])
def test_a_face_whose_sides_cross_each_other_is_refused_with_its_line(outline, tmp_path):
    where = {"obj": "line 9", "ply": "line 18", "binary": "face 1"}  # of the lower cap, which comes first
    for kind, place in where.items():
        path = write(tmp_path, f"{kind}.{kind if kind == 'obj' else 'ply'}", prism(outline, kind))
        with pytest.raises(
            BadMesh, match=rf"cannot be read as \w+: {place}: the sides of a face cross each other; divide"
        ):
            Mesh.from_file(path)


def damaged(content, rng):
    """A file with a few bytes, lines or numbers changed, or with its end cut off."""
    kind = rng.integers(5)
    if kind == 0:
        return content[: rng.integers(len(content))]
    if kind == 1:
        changed = bytearray(content)
        for place in rng.integers(len(content), size=rng.integers(1, 5)):
            changed[place] ^= 1 << rng.integers(8)
        return bytes(changed)
    ends = b"\n" if kind == 2 else b" "
    parts = content.split(ends)
    one, other = rng.integers(len(parts), size=2)
    if kind == 4:
        extremes = [b"-1", b"0", b"99", b"1e400", b"-nan", b"4294967296", b"9" * 400, b"1_0", b"0.5", b"", b"\xd9\xa1"]
        parts[one] = extremes[rng.integers(len(extremes))]
    else:
        parts[one], parts[other] = parts[other], parts[one]
    return ends.join(parts)


@pytest.mark.parametrize("name", BOXES)
def test_a_damaged_file_is_read_or_refused_by_name_and_nothing_else_is_said(name, tmp_path, capfd):
    content = BOXES[name] if isinstance(BOXES[name], bytes) else BOXES[name].encode()
    rng, read, refused = np.random.default_rng(0), 0, 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", MeshWarning)
        for _ in range(20):
            path = write(tmp_path, name, damaged(content, rng))
            try:
                vertices, faces, *_ = read_surface(path, 1.0)
                assert 0 <= faces.min(initial=0) <= faces.max(initial=0) <= len(vertices)
                Mesh.from_file(path)
            except BadMesh as error:
                refused += name in str(error)
                continue
            read += 1
    assert read + refused == 20
    assert min(read, refused) > 0
    assert capfd.readouterr() == ("", "")
