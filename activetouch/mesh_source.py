"""Mesh files as people name them: ``mug.obj``, ``mug.obj@0.001`` with metres per unit, ``cup=path/model.obj``.

>>> MeshSource.parse("cup=scans/model.obj@0.0254")
MeshSource(path=PosixPath('scans/model.obj'), scale=0.0254, name='cup')
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from activetouch.errors import DuplicateShape
from activetouch.solids.mesh import Mesh
from activetouch.solids.mesh_file import ENDINGS
from belief.errors import InvalidArgument
from belief.files import plain_number

if TYPE_CHECKING:
    from activetouch.solids.solid import Shape

_SEPARATORS = {"/", os.sep}


@dataclass(frozen=True)
class MeshSource:
    """A mesh file, its scale and its name.

    Attributes:
        path: the file.
        scale: metres per unit of the file; by default that of :meth:`Mesh.from_file`.
        name: label of the shape; by default the name of the file without its ending.
    """

    path: Path
    scale: float | None = None
    name: str = ""

    @classmethod
    def parse(cls, text: Path | str) -> MeshSource:
        """The source ``[name=]path[@scale]``; a path that exists is taken as it is, whatever signs it contains.

        Raises:
            InvalidArgument: the scale is not positive and finite, or what follows the ``@`` of a file that exists is no
                number.
        """
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
            return cls(Path(path), scale)
        return cls(Path(after), scale, name)

    def __str__(self) -> str:
        """The text that :meth:`parse` reads."""
        scale = "" if self.scale is None else f"@{self.scale!r}"
        return (f"{self.name}=" if self.name else "") + str(self.path) + scale

    @property
    def label(self) -> str:
        """The name, or that of the file."""
        return self.name or self.path.stem

    def read(self, scale: float | None = None) -> Mesh:
        """The mesh; ``scale`` is for a source without its own. See :meth:`Mesh.from_file`."""
        return Mesh.from_file(self.path, scale if self.scale is None else self.scale)


def read_meshes(*sources: Path | str, scale: float | None = None) -> dict[str, Mesh]:
    """Read mesh files; their names are labels of shapes, as for ``Scene(shapes=read_meshes("a.obj", "b.stl@0.001"))``.

    Files with the same name, such as ``mug/model.obj`` and ``box/model.obj``, are called like their folders.

    Args:
        sources: each ``[name=]path[@scale]``, see :class:`MeshSource`; a folder stands for all mesh files in it.
        scale: metres per unit of all files that have no scale of their own.

    Raises:
        DuplicateShape: two meshes have the same name.
        FileNotFoundError, BadMesh, InvalidArgument: see :meth:`Mesh.from_file`.
    """
    for source in sources:
        if not isinstance(source, Path | str):
            raise InvalidArgument(f"meshes are given one by one, read_meshes(*files); got {source!r:.80}")
    labels, parsed = mesh_labels(*sources), mesh_sources(*sources)
    return {label: source.read(scale) for label, source in zip(labels, parsed, strict=True)}


def read_objects(objects: Mapping[str, Shape | Path | str] | Sequence[Path | str] | Path) -> dict[str, Shape]:
    """Shapes by label: as given, with mesh files read, or the meshes that :func:`read_meshes` reads.

    Raises:
        InvalidArgument: neither shapes or files by label, nor files; or a label that is no text.
        DuplicateShape, FileNotFoundError, BadMesh: see :func:`read_meshes`.
    """
    given = [objects] if isinstance(objects, Path | str) else objects
    if isinstance(given, Mapping):
        if unnamed := [label for label in given if not isinstance(label, str) or not label]:
            raise InvalidArgument(f"labels of objects must be texts, got {unnamed[0]!r:.80}")
        files = (Path, str)
        return {
            label: replace(MeshSource.parse(one), name=label).read() if isinstance(one, files) else one
            for label, one in given.items()
        }
    if not isinstance(given, Sequence):
        raise InvalidArgument(f"objects are shapes or mesh files by label, or mesh files; got {objects!r:.80}")
    return dict(read_meshes(*given))


def mesh_labels(*sources: Path | str) -> list[str]:
    """The labels that :func:`read_meshes` gives to mesh files.

    Raises:
        DuplicateShape: two meshes have the same name.
        InvalidArgument: see :class:`MeshSource`.
    """
    parsed = mesh_sources(*sources)
    num = Counter(source.label for source in parsed)
    labels = [
        source.path.resolve().parent.name if not source.name and num[source.label] > 1 else source.label
        for source in parsed
    ]
    files = [source.path for source in parsed if not source.name]
    if again := [path for place, path in enumerate(files) if path.resolve() in map(Path.resolve, files[:place])]:
        raise DuplicateShape(
            f"{again[0]} is given twice, and meshes must have other names than each other; write for example "
            f"my_{again[0].stem}={again[0]}"
        )
    if twice := [label for label, number in Counter(labels).items() if number > 1]:
        raise DuplicateShape(
            f"meshes must have other names than {', '.join(twice)}, which two of them have; write for example "
            f"my_{twice[0]}={parsed[labels.index(twice[0])].path}"
        )
    return labels


def mesh_sources(*sources: Path | str) -> list[MeshSource]:
    """What texts name; in place of a folder, the mesh files in it and in its subfolders.

    Raises:
        InvalidArgument: a folder has no mesh files, or see :class:`MeshSource`.
    """
    found = list[MeshSource]()
    for source in map(MeshSource.parse, sources):
        files = [source.path]
        if source.path.is_dir():
            files = sorted(path for path in source.path.rglob("*") if path.suffix.lower() in ENDINGS)
        if not files:
            raise InvalidArgument(f"there is no mesh file in {source.path}; they end in {', '.join(ENDINGS)}")
        found += [replace(source, path=path) for path in files]
    return found
