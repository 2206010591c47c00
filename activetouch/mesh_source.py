"""Mesh files as people name them: ``mug.obj``, ``mug.obj@0.001`` with metres per unit, ``cup=path/model.obj``.

>>> MeshSource.parse("cup=scans/model.obj@0.0254")
MeshSource(path=PosixPath('scans/model.obj'), scale=0.0254, name='cup', part='')

A URDF or MJCF file stands for its links or bodies, one of which is ``robot.urdf#palm``.
"""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from statistics import median_low
from typing import TYPE_CHECKING

from activetouch.errors import BadMesh, DuplicateShape, MeshWarning, warn_of
from activetouch.robot_file import ROBOTS, is_robot, mesh_paths, read_link, read_robot
from activetouch.solids.mesh import Mesh
from activetouch.solids.mesh_file import ENDINGS, OTHERS, why_not
from activetouch.solids.sizes import unlike_others
from activetouch.solids.solid import require_size
from belief.errors import InvalidArgument
from belief.files import plain_number

if TYPE_CHECKING:
    from activetouch.solids.solid import Shape

_SEPARATORS = {"/", os.sep}


@dataclass(frozen=True)
class MeshSource:
    """A mesh file, metres per unit of it, the label of its shape, a link of a robot, and the folder it was found in."""

    path: Path
    scale: float | None = None
    name: str = ""
    part: str = ""
    folder: Path | None = field(default=None, repr=False)

    @classmethod
    def parse(cls, text: Path | str) -> MeshSource:
        """The source ``[name=]path[@scale]``; a path that exists is taken as it is, whatever signs it contains."""
        path, scale = str(text), None
        before, sign, after = path.rpartition("@")
        if sign and not os.path.lexists(path) and not _SEPARATORS & set(after):
            try:
                path, scale = before, plain_number(after)
            except ValueError as error:
                if os.path.isfile(before):
                    raise InvalidArgument(
                        f"{text}: after @ there must be metres per unit, such as 0.001 for millimetres, got {after!r}"
                    ) from error
            if scale is not None and not 0.0 < scale < inf:
                raise InvalidArgument(f"{text}: the scale must be positive and finite, got {after}")
        name, sign, after = path.partition("=")
        if not sign or _SEPARATORS & set(name) or os.path.lexists(path):
            name, after = "", path
        file, _, part = after.partition("#")
        if os.path.lexists(after) or Path(file).suffix.lower() not in ROBOTS:
            file, part = after, ""
        return cls(Path(file), scale, name, part)

    def __str__(self) -> str:
        """The text that :meth:`parse` reads."""
        scale = "" if self.scale is None else f"@{self.scale!r}"
        part = f"#{self.part}" if self.part else ""
        return (f"{self.name}=" if self.name else "") + str(self.path) + part + scale

    @property
    def label(self) -> str:
        """The name, or that of the link or the file."""
        return self.name or self.part or self.path.stem

    @property
    def within(self) -> Path:
        """The file, or a link as a file in a folder that has the name of its robot."""
        return self.path.with_suffix("") / self.part if self.part else self.path

    def read(self, scale: float | None = None) -> Mesh:
        """The mesh; ``scale`` is for a source without its own. See :meth:`Mesh.from_file`."""
        scale = scale if self.scale is None else self.scale
        if self.part or is_robot(self.path):
            return read_link(self.path, self.folder or self.path.parent, self.part, 1.0 if scale is None else scale)
        return Mesh.from_file(self.path, scale)

    def links(self) -> tuple[list[MeshSource], set[Path], list[str]]:
        """The links of a robot, or the source itself; the mesh files they name; and lines on what is left out."""
        if self.part or not is_robot(self.path):
            return [self], set(), []
        try:
            robot = read_robot(self.path)
        except (BadMesh, OSError):
            return [self], set(), []  # reading it raises again
        names = {
            name: "" if not self.name else self.name if len(robot.pieces) == 1 else f"{self.name}/{name}"
            for name in robot.pieces
        }
        named = {_real(path) for path in mesh_paths(self.path, self.folder or self.path.parent, robot)}
        lines = robot.left_out if robot.pieces else [*robot.left_out, "it has no links or bodies with geometry"]
        return (
            [replace(self, name=names[part], part=part) for part in robot.pieces],
            named,
            [_left_out(self.path, line) for line in lines],
        )


