"""GLB, glTF, DAE and 3MF files, read by trimesh (the extra ``meshes``), behind checks that come before it.

A check refuses what would take memory or time out of proportion to the file: headers that promise more than the file
has, archives that unpack to more, parts that contain each other. It also refuses what trimesh would read as another
solid. Of other files, buffers below the file's own folder are opened, and no textures.
"""

from __future__ import annotations

import io
import json
import re
import struct
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np

from activetouch.errors import BadMesh
from activetouch.solids.primitives import joined
from activetouch.solids.triangles import Triangles
from belief.files import plain_number, require_regular_file

MOST_BYTES = 256 * 2**20
"""Of a file, with the buffers that it names, or of an archive that is unpacked."""
_MOST_JSON = 16 * 2**20  # of a header, without the data in its texts; objects of Python are 20 times as large
_MOST_TEXT = 64 * 2**20  # of glTF, whose data in texts take four times their length
_MOST_TAGS, _MOST_MEMBERS = 3_000_000, 10_000
MOST_TRIANGLES = 5_000_000
"""Of all parts of an object, counted wherever they are placed."""
_DEEPEST = 100  # of parts in parts
_PLAIN = ("utf-8", "us-ascii", "ascii", "iso-8859-1", "latin-1", "windows-1252")  # in which markup is ASCII
_ENCODING = re.compile(rb"""^(?:\xef\xbb\xbf)?\s*<\?xml[^>]*?\bencoding\s*=\s*["']([^"']*)""")
# Without a material that is missing, pycollada leaves out the geometry that is bound to it as well.
_MATERIALS = re.compile(rb"<bind_material\b(?:[^<]++|<(?!/?bind_material))*+</bind_material>")
_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_FLOAT, _TRIANGLES, _STRIP, _FAN = 5126, 4, 5, 6
_COMPRESSED = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
_UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}


def read_by_library(path: Path, content: bytes) -> tuple[Triangles, float | None]:
    """Vertices and triangles in the unit of a file, and metres per unit where it states another than metres."""
    kind = path.suffix.lower()
    try:
        if kind == ".dae":
            _require_few_tags(content)
            content = _MATERIALS.sub(b"", content)
        buffers, unit = _CHECKS[kind](content, path)
        return _loaded(content, kind[1:], buffers), unit
    except ValueError:
        raise
    except Exception as error:  # whatever a parser raises at a file that is not as it should be
        raise ValueError(f"it is damaged ({type(error).__name__}: {str(error)[:80]})") from error


def xml_root(content: bytes) -> ElementTree.Element:
    """The root of an XML text without entities, with names that have no namespace.

    >>> xml_root(b"<a xmlns='b'><c/></a>")[0].tag
    'c'
    """
    found = _ENCODING.match(content)
    if (found and found[1].decode("ascii", "replace").lower() not in _PLAIN) or b"\0" in content:
        raise ValueError("its encoding is not read; save it as UTF-8")
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise ValueError("it declares a document type, whose entities are not read; remove the line <!DOCTYPE")
    _require_few_tags(content)
    try:
        root = ElementTree.fromstring(content.strip())
    except ElementTree.ParseError as error:
        raise ValueError(f"it is no XML: {error}") from error
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    return root


def _require_few_tags(content: bytes) -> None:
    if (number := content.count(b"<")) > _MOST_TAGS:
        raise ValueError(f"it has {number} tags, {_MOST_TAGS} are the most; simplify it")


def below(folder: Path, name: str) -> Path:
    """The file of a name in a folder; ValueError if it is not below it."""
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise ValueError(f"it names {name!r:.120}, which is not below {folder}; files elsewhere are not opened")
    if not path.exists():
        raise ValueError(f"there is no {name!r:.120} in {folder}")
    return require_regular_file(path, BadMesh)


def _require_few(roots: Iterable[Hashable], parts: Callable[[Any], list[Any]], size: Callable[[Any], int]) -> None:
    """Refuse parts that contain each other, or have too many triangles when each is placed wherever it is named."""
    known: dict[Hashable, int] = {}

    def count(key: Hashable, depth: int) -> int:
        if depth > _DEEPEST:
            raise ValueError(f"its parts contain each other, or are more than {_DEEPEST} deep")
        if key not in known:
            known[key] = size(key) + sum(count(part, depth + 1) for part in parts(key))
        return known[key]

    if (number := sum(count(root, 0) for root in roots)) > MOST_TRIANGLES:
        raise ValueError(f"its parts have {number} triangles where they are placed, {MOST_TRIANGLES} are the most")


