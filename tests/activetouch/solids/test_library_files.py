"""GLB, glTF, DAE and 3MF files are read as the solids they are, and hostile ones are refused before they cost much."""

import base64
import io
import json
import re
import stat
import struct
import subprocess
import sys
import warnings
import zipfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from activetouch.errors import BadMesh
from activetouch.extras import EXTRAS
from activetouch.mesh_source import read_files, read_meshes
from activetouch.shapes import Mesh
from activetouch.solids.library_file import xml_root

ROOT = Path(__file__).parents[3]
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (0.02, 0.03, 0.008)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([triangle for a, b, c, d in QUADS for triangle in ((a, b, c), (a, c, d))])
has_extra = all(find_spec(module) is not None for module in EXTRAS["meshes"])
needs_extra = pytest.mark.skipif(not has_extra, reason="needs the extra meshes")
ENDLESS = 1_500_000_000


def gltf(vertices=CORNERS, faces=FACES, uri=None, scale=1.0, **changes):
    """The header of glTF, and its buffer."""
    points, corners = np.asarray(vertices, "<f4").tobytes(), np.asarray(faces, "<u4").tobytes()
    views = [
        {"buffer": 0, "byteLength": len(points)},
        {"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)},
    ]
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "scale": [scale] * 3}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": len(vertices)},
            {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": 3 * len(faces)},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": len(points) + len(corners), **({"uri": uri} if uri else {})}],
    }
    return tree | changes, points + corners


def glb(magic=b"glTF", **words):
    """The bytes of a GLB file."""
    tree, data = gltf(**words)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", magic, 2, 12 + len(chunks)) + chunks


def accessors(first=None, second=None):
    """Those of the block, changed."""
    one, other = gltf()[0]["accessors"]
    return [one | (first or {}), other | (second or {})]


def three_mf(model, **members):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("3D/3dmodel.model", model)
        for name, content in members.items():
            archive.writestr(name, content)
    return packed.getvalue()


def zipped(*members):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about names that are there already
        for name, content in members:
            archive.writestr(name, content)
    return packed.getvalue()


LINK = zipfile.ZipInfo("3D/3dmodel.model")
LINK.external_attr = (stat.S_IFLNK | 0o777) << 16


def model(objects=None, items='<item objectid="1"/>', unit="millimeter", faces=FACES):
    points = "".join('<vertex x="{}" y="{}" z="{}"/>'.format(*corner) for corner in (CORNERS * 1000).tolist())
    triangles = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*face) for face in faces.tolist())
    block = f'<object id="1"><mesh><vertices>{points}</vertices><triangles>{triangles}</triangles></mesh></object>'
    start = f'<model unit="{unit}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
    return f"{start}<resources>{objects or ''}{block}</resources><build>{items}</build></model>"


def dae(before="", unit=0.01, nodes='<node><instance_geometry url="#g"/></node>', library="", points=CORNERS * 100):
    numbers = " ".join(map(str, np.ravel(points).tolist()))
    source = f'<float_array id="a" count="24">{numbers}</float_array><technique_common><accessor source="#a" count="8"'
    source += ' stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>'
    corners = " ".join(map(str, FACES.ravel().tolist()))
    return (
        f'<?xml version="1.0" encoding="utf-8"?>{before}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" '
        f'version="1.4.1"><asset><unit meter="{unit}"/></asset><library_geometries><geometry id="g"><mesh>'
        f'<source id="s">{source}</accessor></technique_common></source><vertices id="v"><input semantic="POSITION" '
        f'source="#s"/></vertices><triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>{corners}'
        f"</p></triangles></mesh></geometry></library_geometries>{library}<library_visual_scenes><visual_scene "
        f'id="w">{nodes}</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#w"/></scene>'
        "</COLLADA>"
    )


def off(header="OFF\n8 6 0", quads=QUADS):
    lines = [header, *(" ".join(map(str, corner)) for corner in CORNERS.tolist())]
    return "\n".join([*lines, *(f"4 {a} {b} {c} {d} 255 0 0" for a, b, c, d in quads)]) + "\n"


def msh(faces=FACES, **changes):
    counts = {"vertices": 8, "normals": 1, "coordinates": 2, "faces": 12, **changes}
    rest = bytes(12 + 2 * 8)
    return struct.pack("<4i", *counts.values()) + CORNERS.astype("<f4").tobytes() + rest + faces.astype("<i4").tobytes()


def in_text(tree, data, uri="block.bin"):
    tree["buffers"][0]["uri"] = uri
    return json.dumps(tree)


def doubled(level, name, ref):
    """Parts that contain the next one twice, as often as there are levels."""
    return "".join(name(place, ref(place + 1) * 2) for place in range(level))


