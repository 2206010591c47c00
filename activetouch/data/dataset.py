"""Recorded touches of many objects, split by object, in small shards that survive a killed run.

A :class:`CollectionPlan` says how many objects each split has. Every object is touched in every pose, round after
round, and draws from a generator keyed by (seed, split, object), so a shard's bytes depend on plan and scene alone: not
on how many processes ran, nor on what was interrupted. An object is in one split only; nothing is ever split by image.

Where a press does not settle, another object of the shape takes the place of the one that was pressed (decision 0003).
A shard is read as arrays of numbers only, never unpickled, and is used only if it is sound and holds the touches that
the plan puts there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from activetouch.data.manifest import SPLITS, CollectionPlan, Manifest, read_manifest, shard_path
from activetouch.errors import LabelMismatch, UnstablePress
from activetouch.scene import Scene, WorldObject
from belief.errors import CorruptFile, UnknownName
from belief.files import atomic_path, read_npz, require_regular_file
from belief.seeding import keyed_rng

T = TypeVar("T")
_BODY = ("rests", "orientations", "sizes", "offsets", "frictions", "stiffnesses")
_WIDTHS = {"rests": (4,), "orientations": (4,), "offsets": (2,)}  # of a column's rows; else one number
_NUMBERS: dict[str, np.dtype[Any]] = dict.fromkeys(("shapes", "object_ids", "poses"), np.dtype(np.int64))
_NUMBERS |= dict.fromkeys(("forces", "depths", *_BODY), np.dtype(np.float64))
_HEADERS = 2**16  # of all arrays of a shard together, at most [bytes]
_MOST_DRAWS = 10  # of objects for one place; one fails in a few hundred where this was met at all


def _unknown() -> NDArray[np.float64]:
    """Stands for a column that is not given."""
    return np.array(np.nan)


@dataclass(frozen=True, eq=False)
class TouchSet:
    """N touches, and what is known about the body that was touched.

    Attributes:
        images: ``(N, H, W)`` or ``(N, H, W, 3)`` uint8.
        shapes: shape index of the touched object, ``(N,)``.
        object_ids: which object was touched, ``(N,)``.
        poses: pose index, ``(N,)``.
        forces: normal force in the pause [N], ``(N,)``.
        depths: indentation of the deepest taxel [m], ``(N,)``.
        rests: orientation in which the object lies on its guide, unit quaternions ``wxyz``, ``(N, 4)``.
        orientations: the same after the pose has turned it, as the pad meets it, ``(N, 4)``.
        sizes: size factor of the object, ``(N,)``.
        offsets: of the object's centre from the approach axis, along y and z [m], ``(N, 2)``.
        frictions: friction coefficient of the object, ``(N,)``.
        stiffnesses: of the object's skin together with the pad's layer, relative to the layer's alone, ``(N,)``.

    The last six are NaN where they are not given: touches from elsewhere come without them.
    """

    images: NDArray[np.uint8]
    shapes: NDArray[np.int64]
    object_ids: NDArray[np.int64]
    poses: NDArray[np.int64]
    forces: NDArray[np.float64]
    depths: NDArray[np.float64]
    rests: NDArray[np.float64] = field(default_factory=_unknown)
    orientations: NDArray[np.float64] = field(default_factory=_unknown)
    sizes: NDArray[np.float64] = field(default_factory=_unknown)
    offsets: NDArray[np.float64] = field(default_factory=_unknown)
    frictions: NDArray[np.float64] = field(default_factory=_unknown)
    stiffnesses: NDArray[np.float64] = field(default_factory=_unknown)

    def __post_init__(self) -> None:
        for name in _BODY:
            if np.ndim(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.full((len(self.images), *_WIDTHS.get(name, ())), np.nan))

    def select(self, rows: NDArray[np.bool_] | NDArray[np.integer]) -> TouchSet:
        """Some of the touches, by mask or by index."""
        return TouchSet(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})

    @classmethod
    def join(cls, parts: Sequence[TouchSet]) -> TouchSet:
        """The touches of several sets, in turn."""
        columns = cls.__dataclass_fields__
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in columns})


def object_rng(plan: CollectionPlan, split: str, number: int, draw: int = 0) -> np.random.Generator:
    """The generator that one object of a collection, and all touches of it, draw from.

    Args:
        plan: of the collection.
        split: the object is in.
        number: of the object in its split.
        draw: how many objects were drawn for this number before, and could not be pressed.
    """
    return keyed_rng([plan.seed, SPLITS.index(split), number, draw], is_fixed_length=True)


def touches_of(scene: Scene, plan: CollectionPlan, split: str, objects: range) -> TouchSet:
    """Touch each object in every pose, in as many rounds as planned: a shard.

    An object with a press that does not settle is replaced, all its touches with it.

    Args:
        scene: to press in.
        plan: of the collection.
        split: of the objects.
        objects: their numbers.

    Raises:
        UnstablePress: objects drawn one after the other for the same place could not be pressed.
    """
    rows = [row for number in objects for row in touch_object(scene, plan, split, number, _touch)]
    return TouchSet(*map(np.stack, zip(*rows, strict=True)))


def write_shard(touches: TouchSet, split: str, path: Path) -> None:
    """Write a shard of a split, atomically."""
    arrays = {name: getattr(touches, name) for name in TouchSet.__dataclass_fields__}
    with atomic_path(path) as temporary:
        np.savez(temporary, **arrays, split=np.array(SPLITS.index(split)))


def touch_object(
    scene: Scene,
    plan: CollectionPlan,
    split: str,
    number: int,
    touch: Callable[[Scene, WorldObject, int, int, np.random.Generator], T],
) -> list[T]:
    """The result of ``touch`` for each touch of an object of a plan, or of the next one drawn for its place.

    Its arguments are scene, object, number of the object, pose and generator; see :func:`touches_of`.
    """
    poses = list(range(len(scene.poses))) * plan.repeats
    shape = number % len(scene.shapes)
    for draw in range(_MOST_DRAWS):
        rng = object_rng(plan, split, number, draw)
        obj = scene.sample_object(shape, rng)
        try:
            return [touch(scene, obj, number, pose, rng) for pose in poses]
        except UnstablePress as error:
            last = error
    raise UnstablePress(
        f"{_MOST_DRAWS} objects of the shape {scene.shape_labels[shape]!r} in turn had a press that did not settle, "
        f"among {len(poses)} each, so this scene cannot be collected. The last one: {last}"
    ) from last


def _touch(scene: Scene, obj: WorldObject, number: int, pose: int, rng: np.random.Generator) -> tuple[object, ...]:
    """One touch as a row of a shard, without the contact, so that its large arrays can be used again."""
    pressed = scene.press(obj, pose, rng, attempts=1)
    contact, placed = pressed.contact, pressed.placement
    felt = (pressed.image, obj.shape_index, number, pose, contact.force, contact.depth)
    return *felt, obj.orientation, placed.orientation, placed.scale, placed.offset, placed.friction, placed.stiffness


def read_split(folder: Path, split: str) -> TouchSet:
    """All touches of one split.

    Raises:
        CorruptFile: the folder holds no such shards, or one of them is damaged or foreign.
        LabelMismatch: shapes or poses of a shard are not the planned ones.
        UnknownName: there is no such split.
    """
    if split not in SPLITS:
        raise UnknownName("split", split, list(SPLITS))
    manifest = read_manifest(folder)
    shards = [(shard, objects) for name, shard, objects in manifest.shards() if name == split]
    if not shards:
        raise CorruptFile(f"{folder} was planned without any {split} objects; collect into another folder, with some")
    missing = [shard for shard, _ in shards if not shard_path(folder, split, shard).exists()]
    if missing:
        raise CorruptFile(
            f"{len(missing)} of {len(shards)} shards are missing in {folder / split}; finish the collection with the "
            "command or program that began it"
        )
    per_object = manifest.touches_per_object
    columns = {name: np.empty(*kind) for name, kind in _columns(manifest, shards[-1][1].stop * per_object).items()}
    for shard, objects in shards:
        touches = read_shard(folder, manifest, split, shard, objects)
        for name, column in columns.items():
            column[objects.start * per_object : objects.stop * per_object] = getattr(touches, name)
    return TouchSet(**columns)


def _columns(manifest: Manifest, number: int) -> dict[str, tuple[tuple[int, ...], np.dtype[Any]]]:
    """Shape and type of the columns of so many touches, by name."""
    images = (number, *manifest.image_shape), np.dtype(np.uint8)
    return {"images": images, **{name: ((number, *_WIDTHS.get(name, ())), kind) for name, kind in _NUMBERS.items()}}


def read_shard(folder: Path, manifest: Manifest, split: str, shard: int, objects: range) -> TouchSet:
    """One shard of a collection.

    Raises:
        CorruptFile: it is damaged, or holds other touches than the plan puts there.
        LabelMismatch: its shapes or poses are not the planned ones.
    """
    path, per_object = shard_path(folder, split, shard), manifest.touches_per_object
    number, remedy = len(objects) * per_object, "Delete it and record it again, with the command that began it"
    planned = _columns(manifest, number)
    size = sum(math.prod(shape) * dtype.itemsize for shape, dtype in planned.values())
    try:
        found, _ = read_npz(require_regular_file(path), size + _HEADERS)
    except Exception as error:  # readers of zip and npy raise a dozen kinds on damaged bytes, and all mean this
        raise CorruptFile(f"{path} is truncated or damaged ({error}). {remedy}") from error
    for name, (shape, dtype) in planned.items():
        if (column := found.get(name)) is None or column.shape != shape or column.dtype != dtype:
            given = "missing" if column is None else f"{column.shape} {column.dtype}"
            raise CorruptFile(
                f"{path} is not of this collection: its {name} are {given}, the plan and the scene make them {shape} "
                f"{dtype}. {remedy}"
            )
    touches, index = TouchSet(**{name: found[name] for name in planned}), SPLITS.index(split)
    if not np.array_equal(touches.object_ids, np.repeat(objects, per_object)) or found.get("split", index) != index:
        ids = touches.object_ids
        raise CorruptFile(
            f"{path} is not the shard of that name: it holds objects {ids.min()} to {ids.max()} of "
            f"{SPLITS[int(found.get('split', index))]}, the plan puts {objects.start} to {objects.stop - 1} of {split} "
            f"there, {per_object} touches of each. {remedy}"
        )
    poses = np.tile(np.arange(len(manifest.pose_labels)), len(objects) * manifest.plan.repeats)
    for name, numbers in {"shapes": touches.object_ids % len(manifest.shape_labels), "poses": poses}.items():
        if (wrong := np.flatnonzero(getattr(touches, name) != numbers)).size:
            raise LabelMismatch(
                f"{path} has wrong labels: {wrong.size} of {len(numbers)} {name} are not the planned ones, first that "
                f"of object {touches.object_ids[wrong[0]]}. {remedy}"
            )
    return touches
