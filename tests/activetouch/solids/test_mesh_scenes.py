"""GLB, glTF, 3MF and DAE files: whole scenes as one mesh, with their units; damaged and hostile ones are refused."""

import base64
import io
import json
import struct
import time
import warnings
import zipfile
import zlib

import numpy as np
import pytest
import trimesh

from activetouch.errors import BadMesh, MeshWarning
from activetouch.shapes import Mesh
from activetouch.solids import mesh_xml
from activetouch.solids.mesh_file import read_surface

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.5
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([triangle for a, b, c, d in QUADS for triangle in ((a, b, c), (a, c, d))])


def gltf(binary=None, uri=None, **changes):
    """A cube of 10 × 20 × 30 mm and a second one beside it, by nodes in nodes; the description as a dictionary."""
    data = CUBE.astype("<f4").tobytes() + FACES.astype("<u2").tobytes()
    place = {"translation": [0, 0, 0.05], "rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)], "scale": [0.01, 0.02, 0.03]}
    matrix = np.diag([0.01, 0.02, 0.03, 1.0]).ravel().tolist()
    description = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1, 2]}, {"mesh": 0, "matrix": matrix}, {"mesh": 0, **place}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 96},
            {"buffer": 0, "byteOffset": 96, "byteLength": 72},
        ],
        "buffers": [{"byteLength": len(data)} | ({"uri": uri} if uri else {})],
        **changes,
    }
    return description, data


def glb(**changes):
    description, data = gltf(**changes)
    text = json.dumps(description).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def embedded(**changes):
    data = gltf()[1]
    description, _ = gltf(uri="data:application/octet-stream;base64," + base64.b64encode(data).decode(), **changes)
    return json.dumps(description).encode()


OBJECT = (
    "<mesh><vertices>"
    + "".join('<vertex x="{}" y="{}" z="{}"/>'.format(*(vertex * [10, 20, 30])) for vertex in CUBE)
    + "</vertices><triangles>"
    + "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*face) for face in FACES)
    + "</triangles></mesh>"
)
SECOND = '<component objectid="1" transform="0 1 0 -1 0 0 0 0 1 0 0 50"/>'  # turned by 90° about z


def model(unit="millimeter", components=f'<component objectid="1"/>{SECOND}', head="", items='<item objectid="2"/>'):
    return (
        f'<?xml version="1.0"?>{head}<model unit="{unit}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/'
        f'2015/02"><resources><object id="1" type="model">{OBJECT}</object><object id="2"><components>{components}'
        f"</components></object></resources><build>{items}</build></model>"
    ).encode()


def archive(content, method=zipfile.ZIP_DEFLATED, name="3D/3dmodel.model"):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as members:
        members.writestr(name, content)
    return file.getvalue()


def dae(unit='<unit name="inch" meter="0.0254"/>', head="", nodes=None, primitive=None):
    numbers = " ".join(map(str, (CUBE * [10, 20, 30]).ravel()))
    corners = " ".join(f"{corner} 0" for quad in QUADS for corner in quad)
    nodes = nodes or (
        '<node><instance_geometry url="#g"/></node><node><translate>0 0 50</translate><rotate>0 0 1 90</rotate>'
        '<scale>1 1 1</scale><node id="n"><instance_geometry url="#g"/></node></node>'
    )
    primitive = primitive or f"<polylist count='6'>INPUT<vcount>{'4 ' * 6}</vcount><p>{corners}</p></polylist>"
    inputs = '<input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#s" offset="1"/>'
    return (
        f'<?xml version="1.0"?>{head}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><asset>{unit}</asset>'
        f'<library_geometries><geometry id="g"><mesh><source id="s"><float_array count="24">{numbers}</float_array>'
        '<technique_common><accessor source="#a" count="8" stride="3"/></technique_common></source><vertices id="v">'
        f'<input semantic="POSITION" source="#s"/></vertices>{primitive.replace("INPUT", inputs)}</mesh></geometry>'
        f'</library_geometries><library_visual_scenes><visual_scene id="w">{nodes}</visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>'
    ).encode()


SCENES = {
    "plain.glb": glb(),
    "embedded.gltf": embedded(),
    "no scene.glb": glb(scenes=[]).replace(b'"scenes"', b'"other1"'),
    "plain.3mf": archive(model()),
    "inches.3mf": archive(model("inch").replace(b"10.0", b"9.9"), zipfile.ZIP_STORED),
    "plain.dae": dae('<unit meter="0.001"/>'),
    "none.dae": dae(""),
}


def write(folder, name, content):
    (folder / name).write_bytes(content)
    return folder / name


def read(path, scale=None):
    with pytest.warns(MeshWarning, match="2 separate surfaces"):
        return Mesh.from_file(path, scale)