LAUGHS = (
    '<!DOCTYPE a [<!ENTITY a "ha">'
    + "".join(f'<!ENTITY {name} "{10 * f"&{before};"}">' for before, name in zip("abcdefgh", "bcdefghi", strict=True))
    + "]>"
)
DATA = "data:application/octet-stream;base64,"
NODES = doubled(
    40, lambda place, inner: f'<node id="n{place}">{inner}</node>', lambda place: f'<instance_node url="#n{place}"/>'
)
CYCLE = '<node id="n0"><instance_node url="#n1"/></node><node id="n1"><instance_node url="#n0"/></node>'
COMPONENTS = doubled(
    40,
    lambda place, inner: f'<object id="{place + 2}"><components>{inner}</components></object>',
    lambda place: f'<component objectid="{place + 2 if place < 40 else 1}"/>',
)
IN_ANOTHER = '<node><instance_node url="#n0"/></node>'
HOSTILE = {  # what is written into a file of this name, and what is said of it
    "endless.glb": (lambda: glb(accessors=accessors({"count": ENDLESS})), "accessors need 18000000144 bytes"),
    "zeros.glb": (
        lambda: glb(accessors=[*accessors(), {"componentType": 5126, "type": "VEC3", "count": ENDLESS}]),
        "accessors need",
    ),
    "bomb.3mf": (lambda: three_mf(model(), x=bytes(300 * 2**20)), r"unpacks to 3145\d+ bytes"),
    "tags.3mf": (lambda: three_mf("<a>" + "<b/>" * 4_000_000 + "</a>"), "4000002 tags"),
    "members.3mf": (lambda: three_mf(model()) + b"PK\1\2" * 1_000_000, r"archive has 1000001 files"),
    "cycle.glb": (
        lambda: glb(nodes=[{"children": [1]}, {"children": [0], "mesh": 0}]),
        "contain each other",
    ),
    "parents.glb": (lambda: glb(nodes=[{"children": [1, 1]}, {"mesh": 0}]), "two parents"),
    "cycle.dae": (lambda: dae(nodes=IN_ANOTHER, library=f"<library_nodes>{CYCLE}</library_nodes>"), "contain each"),
    "doubled.dae": (
        lambda: dae(
            nodes=IN_ANOTHER,
            library=f'<library_nodes>{NODES}<node id="n40"><instance_geometry url="#g"/></node></library_nodes>',
        ),
        r"parts have \d{14} triangles",
    ),
    "doubled.3mf": (lambda: three_mf(model(COMPONENTS, '<item objectid="2"/>')), r"parts have \d{14} triangles"),
    "not_a_number.glb": (lambda: glb(vertices=CORNERS * np.nan), "not finite"),
    "vast.off": (lambda: off().replace("0.03", "1e308"), "not finite"),
    "vast.dae": (lambda: dae(points=CORNERS * 1e308, unit=1.0), "places no triangles"),
    "negative.glb": (lambda: glb(accessors=accessors({"count": -5})), "an accessor has -5 elements"),
    "negative.off": (lambda: off("OFF\n-1 6 0"), "promises -1 vertices"),
    "promised.off": (lambda: off(f"OFF\n{ENDLESS} 6 0"), "vertex 15 of|a vertex has|ends before"),
    "negative.3mf": (lambda: three_mf(model(faces=FACES - 1)), "vertex that is not among"),
    "truncated.glb": (lambda: glb()[:-100], "not expected length"),
    "truncated.3mf": (lambda: three_mf(model())[:-60], "damaged"),
    "magic.glb": (lambda: glb(magic=b"glTX"), "does not begin like a GLB file"),
    "short.glb": (lambda: b"glTF", "damaged"),
    "outside.gltf": (lambda: in_text(*gltf(), "../../etc/passwd"), "'../../etc/passwd', which is not below"),
    "absolute.gltf": (lambda: in_text(*gltf(), "/etc/passwd"), "'/etc/passwd', which is not below"),
    "network.gltf": (lambda: in_text(*gltf(), "https://example.org/a.bin"), "there is no 'https://example.org/a.bin'"),
    "nonsense.gltf": (lambda: in_text(*gltf(), DATA + "%%%%"), "damaged"),
    "laughs.dae": (lambda: dae(LAUGHS), "document type"),
    "laughs.3mf": (lambda: three_mf(LAUGHS + model()), "document type"),
    "external.dae": (lambda: dae('<!DOCTYPE a [<!ENTITY e SYSTEM "file:///etc/passwd">]>'), "document type"),
    "hidden.dae": (lambda: dae(LAUGHS).replace("utf-8", "utf-7"), "encoding is not read"),
    "empty.glb": (lambda: glb(meshes=[{"primitives": []}]), "places no triangles"),
    "none.off": (lambda: off("OFF\n8 0 0", []), "no triangles"),
    "index.glb": (lambda: glb(faces=FACES + 5), "vertex that is not among"),
    "index.off": (lambda: off(quads=[(0, 1, 3, 99), *QUADS]), r"vertex 99"),
    "deep.gltf": (lambda: "[" * 1_000_000, "damaged"),
    "header.gltf": (lambda: '{"a": [' + "0," * 10_000_000 + "0]}", "header has more than"),
    "draco.glb": (lambda: glb(extensionsRequired=["KHR_draco_mesh_compression"]), "without compression"),
    "quantized.glb": (lambda: glb(accessors=accessors({"componentType": 5122})), "quantized"),
    "old.gltf": (lambda: in_text(*gltf(asset={"version": "1.0"})), "it is glTF 1.0, of which 2.0 is read"),
    "chain.glb": (
        lambda: glb(nodes=[*({"children": [i + 1]} for i in range(100_000)), {"mesh": 0}]),
        "more than 100 deep",
    ),
    "nested.dae": (
        lambda: dae(nodes="<node>" * 100_000 + '<instance_geometry url="#g"/>' + "</node>" * 100_000),
        "more than 100 deep",
    ),
    "data.gltf": (lambda: in_text(*gltf(), DATA + "A" * 70_000_000), "export it as GLB"),
    "most.gltf": (lambda: in_text(*gltf(), DATA + "A" * 67_000_000), "no triangles"),
    "buffers.gltf": (lambda: json.dumps(gltf()[0] | {"buffers": [{"byteLength": 1}] * 200_000}), "damaged"),
    "in_each_other.3mf": (lambda: zipped(("inner.3mf", three_mf(model()))), "no file 3D/3dmodel.model"),
    "in_place.3mf": (lambda: three_mf(three_mf(model())), "encoding is not read"),
    "link.3mf": (lambda: zipped((LINK, "/etc/passwd")), "no XML"),
    "twice.3mf": (lambda: zipped(*[("3D/3dmodel.model", model())] * 2), "two files of one name"),
    "case.3mf": (lambda: zipped(*[(name, model()) for name in ("3D/3dmodel.model", "3d/3DModel.MODEL")]), "one name"),
    "bound.dae": (lambda: dae() + "<bind_material " * 15_000_000, r"15\d{6} tags"),
    "skeleton.dae": (lambda: dae(nodes=IN_ANOTHER + '<node><instance_controller url="#c"/></node>'), "on a skeleton"),
    "promised.msh": (lambda: msh(faces=FACES[:4]), r"header \(8, 1, 2, 12\) does not fit its \d+ bytes"),
    "negative.msh": (lambda: msh(vertices=-(2**31)), "does not fit"),
    "index.msh": (lambda: msh(FACES - 1), "a face has the vertex -1"),
    "short.msh": (lambda: msh()[:15], "does not fit"),
    "gmsh.msh": (lambda: "$MeshFormat\n2.2 0 8\n", "it is MSH of Gmsh"),
    **{
        f"nothing.{ending}": (lambda: b"", "it is empty")
        for ending in ("glb", "gltf", "dae", "3mf", "off", "ply", "msh")
    },
    "vcount.dae": (
        lambda: dae().replace("<p>", f"<vcount>{ENDLESS}</vcount><p>").replace("triangles", "polylist"),
        f"promises {ENDLESS} corners",
    ),
}
MEASURE = """
import json, re, sys, time, warnings
from pathlib import Path
import trimesh, collada, lxml.etree, networkx
from activetouch.shapes import Mesh
warnings.simplefilter("ignore")
found = {}
for path in sys.argv[1:]:
    started = time.process_time()
    try:
        Mesh.from_file(path)
        said = "read"
    except Exception as error:
        said = f"{type(error).__name__}: {error}"
    most = int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])  # of this program alone
    found[path] = said, time.process_time() - started, most / 1024
print(json.dumps(found))
"""