def _check_gltf(content: bytes, path: Path) -> tuple[dict[str, bytes], None]:
    text = content
    if path.suffix.lower() == ".glb":
        magic, version, _, length, chunk = struct.unpack_from("<4sIII4s", content)
        if (magic, version, chunk) != (b"glTF", 2, b"JSON"):
            raise ValueError("it does not begin like a GLB file of version 2")
        text = content[20 : 20 + length]
    elif len(content) > _MOST_TEXT:
        raise ValueError(f"it has {len(content)} bytes of text, {_MOST_TEXT} are the most; export it as GLB")
    if len(re.sub(rb'"data:[^"]*"', b"", text)) > _MOST_JSON:
        raise ValueError(f"its header has more than {_MOST_JSON} bytes; simplify it")
    tree = json.loads(text)
    if (version := str(tree["asset"]["version"])).partition(".")[0] != "2":
        raise ValueError(f"it is glTF {version:.20}, of which 2.0 is read; export it anew")
    if compressed := _COMPRESSED & {*tree.get("extensionsRequired", [])}:
        raise ValueError(f"it is compressed with {min(compressed)}; export it without compression")
    buffers, available = dict[str, bytes](), len(content)
    for uri in [one["uri"] for one in tree.get("buffers", []) if "uri" in one]:
        if uri not in buffers and not uri.startswith("data:"):
            file = below(path.parent, unquote(uri))
            if (available := available + file.stat().st_size) > MOST_BYTES:
                raise ValueError(f"it and its buffers have more than {MOST_BYTES} bytes; simplify it")
            buffers[uri] = file.read_bytes()
    accessors = tree.get("accessors", [])
    if wrong := [one["count"] for one in accessors if not (isinstance(one["count"], int) and one["count"] >= 0)]:
        raise ValueError(f"an accessor has {wrong[0]!r:.20} elements")
    needed = sum(one["count"] * _BYTES[one["componentType"]] * _COLUMNS[one["type"]] for one in accessors)
    if needed > available:
        raise ValueError(f"its accessors need {needed} bytes, the file and its buffers have {available}")
    meshes, nodes = tree.get("meshes", []), tree.get("nodes", [])
    for primitive in (each for mesh in meshes for each in mesh["primitives"]):
        _require_plain(primitive, accessors)
    if any(number > 1 for number in Counter(child for node in nodes for child in node.get("children", [])).values()):
        raise ValueError("a node has two parents")

    def parts(node: int) -> list[int]:
        if node < 0:
            raise ValueError(f"a node has the number {node}")
        return list(nodes[node].get("children", []))

    def size(node: int) -> int:
        placed = meshes[nodes[node]["mesh"]]["primitives"] if "mesh" in nodes[node] else []
        return sum(_num_triangles(each, accessors) for each in placed)

    scenes = tree.get("scenes", [])
    _require_few(scenes[tree.get("scene", 0)].get("nodes", []) if scenes else [], parts, size)
    return buffers, None


def _require_plain(primitive: Mapping[str, Any], accessors: list[Any]) -> None:
    """Refuse triangles that trimesh reads as others, or leaves out."""
    mode = primitive.get("mode", _TRIANGLES)
    if mode == _FAN:
        raise ValueError("it has triangle fans, which are not read; export plain triangles")
    if mode in (_TRIANGLES, _STRIP):
        position = accessors[primitive["attributes"]["POSITION"]]
        used = [position, *([accessors[primitive["indices"]]] if "indices" in primitive else [])]
        if position["componentType"] != _FLOAT or any("sparse" in one for one in used):
            raise ValueError("its vertices are quantized or sparse, which is not read; export plain numbers")


