"""The description of a folder of recorded touches, in ``manifest.json``: its plan, its scene, and versions.

A collection may be finished with another NumPy, but not with another plan, scene or MuJoCo.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np

from activetouch.errors import LabelMismatch
from activetouch.scene import Scene, Symmetry
from activetouch.scene_description import in_words, scene_differences, scene_fields
from belief.codec import from_fields, to_fields
from belief.constraints import Checked, Within
from belief.errors import CorruptFile
from belief.files import require_regular_file, sealed_json, unsealed_json, write_text

SPLITS = ("train", "calibration", "test")
FORMAT = 4
# A number of two words would make the key of one object that of another object under another seed.
Word: TypeAlias = Annotated[int, Within(0, 2**32 - 1)]
_OBJECTS_PER_SHARD = 48
_DECISIVE = ("plan", "shape_labels", "pose_labels", "symmetry", "image_shape", "MuJoCo", "scene")


@dataclass(frozen=True)
class CollectionPlan(Checked):
    """Numbers of objects *per shape* in each split, each touched in every pose.

    ``repeats`` is the number of rounds of all poses for each object. One round teaches a classifier most for the time;
    only several show how far touches of one object in one pose repeat each other. The first round does not depend on
    how many follow, unless a press of a later one does not settle (decision 0003). ``seed`` is in ``[0, 2³²)``.
    """

    train: Word = 2700
    calibration: Word = 300
    test: Word = 500
    seed: Word = 0
    repeats: Annotated[int, Within(1, 2**32 - 1)] = 1

    def shards(self, num_shapes: int) -> Iterator[tuple[str, int, range]]:
        """The shards to record: (split, shard number, object numbers)."""
        for split in SPLITS:
            total = getattr(self, split) * num_shapes
            for shard, first in enumerate(range(0, total, _OBJECTS_PER_SHARD)):
                yield split, shard, range(first, min(first + _OBJECTS_PER_SHARD, total))


def shard_path(folder: Path, split: str, shard: int) -> Path:
    """The path of a shard."""
    return folder / split / f"{shard:05d}.npz"


@dataclass(frozen=True)
class Manifest:
    """The description of a collection, with the fields of its scene and the versions of the software, where known.

    ``choice`` has the command line's words for the scene, from which it can be made again; it is None if a user's
    program recorded it. ``image_shape`` is ``(H, W)`` or ``(H, W, 3)``; all images are uint8.
    """

    plan: CollectionPlan
    scene: Mapping[str, Any]
    choice: Mapping[str, Any] | None
    shape_labels: tuple[str, ...]
    pose_labels: tuple[str, ...]
    symmetry: Symmetry
    image_shape: tuple[int, ...]
    versions: Mapping[str, str]

    @classmethod
    def of(cls, scene: Scene, plan: CollectionPlan, choice: Mapping[str, Any] | None = None) -> Manifest:
        """The manifest of a collection that this machine would begin now."""
        import mujoco

        versions = {"activetouch": version("activetouch"), "mujoco": mujoco.__version__}
        versions |= {"numpy": np.__version__, "python": platform.python_version()}
        words = None if choice is None else json.loads(json.dumps(choice))
        labels = scene.shape_labels, scene.pose_labels
        return cls(plan, scene_fields(scene), words, *labels, scene.symmetry, scene.image_shape, versions)

    def shards(self) -> Iterator[tuple[str, int, range]]:
        """The shards it consists of: (split, shard number, object numbers)."""
        return self.plan.shards(len(self.shape_labels))

    @property
    def touches_per_object(self) -> int:
        """Poses times rounds."""
        return len(self.pose_labels) * self.plan.repeats

    @property
    def identity(self) -> str:
        """SHA-256 of all that decides which touches are recorded."""
        return hashlib.sha256(json.dumps(self.decisive, sort_keys=True).encode()).hexdigest()

    @property
    def decisive(self) -> dict[str, Any]:
        """All that decides which touches are recorded, by name."""
        known = {**asdict(self), "MuJoCo": self.versions["mujoco"]}
        return {name: known[name] for name in _DECISIVE}

    def to_json(self) -> str:
        """The content of ``manifest.json``, with a digest of its own."""
        return sealed_json({"format": FORMAT, **to_fields(self)}, 2) + "\n"


class NoCollection(CorruptFile):
    """A folder holds no collection."""


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a collection, from its folder or its file."""
    path = folder if folder.is_file() else folder / "manifest.json"
    try:
        found = unsealed_json(require_regular_file(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise NoCollection(f"{folder} holds no collection: {path.name} cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise _damaged(path, error) from error
    return _parse(found, path)


def write_manifest(
    folder: Path, scene: Scene, plan: CollectionPlan, choice: Mapping[str, Any] | None = None
) -> Manifest:
    """Begin a collection, or continue the one in the folder."""
    wanted = Manifest.of(scene, plan, choice)
    if not (folder / "manifest.json").exists():
        if unexplained := [path for split in SPLITS for path in (folder / split).glob("[0-9]*.npz")]:
            raise CorruptFile(
                f"{folder} holds {len(unexplained)} shards without a manifest.json, so nobody knows of which scene. "
                "Restore it from a copy, or choose another folder"
            )
        write_text(folder / "manifest.json", wanted.to_json())
        return wanted
    first = read_manifest(folder)
    mine, asked = first.decisive, wanted.decisive
    if differing := [key for key in _DECISIVE if mine[key] != asked[key]]:
        key = differing[0]
        if key == "scene":
            difference = in_words(map(str, scene_differences(first.scene, wanted.scene, surroundings=True)))
        else:
            difference = f"{mine[key]} there, {asked[key]} here"
        raise LabelMismatch(
            f"{folder} holds a collection with other {', '.join(differing)} ({key}: {difference}). Choose another "
            "folder, or delete this one to record it anew."
        )
    return first


def _parse(found: Mapping[str, Any], path: Path) -> Manifest:
    if isinstance(number := found.get("format"), int) and number != FORMAT:
        raise CorruptFile(
            f"{path} has format {number}, this version reads {FORMAT}; record the touches anew, not in {path.parent}"
        )
    try:
        manifest = from_fields(Manifest, found, is_whole=False)  # files of earlier versions have more
        if type(number) is not int or "mujoco" not in manifest.versions:
            raise ValueError("it states no format, or no version of mujoco")
    except ValueError as error:
        raise _damaged(path, error) from error
    return manifest


def _damaged(path: Path, why: object) -> CorruptFile:
    return CorruptFile(f"{path} is damaged ({why}). Restore it from a copy, or record the touches anew elsewhere")