@needs_extra
def test_hostile_files_are_refused_in_two_seconds_and_500_megabytes(tmp_path):
    for name, (make, _) in HOSTILE.items():
        content = make()
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    paths = [str(tmp_path / name) for name in HOSTILE]
    done = subprocess.run([sys.executable, "-c", MEASURE, *paths], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    wrong = {
        path: measured
        for path, (said, *measured) in found.items()
        if not (said.startswith("BadMesh: ") and re.search(HOSTILE[Path(path).name][1], said))
    }
    assert not wrong, [found[path] for path in wrong]
    assert not {path: seconds for path, (_, seconds, _) in found.items() if seconds > 2.0}
    assert not {path: megabytes for path, (_, _, megabytes) in found.items() if megabytes > 500}


@needs_extra
@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("block.glb", glb()),
        ("scaled.glb", glb(vertices=CORNERS * 10, scale=0.1)),
        ("block.gltf", in_text(*gltf(), DATA + base64.b64encode(gltf()[1]).decode())),
        ("beside.gltf", in_text(*gltf(), "my%20buffer.bin")),
        ("block.dae", dae()),
        ("metres.dae", dae(unit=1, points=CORNERS)),
        ("block.3mf", three_mf(model())),
        ("block.off", off()),
        ("glued.off", off("OFF8 6 0")),
        ("block.msh", msh()),
    ],
)
def test_a_block_has_its_size_in_every_format(name, content, tmp_path):
    (tmp_path / "my buffer.bin").write_bytes(gltf()[1])
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    mesh = Mesh.from_file(tmp_path / name)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([0.02, 0.03, 0.008], abs=1e-6)
    assert len(mesh.faces) == 12
    twice = {".dae": 0.02 if name == "block.dae" else 2.0, ".3mf": 0.002}.get(Path(name).suffix, 2.0)
    mesh = Mesh.from_file(tmp_path / name, scale=twice)  # metres per unit of the file, whatever it says
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([0.04, 0.06, 0.016], abs=1e-6)