def read_meshes(*sources: Path | str, scale: float | None = None) -> dict[str, Mesh]:
    """Read mesh files; their names are labels of shapes, as for ``Scene(shapes=read_meshes("a.obj", "b.stl@0.001"))``.

    Files with the same name, such as ``mug/model.obj`` and ``box/model.obj``, are called like their folders; where
    these do not tell them apart, with their endings, such as ``mug.obj`` and ``mug.stl``, or with their paths.

    Args:
        sources: each ``[name=]path[@scale]``, see :class:`MeshSource`; a folder stands for all mesh files in it. URDF
            and MJCF files stand for their links and bodies, and in a folder for the mesh files that they name.
        scale: metres per unit of all files that have no scale of their own.

    Raises:
        DuplicateShape: two meshes have the same name.
        FileNotFoundError, BadMesh, InvalidArgument: see :meth:`Mesh.from_file`; of the files in a folder, only if none
            of them can be read.

    Warns:
        MeshWarning: see :meth:`Mesh.from_file`; or a file in a folder is left out, and why.
    """
    for source in sources:
        if not isinstance(source, Path | str):
            raise InvalidArgument(f"meshes are given one by one, read_meshes(*files); got {source!r:.80}")
    found, left_out = read_files(*sources, scale=scale)
    warn_of_files(left_out)
    return found


def read_objects(objects: Mapping[str, Shape | Path | str] | Sequence[Path | str] | Path) -> dict[str, Shape]:
    """Shapes by label: as given, with mesh files read, or the meshes that :func:`read_meshes` reads."""
    given = [objects] if isinstance(objects, Path | str) else objects
    if isinstance(given, Mapping):
        if unnamed := [label for label in given if not isinstance(label, str) or not label]:
            raise InvalidArgument(f"labels of objects must be texts, got {unnamed[0]!r:.80}")
        files = (Path, str)
        found = {
            label: replace(MeshSource.parse(one), name=label).read() if isinstance(one, files) else one
            for label, one in given.items()
        }
        for label, solid in found.items():
            if hasattr(solid, "bounding_radius"):  # a scene says what is missing of others
                require_size(label, solid.bounding_radius)
        return found
    if not isinstance(given, Sequence):
        raise InvalidArgument(f"objects are shapes or mesh files by label, or mesh files; got {objects!r:.80}")
    return dict(read_meshes(*given))


def read_files(
    *sources: Path | str, scale: float | None = None, is_lenient: bool = False
) -> tuple[dict[str, Mesh], list[str]]:
    """The meshes of :func:`read_meshes`, and a line on each file left out; with ``is_lenient``, on named ones, too."""
    labelled, left_out = labelled_sources(*sources)
    found: dict[str, Mesh] = {}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", MeshWarning)
        for label, source in labelled.items():
            try:
                found[label] = source.read(scale)
            except (BadMesh, OSError) as error:
                if not (source.folder is not None or (is_lenient and isinstance(error, BadMesh))):
                    raise
                left_out.append(_left_out(source.path, str(error)))
    if left_out and not found:
        reasons = "".join(f"\n- {line}" for line in _first(left_out, 3))
        raise InvalidArgument(f"no mesh could be read from {', '.join(map(str, sources))}:{reasons}")
    remarks = [str(one.message) for one in said if issubclass(one.category, MeshWarning)]
    warn_of_files([*remarks, *_unlike({labelled[label].path: mesh for label, mesh in found.items()})])
    for one in said:
        if not issubclass(one.category, MeshWarning):
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    return found, left_out


def _real(path: Path) -> Path:
    """The file that links lead to; the path itself where they lead in a circle, which the reader says."""
    return Path(os.path.realpath(path))


def _unlike(meshes: Mapping[Path, Mesh]) -> list[str]:
    """Lines on files whose body is far larger or smaller than most; links of robots have their sizes."""
    files = {path: mesh for path, mesh in meshes.items() if not is_robot(path)}
    usual = median_low([mesh.bounding_radius for mesh in files.values()] or [1.0])
    said = {path: unlike_others(mesh.bounding_radius, usual, mesh.unit) for path, mesh in files.items()}
    return [f"{path}: {line}" for path, line in said.items() if line]


def warn_of_files(lines: Sequence[str]) -> None:
    """Warn with the first ten lines about mesh files."""
    for line in _first(lines, 10):
        warn_of(line, MeshWarning)


def _first(lines: Sequence[str], most: int) -> Sequence[str]:
    return lines if len(lines) <= most else [*lines[:most], f"and {len(lines) - most} more files"]