@pytest.mark.parametrize("name", ["plain.glb", "embedded.gltf", "no scene.glb", "plain.3mf", "plain.dae"])
def test_a_scene_is_one_mesh_with_each_part_in_its_place(name, tmp_path):
    mesh = read(write(tmp_path, name, SCENES[name]))
    assert len(mesh.faces) == 24
    first, second = mesh.vertices[mesh.vertices[:, 2] < 0], mesh.vertices[mesh.vertices[:, 2] > 0]
    np.testing.assert_allclose(np.ptp(first, axis=0), [0.010, 0.020, 0.030], atol=1e-8)
    np.testing.assert_allclose(np.ptp(second, axis=0), [0.020, 0.010, 0.030], atol=1e-8)
    np.testing.assert_allclose(second.mean(axis=0) - first.mean(axis=0), [0, 0, 0.050], atol=1e-8)
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), 0.0, atol=1e-8)


def test_files_say_their_unit_and_a_scale_that_is_given_goes_before_it(tmp_path):
    millimetres = read(write(tmp_path, "a.3mf", archive(model("millimeter"))))
    for path, scale in (
        (write(tmp_path, "b.3mf", archive(model("inch"))), 0.001),
        (write(tmp_path, "c.dae", dae()), 0.001),
        (write(tmp_path, "d.dae", dae("")), None),  # 80 m are no object
    ):
        with pytest.warns(MeshWarning):
            np.testing.assert_allclose(Mesh.from_file(path, scale).vertices, millimetres.vertices, atol=1e-12)
    with pytest.raises(BadMesh, match=r"farthest point is 1\.0.* m from its origin"):
        Mesh.from_file(tmp_path / "c.dae")


def test_what_trimesh_writes_is_read_as_trimesh_reads_it(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(
        trimesh.creation.annulus(0.01, 0.02, 0.01), transform=trimesh.transformations.random_rotation_matrix()
    )
    scene.add_geometry(trimesh.creation.icosphere(radius=0.02), transform=np.diag([1, 1, 2, 1.0]))
    scene.export(tmp_path / "scene.glb")
    for name, content in scene.export(file_type="gltf").items():
        (tmp_path / name).write_bytes(content)
    expected = scene.to_mesh()
    for name in ("scene.glb", "model.gltf"):
        mesh = read(tmp_path / name)
        assert len(mesh.faces) == len(expected.faces)
        np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), np.ptp(expected.vertices, axis=0), atol=1e-8)


DOCTYPE = '<!DOCTYPE lolz [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;">]>'
DOUBLES = [{"children": [i + 1, i + 1]} for i in range(40)] + [{"mesh": 0}]
HUGE = [{"bufferView": 0, "componentType": 5126, "count": 2**32, "type": "VEC3"}]


