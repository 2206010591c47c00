"""Extremes of files: truncated, foreign or changed checkpoints, observation models, shards, manifests and meshes."""

from __future__ import annotations

import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch import Quasistatic, Scene, TactileSensor
from activetouch.data.dataset import read_split, record_shard
from activetouch.data.manifest import CollectionPlan, read_manifest, shard_path, write_manifest
from activetouch.errors import BadMesh, LabelMismatch, WrongScene
from activetouch.named_scenes import SCENES
from activetouch.pressing.contact import Pad
from activetouch.sensor_files import MODELS, OBSERVATION_FILE, READER_FILE
from activetouch.shapes import Mesh
from belief.calibration import TemperatureScaling
from belief.errors import CorruptFile, UnknownName
from belief.files import atomic_path, sealed_json, unsealed_json, write_text
from tests.extremes.cases import Case, answers, equal_to, in_folder, refusals, refuses

Damage = Callable[[Path], object]
_SHIPPED = MODELS / "coarse"
_SCENE = Scene(press_model=Quasistatic(), pad=Pad(num_taxels=8))
_PLAN = CollectionPlan(train=0, calibration=1, test=1)
_BOOM = Path("activetouch-stress-was-unpickled")


class _Boom:
    """Creates a file when it is unpickled."""

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        return Path.touch, (_BOOM,)


def _flipped(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))


_DAMAGES: dict[str, Damage] = {
    "truncated": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "empty": lambda path: path.write_bytes(b""),
    "changed in one bit": _flipped,
    "a pickle": lambda path: path.write_bytes(pickle.dumps(_Boom())),
    "a text": lambda path: path.write_text("I am no file of yours\n"),
    "missing": lambda path: path.unlink(),
}


def _sensor(damage: Damage, name: str) -> Callable[[], object]:
    def load(folder: Path) -> object:
        shutil.copytree(_SHIPPED, folder / "sensor", ignore=shutil.ignore_patterns("policies"))
        damage(folder / "sensor" / name)
        try:
            return TactileSensor.load(folder / "sensor", SCENES["coarse"].scene)
        finally:
            if _BOOM.exists():
                _BOOM.unlink()
                raise AssertionError("code ran from the file")

    return in_folder(load)


def _changed(**changes: object) -> Damage:
    """Change fields of an observation model."""

    def damage(path: Path) -> None:
        path.write_text(sealed_json(unsealed_json(path.read_text()) | changes))

    return damage


def _read(images: NDArray[Any]) -> Callable[[], object]:
    return lambda: TactileSensor.shipped("coarse").read(images, [0])


def _of_sensors() -> list[Case]:
    load = "TactileSensor.load"
    other = SCENES["hard"].scene
    changes: dict[str, tuple[dict[str, object], type[Exception], str]] = {
        "an observation model of an unknown kind": ({"model": "oracle"}, CorruptFile, "unknown kind 'oracle'"),
        "an observation model of other shapes": ({"shape_labels": [*"abcd"]}, LabelMismatch, "the scene has"),
        "an observation model without shapes": ({"shape_labels": None}, CorruptFile, "no observation model"),
    }
    return [
        *(
            refuses(load, f"{file} that is {given}", _sensor(damage, file), CorruptFile, file)
            for file in (READER_FILE, OBSERVATION_FILE)
            for given, damage in _DAMAGES.items()
        ),
        *(
            refuses(load, given, _sensor(_changed(**fields), OBSERVATION_FILE), error, pattern)
            for given, (fields, error, pattern) in changes.items()
        ),
        refuses(
            load,
            "the sensor of another scene",
            lambda: TactileSensor.load(_SHIPPED, other),
            WrongScene,
            "pad.half_width is 0.0075, not 0.015",
        ),
        refuses(load, "a missing folder", lambda: TactileSensor.load(Path("nowhere"), other), CorruptFile, "nowhere"),
        *refusals(
            "TactileSensor.read",
            ValueError,
            {
                "an image of floats": (_read(np.zeros((1, 4, 4))), "uint8"),
                "an image of 7 × 7 for a network of 16 × 16": (
                    _read(np.zeros((1, 7, 7), np.uint8)),
                    "takes images of shape",
                ),
            },
        ),
        refuses(
            "TemperatureScaling.from_fields",
            "a temperature of zero",
            lambda: TemperatureScaling.from_fields({"temperature": 0.0, "status": "ok", "floor": 0.0}),
            ValueError,
            "temperature must be a finite number > 0",
        ),
    ]


def _collection(folder: Path) -> Path:
    """Record a tiny, complete collection."""
    for split, shard, objects in write_manifest(folder, _SCENE, _PLAN).shards():
        record_shard(_SCENE, _PLAN, split, objects, shard_path(folder, split, shard))
    return folder


def _shard(damage: Damage) -> Callable[[], object]:
    def read(folder: Path) -> object:
        damage(shard_path(_collection(folder), "test", 0))
        return read_split(folder, "test")

    return in_folder(read)


def _split(name: str) -> Callable[[], Any]:
    return in_folder(lambda folder: read_split(_collection(folder), name))


def _swapped(path: Path) -> None:
    shutil.copy(shard_path(path.parent.parent, "calibration", 0), path)


