"""Recorded touches of many objects, split by object, in small shards that survive a killed run.

A :class:`CollectionPlan` says how many objects each split has. Every object is touched once in every pose and
draws from a generator keyed by (seed, split, object), so a shard's bytes depend on the plan alone: not on how
many processes ran, nor on what was interrupted. An object is in one split only; nothing is ever split by image.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.atomic import atomic_path
from activetouch.errors import CorruptFile, LabelMismatch
from activetouch.scene import Scene

SPLITS = ("train", "calibration", "test")
_OBJECTS_PER_SHARD = 48


@dataclass(frozen=True)
class CollectionPlan:
    """How many objects to touch, each in every pose.

    Attributes:
        train, calibration, test: objects *per shape* in each split.
        seed: of the whole collection.
    """

    train: int = 2700
    calibration: int = 300
    test: int = 500
    seed: int = 0

    def shards(self, num_shapes: int) -> Iterator[tuple[str, int, range]]:
        """The shards to record: (split, shard number, object numbers)."""
        for split in SPLITS:
            total = getattr(self, split) * num_shapes
            for shard, first in enumerate(range(0, total, _OBJECTS_PER_SHARD)):
                yield split, shard, range(first, min(first + _OBJECTS_PER_SHARD, total))


@dataclass(frozen=True, eq=False)
class TouchSet:
    """Touches of one split, N of them.

    Attributes:
        images: ``(N, H, W)`` or ``(N, H, W, 3)`` uint8.
        shapes: shape index of the touched object, ``(N,)``.
        object_ids: which object was touched, ``(N,)``.
        poses: pose index, ``(N,)``.
        forces: normal force in the pause [N], ``(N,)``.
        depths: indentation of the deepest taxel [m], ``(N,)``.
    """

    images: NDArray[np.uint8]
    shapes: NDArray[np.int64]
    object_ids: NDArray[np.int64]
    poses: NDArray[np.int64]
    forces: NDArray[np.float64]
    depths: NDArray[np.float64]


def shard_path(folder: Path, split: str, shard: int) -> Path:
    """Where a shard lives."""
    return folder / split / f"{shard:05d}.npz"


def record_shard(scene: Scene, plan: CollectionPlan, split: str, objects: range, path: Path) -> None:
    """Touch each object once in every pose and write the shard, atomically."""
    images, rows = [], []
    for number in objects:
        rng = np.random.default_rng([plan.seed, SPLITS.index(split), number])
        thing = scene.sample_object(number % len(scene.shapes), rng)
        for pose in range(len(scene.poses)):
            contact, image = scene.press(thing, pose, rng)
            images.append(image)
            rows.append((thing.shape_index, number, pose, contact.force, contact.depth))
    shapes, object_ids, poses, forces, depths = (np.array(column) for column in zip(*rows, strict=True))
    with atomic_path(path) as temporary:
        np.savez(
            temporary,
            images=np.stack(images),
            shapes=shapes,
            object_ids=object_ids,
            poses=poses,
            forces=forces,
            depths=depths,
        )


def write_manifest(folder: Path, scene: Scene, plan: CollectionPlan) -> None:
    """Record what the folder holds.

    Raises:
        LabelMismatch: the folder already holds touches of another plan or scene.
    """
    import mujoco

    manifest = {
        "plan": asdict(plan),
        "mujoco_version": mujoco.__version__,
        "shape_labels": list(scene.shape_labels),
        "pose_labels": list(scene.pose_labels),
        "symmetry": scene.symmetry,
        "scene": repr(scene),
    }
    path = folder / "manifest.json"
    if path.exists():
        found = json.loads(path.read_text())
        if found != manifest:
            differing = [key for key in manifest if found.get(key) != manifest[key]]
            raise LabelMismatch(
                f"{folder} holds a collection with other {', '.join(differing)}. Choose another folder, "
                "or delete this one to record it anew."
            )
        return
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(manifest, indent=2) + "\n")


def read_manifest(folder: Path) -> dict[str, Any]:
    """What a folder of touches holds: plan, labels, scene, MuJoCo version.

    Raises:
        CorruptFile: there is no readable manifest.
    """
    try:
        return json.loads((folder / "manifest.json").read_text())
    except (OSError, ValueError) as error:
        raise CorruptFile(
            f"{folder} holds no collection ({error}); record one with: activetouch collect --out {folder}"
        ) from error


def read_split(folder: Path, split: str) -> TouchSet:
    """All touches of one split.

    Raises:
        CorruptFile: the folder holds no such shards, or one of them is damaged.
    """
    manifest = read_manifest(folder)
    plan = CollectionPlan(**manifest["plan"])
    shards = plan.shards(len(manifest["shape_labels"]))
    paths = [shard_path(folder, split, shard) for name, shard, _ in shards if name == split]
    missing = [path for path in paths if not path.exists()]
    if missing:
        raise CorruptFile(
            f"{len(missing)} of {len(paths)} shards are missing in {folder / split}; finish the collection with: "
            f"activetouch collect --out {folder}"
        )
    columns: dict[str, list[NDArray]] = {name: [] for name in TouchSet.__dataclass_fields__}
    for path in paths:
        try:
            with path.open("rb") as file, np.load(file) as shard:  # allow_pickle is off: arrays only
                for name, parts in columns.items():
                    parts.append(shard[name])
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise CorruptFile(f"{path} is damaged ({error}); delete it and collect again") from error
    return TouchSet(**{name: np.concatenate(parts) for name, parts in columns.items()})
