"""A bank of recorded touches, to learn policies without pressing objects again.

bank/manifest.json   labels, scene, source, SHA-256 of the arrays and of itself; written last
bank/logits.npy      (N, R, P, K) float32: N objects, each touched in R rounds of all P poses
bank/features.npy    (N, R, P, D) float16, optional
bank/shapes.npy      (N,) int64
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.sensor_files import INDEPENDENT_SUFFIX, MODELS
from belief.errors import CorruptFile, UnknownName
from belief.files import atomic_path, require_regular_file, sealed_json, unsealed_json, write_text
from belief.touch_batch import TouchBatch

_FORMAT = "activetouch-touch-bank-2"
MANIFEST = "manifest.json"
"""Name of a bank's manifest; a folder without it is no bank."""
SHIPPED = "bank"
"""Folder of the bank that comes with the sensor ``paper-independent``."""


@dataclass(frozen=True, eq=False)
class TouchRounds:
    """Logits of N objects, each touched in R rounds of all P poses.

    Rounds of one object and pose are exchangeable: they differ only by chance.

    Attributes:
        logits: of the classifier, ``(N, R, P, K)``.
        shapes: indices of the objects' shapes, ``(N,)``.
    """

    logits: NDArray[np.floating]
    shapes: NDArray[np.int64]

    @property
    def num_objects(self) -> int:
        """N."""
        return self.logits.shape[0]

    @property
    def num_rounds(self) -> int:
        """R."""
        return self.logits.shape[1]

    @property
    def num_poses(self) -> int:
        """P."""
        return self.logits.shape[2]


@dataclass(frozen=True, eq=False)
class TouchBank(TouchRounds):
    """Recorded touches with their labels and origin.

    Attributes:
        shape_labels, pose_labels: names of the K shapes and P poses.
        features: embeddings of the classifier, ``(N, R, P, D)``, optional.
        source: origin of the touches, for readers.
        scene: fields of their scene (:func:`activetouch.scene_description.scene_fields`), if known.

    Raises:
        ValueError: the arrays do not fit each other or the labels, or a shape has no object.
    """

    shape_labels: tuple[str, ...]
    pose_labels: tuple[str, ...]
    features: NDArray[np.floating] | None = None
    source: Mapping[str, Any] = field(default_factory=dict)
    scene: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        number, poses = len(self.shape_labels), len(self.pose_labels)
        if self.logits.ndim != 4 or self.logits.shape[2:] != (poses, number) or self.logits.size == 0:
            raise ValueError(f"logits must be (N, R, {poses}, {number}) and not empty, got {self.logits.shape}")
        if self.shapes.shape != (len(self.logits),):
            raise ValueError(f"shapes must be ({len(self.logits)},), got {self.shapes.shape}")
        if self.features is not None and self.features.shape[:3] != self.logits.shape[:3]:
            raise ValueError(f"features {self.features.shape} do not fit logits {self.logits.shape}")
        counts = np.bincount(self.shapes, minlength=number) if self.shapes.min() >= 0 else np.empty(0)
        if len(counts) != number or counts.min() == 0:
            raise ValueError(f"every shape of {list(self.shape_labels)} needs an object, got {counts.tolist()}")
        if not np.isfinite(self.logits).all():
            raise ValueError("logits must be finite")

    def batch(self, objects: NDArray[np.int64], rounds: NDArray[np.int64], poses: NDArray[np.int64]) -> TouchBatch:
        """Touches of the bank as sequences of t touches; all arguments ``(n, t)``."""
        features = None if self.features is None else np.asarray(self.features[objects, rounds, poses])
        return TouchBatch(poses, np.asarray(self.logits[objects, rounds, poses], np.float64), features)

    def save(self, folder: Path) -> None:
        """Write the bank; replace an existing one."""
        (folder / MANIFEST).unlink(missing_ok=True)
        arrays = {"logits": self.logits, "shapes": self.shapes}
        if self.features is not None:
            arrays["features"] = self.features.astype(np.float16)
        digests = {}
        for name, array in arrays.items():
            with atomic_path(folder / f"{name}.npy") as temporary:
                np.save(temporary, np.ascontiguousarray(array), allow_pickle=False)
            digests[name] = _digest(folder / f"{name}.npy")
        manifest = {
            "format": _FORMAT,
            "shape_labels": list(self.shape_labels),
            "pose_labels": list(self.pose_labels),
            "source": dict(self.source),
            "scene": None if self.scene is None else dict(self.scene),
            "arrays": digests,
        }
        write_text(folder / MANIFEST, sealed_json(manifest) + "\n")

    @classmethod
    def open(cls, folder: str | Path) -> TouchBank:
        """The bank in a folder; its arrays are memory-mapped and read-only.

        Raises:
            CorruptFile: there is no bank, or its files were changed.
        """
        try:
            folder = Path(folder)
            manifest = unsealed_json(require_regular_file(folder / MANIFEST).read_text(encoding="utf-8"))
            if manifest["format"] != _FORMAT:
                raise CorruptFile(f"{folder} is no {_FORMAT} but {manifest['format']!r}")
            if unknown := manifest["arrays"].keys() - {"logits", "shapes", "features"}:
                raise CorruptFile(f"{folder} is no {_FORMAT}: it lists the array {min(unknown)!r}")
            for name, digest in manifest["arrays"].items():
                if _digest(folder / f"{name}.npy") != digest:
                    raise CorruptFile(f"{folder / name}.npy was changed after it was written")
            arrays = {
                name: np.load(folder / f"{name}.npy", mmap_mode="r", allow_pickle=False) for name in manifest["arrays"]
            }
            labels = (tuple(manifest["shape_labels"]), tuple(manifest["pose_labels"]))
            features, source, scene = arrays.get("features"), manifest["source"], manifest["scene"]
            if not (scene is None or isinstance(scene, dict)):
                raise TypeError(f"its scene is {scene!r}")
            return cls(arrays["logits"], arrays["shapes"], *labels, features, source, scene)
        except CorruptFile:
            raise
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise CorruptFile(f"{folder} is no touch bank: {error}") from error

    @classmethod
    def shipped(cls, scene: str) -> TouchBank:
        """The bank of a scene that comes with the package, of objects that its reader was not trained on.

        Raises:
            UnknownName: there is no bank of this scene.
        """
        known = sorted(path.parent.parent.name for path in MODELS.glob(f"*/{SHIPPED}/{MANIFEST}"))
        if f"{scene}{INDEPENDENT_SUFFIX}" not in known:
            raise UnknownName("scene with a bank", scene, [name.removesuffix(INDEPENDENT_SUFFIX) for name in known])
        bank = cls.open(MODELS / f"{scene}{INDEPENDENT_SUFFIX}" / SHIPPED)
        return replace(bank, logits=np.asarray(bank.logits, np.float32))


def _digest(path: Path) -> str:
    with require_regular_file(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
