"""URDF and MJCF files as sources of objects: the meshes and primitives of each link or body, in its own frame.

No other file is opened than the meshes that they name, below a folder; MJCF files that are included are not. A link is
what its visuals show, or its collision geometry where it has none; a body is its geoms of the groups 0 to 2, which
MuJoCo's viewer shows, or else all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, reduce
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from activetouch.errors import BadMesh
from activetouch.solids.library_file import MOST_TRIANGLES, below, xml_root
from activetouch.solids.mesh import Mesh
from activetouch.solids.mesh_file import in_metres, read_triangles
from activetouch.solids.primitives import Box, Capsule, Cylinder, Ellipsoid, Solid, Sphere, hull, joined
from activetouch.solids.triangles import Floats, Triangles
from belief.files import plain_number, require_regular_file

ROBOTS = (".urdf", ".mjcf", ".xml")
"""Endings of the files that may describe robots."""
_MOST_BYTES = 16 * 2**20
_BEGINS = 65536  # bytes in which the root of MJCF is looked for
_GROUPS_SHOWN = 3
_TURNS = {"quat", "axisangle", "xyaxes", "zaxis", "euler"}
_PRIMITIVES: Mapping[str, tuple[int, Callable[[list[float]], Solid]]] = {
    "sphere": (1, lambda size: Sphere(*size)),
    "capsule": (2, lambda size: Capsule(*size)),
    "cylinder": (2, lambda size: Cylinder(*size)),
    "ellipsoid": (3, lambda size: Ellipsoid((size[0], size[1], size[2]))),
    "box": (3, lambda size: Box((size[0], size[1], size[2]))),
}


@dataclass(frozen=True)
class Piece:
    """A geometry of a link: a mesh file's name, or triangles [m]; and what turns, scales and moves them in the link."""

    source: str | Solid | Triangles
    matrix: Floats
    position: Floats


@dataclass(frozen=True)
class Robot:
    """The pieces of each link or body that has any, by its name, all mesh files, and lines on what is left out."""

    pieces: Mapping[str, Sequence[Piece]]
    meshes: Sequence[str]
    left_out: Sequence[str]


def is_robot(path: Path) -> bool:
    """Whether a path is that of a URDF file, or of an XML file that is MJCF."""
    if path.suffix.lower() in (".urdf", ".mjcf"):
        return True
    if path.suffix.lower() != ".xml" or not path.is_file():
        return False
    with suppress(OSError), path.open("rb") as file:
        return b"<mujoco" in file.read(_BEGINS)
    return False


