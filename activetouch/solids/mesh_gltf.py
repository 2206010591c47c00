"""The reader of glTF and GLB files: one surface of all meshes of the scene, in metres."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import scipy  # whose parts load at first use

from activetouch.solids.mesh_assembly import MOST_BYTES, assembled, fans
from activetouch.solids.solid import Floats, Ints
from belief.files import require_regular_file

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COMPRESSED = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6  # modes of primitives
_MOST_ITEMS = 1_000_000  # of the description


def read_gltf(content: bytes, folder: Path) -> tuple[Floats, Ints, float]:
    """The triangles of the scene, and metres per unit, which is 1.

    Args:
        content: bytes of the file.
        folder: of the file; buffers of a ``.gltf`` file are read if they are files in it.
    """
    description, binary = _chunks(content)
    if sum(description.count(sign) for sign in (b"[", b"{", b",")) > _MOST_ITEMS:
        raise ValueError(f"its description has more than {_MOST_ITEMS} items")
    scene = _Scene(json.loads(description), binary, folder)
    return *assembled(scene.roots(), scene.children, scene.parts), 1.0


def _chunks(content: bytes) -> tuple[bytes, bytes | None]:
    """The description and the binary buffer, if there is one."""
    if content[:4] != b"glTF":
        return content, None
    version, length = struct.unpack_from("<II", content.ljust(12, b"\0"), 4)
    if version != 2 or length != len(content):
        raise ValueError(f"its header promises {length} bytes of version {version}; the file has {len(content)}, of 2")
    place, found = 12, list[bytes]()
    for wanted in (b"JSON", b"BIN\0"):
        if place == length and found:
            break
        size, kind = struct.unpack_from("<I4s", content[place : place + 8].ljust(8, b"\0"))
        if kind != wanted or place + 8 + size > length:
            raise ValueError(
                f"at byte {place} there must be a chunk {wanted!r}, there is {kind!r} of {size} bytes, and "
                f"{max(length - place - 8, 0)} bytes are left"
            )
        found.append(content[place + 8 : place + 8 + size])
        place += 8 + size
    return found[0], found[1] if len(found) > 1 else None


_Key = tuple[str, int]  # a kind of item, and its index


class _Scene:
    """A description, and the buffers that it refers to."""

    def __init__(self, description: Any, binary: bytes | None, folder: Path) -> None:
        self._all, self._binary, self._folder = description, binary, folder
        self._buffers: dict[int, bytes] = {}
        self._num_bytes = 0
        if needed := _COMPRESSED & set(self._all.get("extensionsRequired", ())):
            raise ValueError(f"it needs {', '.join(sorted(needed))}, which is not read; export it without compression")

    def roots(self) -> Iterator[tuple[_Key, Floats]]:
        """Nodes of the scene, with their transforms."""
        if "scenes" in self._all:
            return self._placed(self._item("scenes", self._all.get("scene", 0)).get("nodes", ()))
        inside = {child for node in self._all.get("nodes", ()) for child in node.get("children", ())}
        return self._placed(index for index in range(len(self._all.get("nodes", ()))) if index not in inside)

    def children(self, key: _Key) -> Iterator[tuple[_Key, Floats]]:
        """The mesh of a node, and nodes in it with their transforms."""
        kind, index = key
        if kind == "nodes":
            node = self._item(kind, index)
            if (mesh := node.get("mesh")) is not None:
                yield ("meshes", mesh), np.eye(4)
            yield from self._placed(node.get("children", ()))

    def parts(self, key: _Key) -> Iterator[tuple[Floats, Ints]]:
        """Vertices and triangles of a mesh."""
        kind, index = key
        for primitive in self._item(kind, index)["primitives"] if kind == "meshes" else ():
            mode = primitive.get("mode", _TRIANGLES)
            if mode not in (_TRIANGLES, _STRIP, _FAN):
                continue  # points and lines
            vertices = self._numbers(primitive["attributes"]["POSITION"], "VEC3").astype(np.float64)
            corners = np.arange(len(vertices))
            if "indices" in primitive:
                corners = self._numbers(primitive["indices"], "SCALAR").ravel().astype(np.intp)
            if mode == _TRIANGLES:
                yield vertices, fans(corners, np.full(-(-len(corners) // 3), 3))
            elif mode == _FAN:
                yield vertices, fans(corners, np.array([len(corners)]))
            else:
                yield vertices, np.lib.stride_tricks.sliding_window_view(corners, 3)

    def _item(self, kind: str, index: Any) -> Any:
        items = self._all.get(kind, ())
        if type(index) is not int or not 0 <= index < len(items):
            raise ValueError(f"it refers to {kind}[{index!r:.40}], and has {len(items)} {kind}")
        return items[index]

    def _placed(self, nodes: Any) -> Iterator[tuple[_Key, Floats]]:
        return ((("nodes", node), _transform(self._item("nodes", node))) for node in nodes)

    def _numbers(self, index: Any, kind: str) -> np.ndarray:
        """The numbers of an accessor, ``(count, 3)`` or ``(count, 1)``."""
        accessor = self._item("accessors", index)
        if accessor["type"] != kind or "sparse" in accessor:
            raise ValueError(f"accessors[{index}] must be a {kind} that is not sparse")
        view = self._item("bufferViews", accessor["bufferView"])
        dtype, width = np.dtype(_TYPES[accessor["componentType"]]), 3 if kind == "VEC3" else 1
        num, first, data = accessor["count"], view.get("byteOffset", 0), self._buffer(view["buffer"])
        start, least = first + accessor.get("byteOffset", 0), width * dtype.itemsize
        step = view.get("byteStride", least)
        end = start + (num - 1) * step + least
        last = min(first + view["byteLength"], len(data))
        if not (num >= 1 and step >= least and 0 <= first <= start and end <= last):
            raise ValueError(
                f"accessors[{index}] needs {num} × {step} bytes from byte {start} to {end}; its view of the buffer "
                f"ends at byte {last}"
            )
        found = np.ndarray((num, width), dtype, data, start, (step, dtype.itemsize))
        return found / np.iinfo(dtype).max if accessor.get("normalized") and dtype.kind != "f" else found

    def _buffer(self, index: Any) -> bytes:
        buffer = self._item("buffers", index)
        if index not in self._buffers:
            self._buffers[index] = self._bytes(buffer.get("uri"))
            self._num_bytes += len(self._buffers[index])
            if self._num_bytes > MOST_BYTES:
                raise ValueError(f"its buffers have more than {MOST_BYTES} bytes")
        return self._buffers[index]

    def _bytes(self, uri: str | None) -> bytes:
        if uri is None:
            if self._binary is None:
                raise ValueError("its buffer is missing")
            return self._binary
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2], validate=True)
        path = self._folder / unquote(uri)
        if "://" in uri or not path.resolve().is_relative_to(self._folder.resolve()):
            raise ValueError(f"its buffer {uri[:80]!r} is not a file in its own folder; others are not opened")
        if require_regular_file(path, ValueError).stat().st_size > MOST_BYTES:
            raise ValueError(f"its buffer {uri[:80]!r} has more than {MOST_BYTES} bytes")
        return path.read_bytes()


def _transform(node: Any) -> Floats:
    """The transform of a node, ``(4, 4)``."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    place = np.eye(4)
    if "rotation" in node:
        place[:3, :3] = scipy.spatial.transform.Rotation.from_quat(node["rotation"]).as_matrix()
    place[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), np.float64)
    place[:3, 3] = node.get("translation", (0, 0, 0))
    return place
