"""The readers of 3MF and DAE (COLLADA) files: one surface of all parts of the scene, and metres per unit."""

from __future__ import annotations

import io
import re
import zipfile
from array import array
from collections.abc import Iterator
from functools import cache
from itertools import starmap
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import scipy  # whose parts load at first use

from activetouch.solids.mesh_assembly import MOST_BYTES, assembled, fans
from activetouch.solids.solid import Floats, Ints
from belief.files import plain_number

_UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
_MOST_ELEMENTS, _MOST_MEMBERS = 200_000, 10_000


class _Builder(ElementTree.TreeBuilder):
    """Elements by their names without namespaces; vertices and triangles of 3MF become numbers in their mesh."""

    def __init__(self) -> None:
        super().__init__()
        self._num = 0
        self.surfaces: list[tuple[array[float], array[int]]] = []

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Refuse document types, which may define texts that grow without bound."""
        raise ValueError("it defines a document type, which mesh files do not need")

    def start(self, tag: Any, attrs: Any) -> Any:
        """Begin an element."""
        tag = tag.rpartition("}")[2]
        if tag == "vertex" and self.surfaces:
            self.surfaces[-1][0].extend([plain_number(attrs[axis]) for axis in "xyz"])
            return None
        if tag == "triangle" and self.surfaces:
            self.surfaces[-1][1].extend([int(attrs[corner]) for corner in ("v1", "v2", "v3")])
            return None
        if tag == "mesh":
            attrs = {**attrs, "surface": str(len(self.surfaces))}
            self.surfaces.append((array("d"), array("q")))
        self._num += 1
        if self._num > _MOST_ELEMENTS:
            raise ValueError(f"it has more than {_MOST_ELEMENTS} elements")
        return super().start(tag, {name.rpartition("}")[2]: text for name, text in attrs.items()})

    def end(self, tag: str) -> Any:
        """End an element."""
        tag = tag.rpartition("}")[2]
        return None if tag in ("vertex", "triangle") and self.surfaces else super().end(tag)


def _parsed(content: bytes) -> tuple[Element, _Builder]:
    builder = _Builder()
    parser = ElementTree.XMLParser(target=builder)
    parser.feed(content)
    return parser.close(), builder


def read_3mf(content: bytes) -> tuple[Floats, Ints, float]:
    """The triangles of all items of a 3MF file, and metres per unit; no other file is opened."""
    objects: dict[tuple[str, str | None], tuple[Element, _Builder]] = {}
    items: list[tuple[Element, str]] = []
    unit = "millimeter"
    for path, model in _models(content):
        root, builder = _parsed(model)
        for one in root.findall("resources/object"):
            objects[path, one.get("id")] = one, builder
        if found := root.findall("build/item"):
            items += [(item, path) for item in found]
            unit = root.get("unit", unit)

    def children(key: tuple[str, str | None]) -> Iterator[tuple[tuple[str, str | None], Floats]]:
        return (_placed(part, key[0]) for part in objects[key][0].findall("components/component"))

    def parts(key: tuple[str, str | None]) -> Iterator[tuple[Floats, Ints]]:
        one, builder = objects[key]
        for mesh in one.findall("mesh"):
            coordinates, corners = builder.surfaces[int(mesh.get("surface", ""))]
            yield np.array(coordinates).reshape(-1, 3), np.array(corners, np.intp).reshape(-1, 3)

    return *assembled(starmap(_placed, items), children, parts), _UNITS[unit]


def _models(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Path and bytes of each model in an archive; not more is unpacked than allowed, whatever the archive promises."""
    if content.count(b"PK\x01\x02") > _MOST_MEMBERS:
        raise ValueError(f"its archive has more than {_MOST_MEMBERS} members")
    left = MOST_BYTES
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for member in archive.infolist():
            if not member.filename.lower().endswith(".model"):
                continue
            with archive.open(member) as file:
                model = b"" if member.file_size > left else file.read(left + 1)
            if member.file_size > left or len(model) > left:
                raise ValueError(f"{member.filename[:80]} unpacks to more than {left} bytes")
            left -= len(model)
            yield member.filename.lstrip("/"), model


def _placed(item: Element, path: str) -> tuple[tuple[str, str | None], Floats]:
    """Which object an item or a component is, and its transform."""
    place = np.eye(4)
    if transform := item.get("transform"):
        place[:3] = _numbers(transform).reshape(4, 3).T
    return (item.get("path", path).lstrip("/"), item.get("objectid")), place