def labelled_sources(*sources: Path | str) -> tuple[dict[str, MeshSource], list[str]]:
    """Mesh files by the labels of :func:`read_meshes`, before they are read, and lines on others in their folders."""
    found, left_out = list[MeshSource](), list[str]()
    for source in map(MeshSource.parse, sources):
        if not _is_utf8(source.path):
            raise InvalidArgument(_left_out(source.path, _NOT_UTF8))
        if not source.path.is_dir():
            links, _, lines = source.links()
            found += links
            left_out += lines
            continue
        seen, lines, named = dict[Path, Path](), list[str](), set[Path]()
        links = []
        for path in sorted(_in_folder(source.path), key=lambda path: not is_robot(path)):
            if reason := _refused(path, seen):
                lines.append(_left_out(path, reason))
            elif (file := _real(path)) not in named:
                seen[file] = path
                some, meshes, said = replace(source, path=path, folder=source.path).links()
                links += some
                named |= meshes
                lines += said
        if not links:
            reasons = "".join(f"\n- {line}" for line in _first(lines, 3))
            raise InvalidArgument(f"there is no mesh file in {source.path}; they end in {', '.join(ENDINGS)}{reasons}")
        found += sorted(links, key=lambda link: link.path)
        left_out += lines
    return dict(zip(_labels(found), found, strict=True)), left_out


_NOT_UTF8 = "its name is not UTF-8; rename it"


def _is_utf8(path: Path) -> bool:
    try:
        return bool(str(path).encode())
    except UnicodeEncodeError:
        return False


def _left_out(path: Path, reason: str) -> str:
    """The line about a file that is left out; name or path of the file are cut from the front of the reason."""
    for name in (str(path), path.name):
        reason = reason.removeprefix(name).removeprefix(":").strip()
    return f"{os.fsencode(path).decode('utf-8', 'backslashreplace')} is left out: {reason}"


def _in_folder(folder: Path) -> list[Path]:
    """Mesh files of all formats in a folder and its subfolders, and subfolders that are links or cannot be opened."""
    files, closed = list[Path](), list[OSError]()
    for parent, folders, names in os.walk(folder, onerror=closed.append):
        files += [Path(parent, name) for name in names if Path(name).suffix.lower() in (*ENDINGS, *OTHERS)]
        files += [path for name in names if is_robot(path := Path(parent, name))]
        files += [Path(parent, name) for name in folders if Path(parent, name).is_symlink()]
    return sorted(files + [Path(error.filename) for error in closed])


def _refused(path: Path, seen: Mapping[Path, Path]) -> str | None:
    """Why a file in a folder is left out before it is read; None if it is read."""
    if not _is_utf8(path):
        return _NOT_UTF8
    if not path.exists():
        return f"it is a link to {os.readlink(path)}, which does not exist"
    if path.is_dir():
        return "it is a link to a folder; name that, too" if path.is_symlink() else "this folder cannot be opened"
    if (reason := why_not(path)) is not None:
        return reason
    if (same := seen.get(_real(path))) is not None:
        return f"it is the same file as {same}"
    return None


def _labels(sources: Sequence[MeshSource]) -> list[str]:
    """The labels of mesh files: their names, or for files of one name the shortest that tell them apart."""
    files = [source.within for source in sources if not source.name]
    if again := [path for path, number in Counter(map(_real, files)).items() if number > 1]:
        file = next(path for path in files if _real(path) == again[0])
        raise DuplicateShape(
            f"{file} is given twice, and meshes must have other names than each other; write for example "
            f"my_{file.stem}={file}"
        )
    labels = [source.label for source in sources]
    for stem in [label for label, number in Counter(labels).items() if number > 1]:
        rows = [row for row, source in enumerate(sources) if not source.name and source.label == stem]
        taken = {labels[row] for row in {*range(len(labels))} - {*rows}}
        for names in _longer([sources[row].within for row in rows], any(sources[row].part for row in rows)):
            if len({*names}) == len(names) and taken.isdisjoint(names):
                for row, name in zip(rows, names, strict=True):
                    labels[row] = name
                break
    if twice := [label for label, number in Counter(labels).items() if number > 1]:
        raise DuplicateShape(
            f"meshes must have other names than {', '.join(twice)}, which two of them have; write for example "
            f"my_{twice[0]}={sources[labels.index(twice[0])].path}"
        )
    return labels


def _longer(paths: Sequence[Path], has_links: bool) -> Iterator[list[str]]:
    """Names of files: of their folders, with their endings, and with more and more of their paths."""
    parts = [Path(os.path.abspath(path)).parts for path in paths]
    if not has_links:
        yield [each[-2] for each in parts]
        yield [each[-1] for each in parts]
    for depth in range(2, max(map(len, parts)) + 1):
        names = ["/".join(each[-depth:]) for each in parts]
        yield [os.path.splitext(name)[0] for name in names]
        yield names