@needs_extra
def test_parts_are_read_where_they_are_placed(tmp_path):
    nodes = [{"children": [1, 2]}, {"mesh": 0}, {"mesh": 0, "translation": [0.05, 0, 0]}]
    (tmp_path / "two.glb").write_bytes(glb(nodes=nodes))
    moved = '<item objectid="1"/><item objectid="1" transform="1 0 0 0 1 0 0 0 1 50 0 0"/>'
    (tmp_path / "two.3mf").write_bytes(three_mf(model(items=moved)))
    block = '<instance_geometry url="#g"/>'
    placed = f"<node>{block}</node><node><translate>5 0 0</translate>{block}</node>"
    (tmp_path / "two.dae").write_text(dae(nodes=placed))
    for ending in ("glb", "3mf", "dae"):
        with pytest.warns(match="2 separate surfaces"):
            mesh = Mesh.from_file(tmp_path / f"two.{ending}")
        assert np.ptp(mesh.vertices, axis=0) == pytest.approx([0.07, 0.03, 0.008], abs=1e-6)


SHINY = """<library_effects><effect id="e"><profile_COMMON><technique sid="c"><phong><shininess><color>0 0 0 1</color>
</shininess></phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>"""


@needs_extra
def test_geometry_is_read_whose_colour_is_missing(tmp_path):
    bound = (
        '<node><instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="red" '
        'target="#red"/></technique_common></bind_material></instance_geometry></node>'
    )
    moved = '<node><translate>5 0 0</translate><instance_geometry url="#g"><bind_material/></instance_geometry></node>'
    (tmp_path / "two.dae").write_text(dae(nodes=bound + moved))
    with pytest.warns(match="2 separate surfaces"):
        mesh = Mesh.from_file(tmp_path / "two.dae")
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([0.07, 0.03, 0.008], abs=1e-6)


@needs_extra
def test_nothing_is_said_about_colours(tmp_path, caplog):
    (tmp_path / "shiny.dae").write_text(dae(library=SHINY))
    Mesh.from_file(tmp_path / "shiny.dae")
    assert caplog.messages == []


def test_without_the_extra_the_line_has_the_install_command_and_the_conversion_of_the_file(tmp_path, monkeypatch):
    (tmp_path / "my mug.glb").write_bytes(glb())
    (tmp_path / "block.off").write_text(off())
    monkeypatch.setattr("activetouch.extras.find_spec", lambda name: None)
    helps = r"pip install '.*\[meshes\]' reads GLB files; without it, .*python -c .* '\S*my mug\.glb'$"
    with pytest.raises(BadMesh, match=helps) as said:
        read_meshes(tmp_path / "my mug.glb")
    assert "\n" not in str(said.value)
    meshes, left_out = read_files(tmp_path)
    assert list(meshes) == ["block"]  # OFF needs no extra
    assert [bool(re.search(helps, line)) for line in left_out] == [True]


@pytest.mark.parametrize(
    "text", [b"<a", b"<a/><b/>", b"\xff\xfe<\0a\0/\0>\0", b"<?xml version='1.0' encoding='x'?><a/>"]
)
def test_xml_that_is_none_or_hides_what_it_has_is_refused(text):
    with pytest.raises(ValueError, match=r"no XML|encoding"):
        xml_root(text)