def _numbers(text: str | None) -> Floats:
    return np.array(array("d", (plain_number(word[0]) for word in re.finditer(r"\S+", text or ""))))


def read_dae(content: bytes) -> tuple[Floats, Ints, float | None]:
    """The triangles of the scene of a COLLADA file, and metres per unit, if it says so; no other file is opened."""
    root, _ = _parsed(content)
    named = {element.get("id"): element for element in root.iter() if element.get("id")}
    numbers = cache(lambda element: _numbers(element.text))
    transform = cache(lambda node: _dae_transform(node, numbers))
    points = cache(lambda vertices: _dae_points(vertices, target, numbers))

    def target(element: Element, kind: str = "url") -> Element:
        if (found := named.get(element.get(kind, "").removeprefix("#"))) is None:
            raise ValueError(f"it refers to {element.get(kind)!r:.80}, which it does not have")
        return found

    def children(node: Element) -> Iterator[tuple[Element, Floats]]:
        for one in node:
            if one.tag in ("node", "instance_node"):
                child = one if one.tag == "node" else target(one)
                yield child, transform(child)
            elif one.tag in ("instance_geometry", "instance_controller", "skin"):
                yield target(one, "source" if one.tag == "skin" else "url"), np.eye(4)

    def parts(node: Element) -> Iterator[tuple[Floats, Ints]]:
        return _dae_triangles(node, target, numbers, points)

    scenes = [target(one) for one in root.findall("scene/instance_visual_scene")]
    scenes = scenes or root.findall("library_visual_scenes/visual_scene")
    if not any(scene.find(kind) is not None for scene in set(scenes) for kind in ("node", "instance_node")):
        scenes = root.findall("library_geometries/geometry")
    roots = ((scene, np.eye(4)) for scene in scenes)
    unit = root.find("asset/unit")
    metres = None if unit is None else plain_number(unit.get("meter", "1"))
    return *assembled(roots, children, parts), metres


def _dae_transform(node: Element, numbers: Any) -> Floats:
    """The transform of a node: the product of those that it lists."""
    place = np.eye(4)
    for element in node:
        step = np.eye(4)
        if element.tag == "matrix":
            step = numbers(element).reshape(4, 4)
        elif element.tag == "translate":
            step[:3, 3] = numbers(element)
        elif element.tag == "scale":
            step[:3, :3] = np.diag(numbers(element))
        elif element.tag == "rotate":
            *axis, angle = numbers(element)
            turn = np.append(np.array(axis) * np.sin(np.radians(angle) / 2), np.cos(np.radians(angle) / 2))
            step[:3, :3] = scipy.spatial.transform.Rotation.from_quat(turn).as_matrix()
        else:
            continue
        place = place @ step
    return place


def _dae_points(vertices: Element, target: Any, numbers: Any) -> Floats:
    (position,) = (one for one in vertices.findall("input") if one.get("semantic") == "POSITION")
    source = target(position, "source")
    accessor, values = source.find("technique_common/accessor"), source.find("float_array")
    width = 3 if accessor is None else int(accessor.get("stride", "1"))
    found: Floats = numbers(values).reshape(-1, width)[:, :3]
    return found


def _dae_triangles(geometry: Element, target: Any, numbers: Any, points: Any) -> Iterator[tuple[Floats, Ints]]:
    for primitive in geometry.findall("mesh/*"):
        if primitive.tag in ("tristrips", "trifans") or primitive.find("ph") is not None:
            raise ValueError(f"it has {primitive.tag}, which are not read; export it as triangles")
        if primitive.tag not in ("triangles", "polylist", "polygons"):
            continue
        inputs = primitive.findall("input")
        stride = 1 + max(int(one.get("offset", "0")) for one in inputs)
        (vertex,) = (one for one in inputs if one.get("semantic") == "VERTEX")
        lists = [numbers(one).astype(np.intp).reshape(-1, stride) for one in primitive.findall("p")]
        corners = np.concatenate([np.empty((0, stride), np.intp), *lists])[:, int(vertex.get("offset", "0"))]
        sizes = np.array([len(one) for one in lists])
        if primitive.tag == "triangles":
            sizes = np.full(-(-len(corners) // 3), 3)
        elif primitive.tag == "polylist":
            sizes = numbers(primitive.find("vcount")).astype(np.intp)
        yield points(target(vertex, "source")), fans(corners, sizes)