def forged(content):
    """An archive that promises to unpack to 100 bytes."""
    place = content.index(b"PK\x01\x02")
    return content[: place + 24] + struct.pack("<I", 100) + content[place + 28 :]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("cut.glb", glb()[:-1], "its header promises 908 bytes of version 2; the file has 907"),
        (
            "chunk.glb",
            glb().replace(b"BIN\0", b"BAN\0"),
            r"there must be a chunk b'BIN\\x00', there is b'BAN",
        ),
        ("vast.glb", glb(accessors=HUGE), r"accessors\[0\] needs 4294967296 × 12 bytes from byte 0 to 51539607552"),
        ("none.glb", glb(accessors=[]), r"it refers to accessors\[0\], and has 0 accessors"),
        ("loop.glb", glb(nodes=[{"children": [0]}]), "more than 50000 nodes, or one contains itself"),
        ("bomb.glb", glb(nodes=DOUBLES), "more than 50000 nodes"),
        ("draco.glb", glb(extensionsRequired=["KHR_draco_mesh_compression"]), "export it without compression"),
        (
            "far.glb",
            glb().replace(FACES.astype("<u2").tobytes(), (FACES + 1).astype("<u2").tobytes()),
            "the vertex 8, ",
        ),
        ("word.gltf", b"{", "cannot be read as GLTF: Expecting property name"),
        ("deep.gltf", b"[" * 100_000, "cannot be read as GLTF"),
        ("items.gltf", b"[" + b"[]," * 10**6, "its description has more than 1000000 items"),
        (
            "out.gltf",
            json.dumps(gltf(uri="../secret.bin")[0]).encode(),
            "'../secret.bin' is not a file in its own",
        ),
        ("etc.gltf", json.dumps(gltf(uri="/etc/hostname")[0]).encode(), "'/etc/hostname' is not a file in its own"),
        ("gone.gltf", json.dumps(gltf(uri="gone.bin")[0]).encode(), "gone.bin"),
        ("doctype.3mf", archive(model(head=DOCTYPE)), "it defines a document type"),
        ("wide.3mf", archive(model(head=DOCTYPE).decode().encode("utf-16")), "it defines a document type"),
        ("forged.3mf", forged(archive(model())), "cannot be read as 3MF"),
        ("text.3mf", archive(b"<model"), "cannot be read as 3MF: ParseError: .*line 1"),
        ("loop.3mf", archive(model(components='<component objectid="2"/>')), "one contains itself"),
        ("far.3mf", archive(model().replace(b'v3="3"', b'v3="8"', 1)), "a face has the vertex 8, counted from 0"),
        ("doctype.dae", dae(head=DOCTYPE), "it defines a document type"),
        ("strips.dae", dae(primitive="<tristrips>INPUT<p>0 0 1 0 2 0</p></tristrips>"), "it has tristrips"),
        ("few.dae", dae().replace(b"4 4 4", b"4 4 5"), "its faces have 26 corners, 24 are listed"),
        ("two.dae", dae().replace(b"<vcount>4 4", b"<vcount>2 6"), "a face has 2 corners, it needs at least 3"),
        ("loop.dae", dae(nodes='<node id="n"><instance_node url="#n"/></node>'), "one contains itself"),
        ("link.dae", dae(nodes='<node><instance_geometry url="file:///etc/passwd"/></node>'), "which it does not have"),
    ],
)
def test_a_hostile_scene_is_refused_by_name_and_reason(name, content, words, tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.bin").write_bytes(gltf()[1])
    with pytest.raises(BadMesh, match=f"{name}: cannot be read as {name.split('.')[1].upper()}: .*{words}|{words}"):
        read_surface(write(tmp_path / "in", name, content), None)


PLACED = '<item objectid="1"/>' * 10_000
ITEMS = f'<resources><object id="1">{"<mesh/>" * 10_000}</object></resources><build>{PLACED}</build>'
INSTANCES = "<node>" + '<instance_node url="#n"/>' * 10_000 + "</node>"
EXTRA = f'<library_nodes><node id="n">{"<extra/>" * 10_000}</node></library_nodes></COLLADA>'
EMPTY = [{"primitives": [{"mode": 0}] * 10_000}]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.3mf", archive(f"<model>{ITEMS}</model>".encode())),
        ("empty.dae", dae(nodes=INSTANCES).replace(b"</COLLADA>", EXTRA.encode())),
        ("empty.gltf", json.dumps({"nodes": [{"mesh": 0}] * 10_000, "meshes": EMPTY}).encode()),
        (
            "roots.gltf",
            json.dumps({"scenes": [{"nodes": [0] * 900_000}], "nodes": [{"rotation": [0, 0, 0, 1]}]}).encode(),
        ),
    ],
)
def test_what_yields_nothing_costs_nothing_however_often_it_is_placed(name, content, tmp_path):
    start = time.process_time()
    with pytest.raises(BadMesh, match=r"there are no triangles|more than 50000 nodes"):
        Mesh.from_file(write(tmp_path, name, content))
    assert time.process_time() - start < 4.0


def test_an_archive_is_not_unpacked_beyond_the_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_xml, "MOST_BYTES", 2**20)
    content = archive(b" " * 2**22)
    assert len(content) < 2**13
    for name, packed in (("said.3mf", content), ("hidden.3mf", forged(content))):
        with pytest.raises(BadMesh, match=f"{name}: .*(3dmodel.model unpacks to more than 1048576 bytes|Bad CRC)"):
            read_surface(write(tmp_path, name, packed), None)


def test_no_part_of_a_buffer_outside_its_file_is_read(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "data.bin").write_bytes(gltf()[1])
    path = write(tmp_path / "in", "a.gltf", json.dumps(gltf(uri="data.bin")[0]).encode())
    assert len(read(path).faces) == 24
    (tmp_path / "in" / "data.bin").rename(tmp_path / "data.bin")
    (tmp_path / "in" / "data.bin").symlink_to(tmp_path / "data.bin")
    with pytest.raises(BadMesh, match="not a file in its own folder"):
        Mesh.from_file(path)


def damaged(content, rng):
    """The file with some bytes changed, a number replaced or its end cut off."""
    changed = bytearray(content)
    kind = rng.integers(3)
    if kind == 0:
        return content[: rng.integers(len(content))]
    for place in rng.integers(len(content), size=rng.integers(1, 6)):
        changed[place] = rng.integers(256) if kind == 1 else rng.choice(list(b'0123456789-.,e{}[]<>"/'))
    return bytes(changed)


def repacked(name, content, rng):
    """A damaged file; of an archive, sometimes its member is damaged instead, so that its checksum is right."""
    if name.endswith("3mf") and rng.random() < 0.7:
        return archive(damaged(model(), rng))
    return damaged(content, rng)


@pytest.mark.parametrize("name", ["plain.glb", "embedded.gltf", "plain.3mf", "plain.dae"])
def test_a_damaged_scene_is_read_or_refused_by_name(name, tmp_path):
    rng, refused, number = np.random.default_rng(zlib.crc32(name.encode())), 0, 300
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", MeshWarning)
        for _ in range(number):
            path = write(tmp_path, name, repacked(name, SCENES[name], rng))
            try:
                vertices, faces, _ = read_surface(path, None)
                assert 0 <= faces.min(initial=0) <= faces.max(initial=0) <= len(vertices)
            except BadMesh as error:
                refused += name in str(error)
    assert 0.3 * number < refused < number