def _num_triangles(primitive: Mapping[str, Any], accessors: list[Any]) -> int:
    if (mode := primitive.get("mode", _TRIANGLES)) not in (_TRIANGLES, _STRIP):
        return 0
    corners = accessors[primitive.get("indices", primitive["attributes"]["POSITION"])]["count"]
    return int(corners if mode == _STRIP else corners // 3)


def _check_dae(content: bytes, path: Path) -> tuple[None, float | None]:
    root = xml_root(content)
    by_url = {f"#{one.get('id')}": one for one in root.iter() if one.get("id")}
    if any(True for _ in root.iter("instance_controller")):
        raise ValueError("it has parts on a skeleton, which are not read; export it without")
    for polygons in root.iter("polylist"):
        corners = sum(int(word) for one in polygons.iter("vcount") for word in (one.text or "").split())
        if corners > sum(map(_num_words, polygons.iter("p"))):
            raise ValueError(f"a list of polygons promises {corners} corners, more than it has")

    def parts(one: ElementTree.Element) -> list[ElementTree.Element]:
        if one.tag != "node":
            return []
        others = [by_url[each.get("url", "")] for each in one if each.tag.startswith("instance_") and _is_placed(each)]
        return [*one.findall("node"), *others]

    def size(one: ElementTree.Element) -> int:
        return 0 if one.tag == "node" else sum(map(_num_words, one.iter("p"))) // 3

    def _is_placed(one: ElementTree.Element) -> bool:
        return one.get("url") in by_url and one.tag in ("instance_node", "instance_geometry")

    _require_few([node for scene in root.iter("visual_scene") for node in scene.findall("node")], parts, size)
    unit = root.find("asset/unit")
    metres = plain_number(unit.get("meter", "1")) if unit is not None else 1.0
    if not 0.0 < metres < np.inf:
        raise ValueError(f"its unit is {metres:g} m")
    return None, None if metres == 1.0 else metres


def _num_words(element: ElementTree.Element) -> int:
    text = element.text or ""
    return sum(map(text.count, " \n\t\r")) + 1 if text else 0


def _check_3mf(content: bytes, path: Path) -> tuple[None, float]:
    if (number := content.count(b"PK\1\2")) > _MOST_MEMBERS:  # each is read before an archive tells their number
        raise ValueError(f"its archive has {number} files, {_MOST_MEMBERS} are the most")
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = archive.infolist()
        if (size := sum(one.file_size for one in members)) > MOST_BYTES:
            raise ValueError(f"it unpacks to {size} bytes, {MOST_BYTES} are the most")
        if len({one.filename.lower() for one in members}) < len(members):
            raise ValueError("its archive has two files of one name")
        models = {one.filename: xml_root(archive.read(one)) for one in members if one.filename.endswith(".model")}
    root = next((model for name, model in models.items() if "3d/3dmodel.model" in name.lower()), None)
    if root is None:
        raise ValueError("its archive has no file 3D/3dmodel.model")
    objects = {one.get("id"): one for one in root.iter("object")}
    other = [name.strip("/") for one in root.iter("component") for key, name in one.items() if key.endswith("path")]
    if len({*other}) < len(other) or any(len(list(models[name].iter("mesh"))) > 1 for name in other if name in models):
        raise ValueError("objects of other files are placed twice, or are several in one file, which is not read")

    def parts(key: str) -> list[str]:
        return [one.get("objectid", "") for one in objects[key].iter("component")] if key in objects else []

    def num(key: str) -> int:
        return sum(1 for _ in objects[key].iter("triangle")) if key in objects else 0

    _require_few([one.get("objectid") for one in root.iter("item")], parts, num)
    return None, _UNITS[root.get("unit", "millimeter")]


_CHECKS: Mapping[str, Callable[[bytes, Path], tuple[dict[str, bytes] | None, float | None]]] = {
    ".glb": _check_gltf,
    ".gltf": _check_gltf,
    ".dae": _check_dae,
    ".3mf": _check_3mf,
}


def _loaded(content: bytes, kind: str, buffers: Mapping[str, bytes] | None) -> Triangles:
    """The triangles of all parts, each where it is placed."""
    import trimesh
    from trimesh.util import log

    options: dict[str, Any] = {"skip_materials": True} if kind.startswith("gl") else {}
    was_disabled, log.disabled = log.disabled, True  # it writes about colours and textures
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, resolver=buffers, process=False, **options)
    finally:
        log.disabled = was_disabled
    placed = []
    for name in scene.graph.nodes_geometry:
        matrix, part = scene.graph[name]
        mesh = scene.geometry[part]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.intp)
            if faces.min() < 0 or faces.max() >= len(vertices):
                raise ValueError(f"a triangle has a vertex that is not among the {len(vertices)} vertices")
            placed.append((vertices @ matrix[:3, :3].T + matrix[:3, 3], faces))
    if not placed:
        raise ValueError("it places no triangles")
    return joined(placed)