@np.errstate(all="ignore")  # what is not finite is refused later
def read_robot(path: Path) -> Robot:
    """The geometry that a URDF or MJCF file describes; raises BadMesh for one that cannot be read."""
    if not path.exists():
        raise FileNotFoundError(f"there is no file {path}; relative paths start from {Path.cwd()}")
    require_regular_file(path, BadMesh)
    try:
        if (size := path.stat().st_size) > _MOST_BYTES:
            raise ValueError(f"it has {size} bytes, {_MOST_BYTES} are the most")
        return _described(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise BadMesh(f"{path.name}: cannot be read as URDF or MJCF: {error}") from error


@lru_cache(maxsize=8)  # each link is read by itself
def _described(content: bytes) -> Robot:
    root = xml_root(content)
    if root.tag not in ("robot", "mujoco"):
        raise ValueError(f"it begins with <{root.tag:.40}>, neither <robot> nor <mujoco>")
    return _urdf(root) if root.tag == "robot" else _Mjcf(root).robot()


def mesh_paths(path: Path, folder: Path, robot: Robot) -> Iterator[Path]:
    """The mesh files of a robot that are there."""
    for name in dict.fromkeys(robot.meshes):
        with suppress(ValueError, OSError):
            yield _found(path, folder, name)


@np.errstate(all="ignore")  # what is not finite is refused later
def read_link(path: Path, folder: Path, link: str, scale: float = 1.0) -> Mesh:
    """The mesh of a link or body, or of the only one if the name is empty; files are looked for below a folder."""
    robot = read_robot(path)
    if not link and len(robot.pieces) == 1:
        [link] = robot.pieces
    if link not in robot.pieces:
        known = ", ".join(f"{path.name}#{name}" for name in robot.pieces) or "none"
        raise BadMesh(f"{path.name}: it has no single object {link!r}; name one of: {known}")
    placed = []
    for piece in robot.pieces[link]:
        try:
            vertices, faces = _triangles(path, folder, piece.source)
        except (OSError, ValueError) as error:
            raise BadMesh(f"{path.name}#{link}: {error}") from error
        placed.append((vertices @ piece.matrix.T + piece.position, faces))
        if (number := sum(len(each) for _, each in placed)) > MOST_TRIANGLES:
            raise BadMesh(f"{path.name}#{link}: it has more than {number} triangles, {MOST_TRIANGLES} are the most")
    name = f"{path.name}#{link}"
    vertices, faces, remarks, used = in_metres(name, *joined(placed), scale)
    return Mesh(name, vertices, faces, centred=True, remarks=remarks, scale=used)


def _triangles(path: Path, folder: Path, source: str | Solid | Triangles) -> Triangles:
    if not isinstance(source, str):
        return source.triangles() if isinstance(source, Solid) else source
    vertices, faces, unit = read_triangles(_found(path, folder, source))
    return vertices * (1.0 if unit is None else unit), faces


def _found(path: Path, folder: Path, name: str) -> Path:
    """The file of a mesh: beside the robot, or, as packages have it, from a folder above it up to the outermost one."""
    scheme, sign, rest = name.rpartition("://")
    if sign and scheme not in ("package", "model", "file"):
        raise ValueError(f"its mesh {name!r:.120} is no file; files elsewhere are not opened")
    inner, outer = path.parent.resolve(), folder.resolve()
    above = [one for one in (inner, *inner.parents) if one.is_relative_to(outer)]
    rest = rest.lstrip("/") if scheme in ("package", "model") else rest
    names = [rest, rest.partition("/")[2]] if scheme in ("package", "model") else [rest]
    for place in (base / each for each in names for base in above if each):  # a package's folder, or else its files
        if place.exists() and (file := place.resolve()).is_relative_to(outer):
            return require_regular_file(file, BadMesh)
    below(folder, str(inner / names[0]))
    raise ValueError(f"there is no mesh {name!r:.120} below {folder}; give the folder that holds it")


def _numbers(text: str | None, default: Sequence[float], num: int | None = None) -> Floats:
    """The finite numbers of an attribute, of which there must be so many."""
    if text is None:
        return np.array(default, float)
    values = np.array([plain_number(word) for word in text.split()])
    if not np.isfinite(values).all() or len(values) != (len(values) if num is None else num):
        raise ValueError(f"{text[:40]!r} should be {'' if num is None else num} finite numbers")
    return values


def _primitive(kind: str, size: Floats) -> Solid:
    """A primitive of half lengths, as MJCF has them."""
    number, make = _PRIMITIVES[kind]
    if len(size) < number:
        raise ValueError(f"a {kind} needs {number} sizes, got {len(size)}")
    return make(size.tolist()[:number])


def _urdf(root: Element) -> Robot:
    pieces, left_out = dict[str, list[Piece]](), list[str]()
    for link in root.findall("link"):
        name = link.get("name", "link")
        for kind in ("visual", "collision"):
            for each in link.findall(kind):
                try:
                    piece = _urdf_piece(each)
                except ValueError as error:
                    left_out.append(f"a {kind} of {name}: {error}")
                else:
                    pieces.setdefault(name, []).append(piece)
            if name in pieces:
                break
    return Robot(pieces, [one.get("filename", "") for one in root.iter("mesh")], left_out)


def _urdf_piece(element: Element) -> Piece:
    shape = next(iter(element.find("geometry") or ()), None)
    if shape is None:
        raise ValueError("it has no geometry")
    origin = element.find("origin")
    given = {} if origin is None else origin.attrib
    rotation = Rotation.from_euler("xyz", _numbers(given.get("rpy"), (0, 0, 0), 3)).as_matrix()
    position = _numbers(given.get("xyz"), (0, 0, 0), 3)
    if shape.tag == "mesh":
        scales = _numbers(shape.get("scale"), (1, 1, 1))[:3] * np.ones(3)
        return Piece(shape.get("filename", ""), rotation * scales, position)
    size = _numbers(shape.get("size"), (), 3) / 2
    if shape.tag in ("cylinder", "capsule", "sphere"):
        radius, length = (_numbers(shape.get(each), (0,), 1) for each in ("radius", "length"))
        size = np.concatenate([radius, length / 2])
    elif shape.tag != "box":
        raise ValueError(f"a {shape.tag:.40} is not read")
    return Piece(_primitive(shape.tag, size), rotation, position)


class _Mjcf:
    """The parts of an MJCF file that its geoms depend on."""

    def __init__(self, root: Element) -> None:
        self.root, self.left_out, self.pieces = root, list[str](), dict[str, list[tuple[bool, Piece]]]()
        compiler = {key: value for one in root.findall("compiler") for key, value in one.attrib.items()}
        self.in_degrees, self.sequence = compiler.get("angle") != "radian", compiler.get("eulerseq", "xyz")
        self.folder, self.strips = compiler.get("meshdir", compiler.get("assetdir", "")), compiler.get("strippath")
        self.defaults = {"main": (dict[str, str](), dict[str, str]())}
        for one in root.findall("default"):  # each adds to the one before; older MuJoCos let them have other names
            self._add_defaults(one, "main", self.defaults["main"])
            self.defaults[one.get("class", "main")] = self.defaults["main"]
        self.meshes = {}
        for mesh in root.iterfind("asset/mesh"):
            try:
                given = _over(self._of_class(mesh.get("class", "main"))[1], mesh.attrib)
            except ValueError as error:
                self.left_out.append(f"the mesh {mesh.get('name', mesh.get('file', '')):.40}: {error}")
                continue
            self.meshes[given.get("name", Path(given.get("file", "")).stem)] = given

    def robot(self) -> Robot:
        if any(True for _ in self.root.iter("include")):
            self.left_out.append("what it includes; no other file is opened than meshes, so name those files, too")
        for world in self.root.findall("worldbody"):
            self._add_body(world, "main", "world")
        shown = {name: [one for is_shown, one in some if is_shown] for name, some in self.pieces.items()}
        pieces = {name: shown[name] or [one for _, one in some] for name, some in self.pieces.items()}
        return Robot(pieces, [self._file(one["file"]) for one in self.meshes.values() if "file" in one], self.left_out)

    def _add_defaults(self, element: Element, name: str, above: tuple[dict[str, str], dict[str, str]]) -> None:
        geom, mesh = (
            reduce(_over, (one.attrib for one in element.findall(tag)), each)
            for each, tag in zip(above, ("geom", "mesh"), strict=True)
        )
        self.defaults[name] = geom, mesh
        for one in element.findall("default"):
            self._add_defaults(one, one.get("class", ""), (geom, mesh))

    def _of_class(self, name: str) -> tuple[dict[str, str], dict[str, str]]:
        if name not in self.defaults:
            raise ValueError(f"there is no default class {name[:40]!r}")
        return self.defaults[name]

    def _add_body(self, body: Element, of_class: str, name: str) -> None:
        self._add_geoms(body, body.get("childclass", of_class), name, np.eye(3), np.zeros(3))

    def _add_geoms(self, parent: Element, of_class: str, name: str, rotation: Floats, position: Floats) -> None:
        """Add geoms of a body, or of a frame in it, and the bodies in it."""
        for one in parent:
            if one.tag == "body":
                self._add_body(one, of_class, one.get("name", f"body {len(self.pieces) + 1}"))
            elif one.tag == "frame":
                turned, moved = self._pose(one.attrib)
                frame = rotation @ turned, rotation @ moved + position
                self._add_geoms(one, one.get("childclass", of_class), name, *frame)
            elif one.tag == "geom":
                try:
                    given = _over(self._of_class(one.get("class", of_class))[0], one.attrib)
                    piece = self._piece(given, rotation, position)
                except (ValueError, IndexError) as error:
                    self.left_out.append(f"a geom of {name}: {error}")
                    continue
                is_shown = int(_numbers(given.get("group"), (0,), 1)[0]) < _GROUPS_SHOWN
                self.pieces.setdefault(name, []).append((is_shown, piece))
            elif one.tag in ("replicate", "composite", "flexcomp", "attach"):
                self.left_out.append(f"a {one.tag} of {name}, which is not read")

    def _piece(self, given: Mapping[str, str], rotation: Floats, position: Floats) -> Piece:
        kind, size = given.get("type", "sphere"), _numbers(given.get("size"), ())
        turned, moved = self._pose(given)
        if "fromto" in given and kind in _PRIMITIVES and kind != "sphere":
            ends = _numbers(given["fromto"], (), 6).reshape(2, 3)
            along = ends[0] - ends[1]
            half = np.array([np.linalg.norm(along) / 2])
            moved, turned = ends.mean(axis=0), _towards(along)
            size = np.concatenate([size[:1], half] if kind in ("capsule", "cylinder") else [size[[0, 0]], half])
        at = rotation @ turned, rotation @ moved + position
        if kind == "mesh" and given.get("mesh") in self.meshes:
            return self._mesh_piece(self.meshes[given["mesh"]], *at)
        if kind not in _PRIMITIVES or "mesh" in given:
            raise ValueError(f"a {kind:.40} of {given.get('mesh', 'no mesh'):.40} is not read")
        return Piece(_primitive(kind, size), *at)

    def _mesh_piece(self, mesh: Mapping[str, str], rotation: Floats, position: Floats) -> Piece:
        scales, refpos = (_numbers(mesh.get(key), (each,) * 3, 3) for key, each in (("scale", 1.0), ("refpos", 0.0)))
        matrix = rotation * scales @ _quaternion(_numbers(mesh.get("refquat"), (1, 0, 0, 0), 4)).T
        at = matrix, position - matrix @ refpos
        if (file := mesh.get("file")) is not None:
            return Piece(self._file(file), *at)
        vertices = _numbers(mesh.get("vertex"), ()).reshape(-1, 3)
        if len(vertices) < 4:
            raise ValueError("its mesh has neither a file nor four vertices")
        if "face" not in mesh:
            return Piece(hull(vertices), *at)
        faces = _numbers(mesh["face"], ()).reshape(-1, 3).astype(np.intp)
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ValueError(f"a face has a vertex that is not among the {len(vertices)} vertices")
        return Piece((vertices, faces), *at)

    def _file(self, name: str) -> str:
        return str(Path(self.folder, Path(name).name if self.strips == "true" else name))

    def _pose(self, given: Mapping[str, str]) -> tuple[Floats, Floats]:
        """Rotation and position of a geom or frame."""
        position, unit = _numbers(given.get("pos"), (0, 0, 0), 3), np.pi / 180 if self.in_degrees else 1.0
        if "euler" in given:  # small letters turn about axes that turn along, in scipy about fixed ones
            angles = _numbers(given["euler"], (), 3) * unit
            return Rotation.from_euler(self.sequence.swapcase(), angles).as_matrix(), position
        if "axisangle" in given:
            *axis, angle = _numbers(given["axisangle"], (), 4)
            return Rotation.from_rotvec(np.array(axis) / np.linalg.norm(axis) * angle * unit).as_matrix(), position
        if "xyaxes" in given:
            axes = _numbers(given["xyaxes"], (), 6).reshape(2, 3)
            turned, _ = Rotation.align_vectors(axes, np.eye(3)[:2], weights=[np.inf, 1.0])
            return turned.as_matrix(), position
        if "zaxis" in given:
            return _towards(_numbers(given["zaxis"], (), 3)), position
        return _quaternion(_numbers(given.get("quat"), (1, 0, 0, 0), 4)), position


def _over(above: dict[str, str], own: Mapping[str, str]) -> dict[str, str]:
    """The attributes of a default class below those of a geom or mesh: one orientation, and sizes number by number."""
    kept = {key: value for key, value in above.items() if key not in _TURNS or _TURNS.isdisjoint(own)}
    sizes = [each["size"].split() for each in (own, above) if "size" in each]
    return {**kept, **own, **({"size": " ".join(sizes[0] + sizes[1][len(sizes[0]) :])} if len(sizes) == 2 else {})}


def _quaternion(numbers: Floats) -> Floats:
    """The rotation of a quaternion, w first."""
    return Rotation.from_quat(np.roll(numbers, -1)).as_matrix()


def _towards(direction: Floats) -> Floats:
    """The smallest rotation that turns the z axis into a direction, about the x axis into the opposite one."""
    if direction[2] < 0 and not direction[:2].any():
        return np.diag([1.0, -1.0, -1.0])
    return Rotation.align_vectors([direction], [(0.0, 0.0, 1.0)])[0].as_matrix()