def _with_array(name: str, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Damage:
    """Change one array of a shard."""

    def damage(path: Path) -> None:
        with np.load(path) as found:
            arrays = dict(found)
        np.savez(path, **arrays | {name: change(arrays[name])})

    return damage


def _manifest(damage: Damage) -> Callable[[], object]:
    def read(folder: Path) -> object:
        damage(_collection(folder) / "manifest.json")
        return read_manifest(folder)

    return in_folder(read)


def _another_plan(folder: Path) -> None:
    write_manifest(_collection(folder), _SCENE, CollectionPlan(train=9))


def _of_collections() -> list[Case]:
    reversed_labels = _with_array("shapes", lambda shapes: shapes[::-1])
    pickles = _with_array("forces", lambda forces: np.array([_Boom()] * len(forces), object))
    remedy = "Delete it and record it again|finish the collection"
    return [
        *(
            refuses("read_split", f"a shard that is {given}", _shard(damage), CorruptFile, remedy)
            for given, damage in _DAMAGES.items()
        ),
        *(
            refuses("read_manifest", f"a manifest that is {given}", _manifest(damage), CorruptFile, "manifest.json")
            for given, damage in _DAMAGES.items()
        ),
        refuses(
            "read_split", "a shard of another split", _shard(_swapped), CorruptFile, "is not the shard of that name"
        ),
        refuses("read_split", "reversed labels", _shard(reversed_labels), LabelMismatch, "wrong labels"),
        refuses("read_split", "a shard of pickled objects", _shard(pickles), CorruptFile, "Object arrays cannot"),
        refuses("read_split", "a split without objects", _split("train"), CorruptFile, "planned without any train"),
        refuses("read_split", "a misspelt split", _split("tset"), UnknownName, "Did you mean 'test'"),
        refuses(
            "write_manifest",
            "a folder of another plan",
            in_folder(_another_plan),
            LabelMismatch,
            "(?i)plan|another collection",
        ),
        refuses(
            "CollectionPlan",
            "minus one object",
            lambda: CollectionPlan(train=-1),
            ValueError,
            "train must be an integer",
        ),
        refuses(
            "CollectionPlan", "a seed of 2³²", lambda: CollectionPlan(seed=2**32), ValueError, "seed must be an integer"
        ),
        answers("read_split", "one object of each shape", lambda: _split("test")().images.shape, equal_to([24, 8, 8])),
        answers("atomic_path", "an error while writing: the old file stays", in_folder(_torn), equal_to([1, 1])),
    ]


def _torn(folder: Path) -> tuple[bool, int]:
    """Whether the file has its old text, and the number of files."""
    file = folder / "it.txt"
    write_text(file, "old")
    try:
        with atomic_path(file) as temporary:
            temporary.write_text("ne")
            raise OSError("the disk is full")
    except OSError:
        pass
    return file.read_text() == "old", len(list(folder.iterdir()))


_TETRAHEDRON = ["v 0 0 0", "v .02 0 0", "v 0 .02 0", "v 0 0 .02", "f 1 3 2", "f 1 2 4", "f 2 3 4", "f 1 4 3"]


def _mesh(lines: list[str], name: str = "it.obj", scale: float = 1.0) -> Callable[[], Any]:
    def read(folder: Path) -> object:
        (folder / name).write_text("\n".join(lines) + "\n")
        return Mesh.from_file(folder / name, scale)

    return in_folder(read)


def _radius(*faces: str) -> float:
    return float(_mesh([*_TETRAHEDRON[:4], *faces])().bounding_radius)


def _of_meshes() -> list[Case]:
    corners, faces = _TETRAHEDRON[:4], _TETRAHEDRON[4:]
    inwards = ("f 1 2 3", "f 1 4 2", "f 2 4 3", "f 1 3 4")
    flat = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 1 1 0"]
    return [
        answers(
            "Mesh.from_file",
            "faces that all look inwards: turned",
            lambda: _radius(*inwards) / _radius(*faces),
            equal_to(1.0),
        ),
        *refusals(
            "Mesh.from_file",
            BadMesh,
            {
                "an empty file": (_mesh([]), "it.obj|it"),
                "corners and no faces": (_mesh(corners), "it"),
                "a hole: a face is missing": (_mesh(_TETRAHEDRON[:-1]), "(?i)closed|hole|open|watertight"),
                "all corners in one plane": (_mesh([*flat, *faces]), "(?i)volume|plane|flat"),
                "corners of NaN": (_mesh(["v nan 0 0", *_TETRAHEDRON[1:]]), "(?i)finite|nan|read"),
                "corners of 1e300": (_mesh(["v 1e300 0 0", *_TETRAHEDRON[1:]]), "it"),
                "millimetres taken for metres": (_mesh(_TETRAHEDRON, scale=1000.0), "(?i)scale"),
                "a face with a corner that does not exist": (_mesh([*_TETRAHEDRON, "f 1 2 99"]), "it"),
                "words in an STL file": (_mesh(["solid nothing"], "it.stl"), "it"),
                "a format that is not read": (_mesh(_TETRAHEDRON, "it.step"), ".stl, .obj"),
            },
        ),
        *refusals(
            "Mesh.from_file",
            ValueError,
            {
                "a scale of zero": (_mesh(_TETRAHEDRON, scale=0.0), "scale must be positive"),
                "a scale of NaN": (_mesh(_TETRAHEDRON, scale=float("nan")), "scale must be positive"),
            },
        ),
        refuses("Mesh.from_file", "no file", lambda: Mesh.from_file(Path("nowhere.stl")), FileNotFoundError, "nowhere"),
    ]


CASES: tuple[Case, ...] = (*_of_sensors(), *_of_collections(), *_of_meshes())
"""Cases of files. Unpickling one of them would create the file ``_BOOM``."""
