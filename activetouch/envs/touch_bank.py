"""A bank of recorded touches: what thousands of objects felt like, to learn from without pressing them again.

    bank/manifest.json   labels, sizes, scene, where the touches come from, SHA-256 of the arrays and of itself
    bank/logits.npy      (N, R, P, K) float32: N objects, each touched in R rounds of all P poses
    bank/features.npy    (N, R, P, D) float16, where they were kept
    bank/shapes.npy      (N,) int64

Arrays are mapped into memory, not read. The manifest is written last, so a bank is whole or is none.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import LabelMismatch
from belief.errors import CorruptFile
from belief.files import atomic_path, sealed_json, unsealed_json, write_text

if TYPE_CHECKING:
    from activetouch.envs.object_test import ObjectTestEnv

_FORMAT = "activetouch-touch-bank-2"
MANIFEST = "manifest.json"
"""Of a bank, which is whole when this file is there."""


@dataclass(frozen=True, eq=False)
class TouchBank:
    """Touches of N objects, each in R rounds of all P poses.

    Rounds of one object and pose differ in nothing but chance, so the n-th touch of a pose may be any round that was
    not used yet. What happens beyond R touches in one pose, a bank does not know.

    Attributes:
        logits: the classifier's, ``(N, R, P, K)``.
        shapes: of the objects, ``(N,)``.
        shape_labels, pose_labels: names of the K shapes and P poses.
        features: the classifier's embedding, ``(N, R, P, D)``, if kept.
        source: where the touches come from, for people.
        scene: fields of the scene they come from (:func:`activetouch.scene_description.scene_fields`), if known.

    Raises:
        ValueError: the arrays do not fit each other or the labels, or hold no touch of some shape.
    """

    logits: NDArray[np.float32]
    shapes: NDArray[np.int64]
    shape_labels: tuple[str, ...]
    pose_labels: tuple[str, ...]
    features: NDArray[np.floating] | None = None
    source: Mapping[str, Any] = field(default_factory=dict)
    scene: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        number, poses = len(self.shape_labels), len(self.pose_labels)
        if self.logits.ndim != 4 or self.logits.shape[2:] != (poses, number) or self.logits.size == 0:
            raise ValueError(f"logits must be (N, R, {poses}, {number}) with none of them 0, got {self.logits.shape}")
        if self.shapes.shape != (len(self.logits),):
            raise ValueError(f"shapes must be ({len(self.logits)},), got {self.shapes.shape}")
        if self.features is not None and self.features.shape[:3] != self.logits.shape[:3]:
            raise ValueError(f"features {self.features.shape} do not fit logits {self.logits.shape}")
        counts = np.bincount(self.shapes, minlength=number) if self.shapes.min() >= 0 else np.empty(0)
        if len(counts) != number or counts.min() == 0:
            raise ValueError(f"every shape of {list(self.shape_labels)} needs an object, got {counts.tolist()}")
        if not np.isfinite(self.logits).all():
            raise ValueError("logits must be finite")

    @property
    def num_objects(self) -> int:
        """N."""
        return self.logits.shape[0]

    @property
    def num_rounds(self) -> int:
        """R."""
        return self.logits.shape[1]

    @classmethod
    def record(cls, env: ObjectTestEnv, seeds: Sequence[Sequence[int]], rounds: int) -> TouchBank:
        """The touches that ``env`` would make in the episodes of these seeds, the n-th of a pose being its n-th round.

        Raises:
            ValueError: the environment's touch limit does not allow that many.
        """
        problem = env.problem
        num_poses = problem.num_poses
        if env.problem.touch_limit < rounds * num_poses:
            raise ValueError(f"{rounds} rounds need a touch_limit of {rounds * num_poses}, got {problem.touch_limit}")
        logits = np.empty((len(seeds), rounds, num_poses, problem.num_shapes), np.float32)
        shapes = np.empty(len(seeds), np.int64)
        for index, seed in enumerate(seeds):
            env.reset(options={"seed": seed})
            shapes[index] = env.arrangement[0]
            for round_ in range(rounds):
                for pose in range(num_poses):
                    env.step(pose)
                    logits[index, round_, pose] = env.history[-1].logits
        return cls(logits, shapes, tuple(problem.shape_labels), tuple(problem.pose_labels))

    def save(self, folder: Path) -> None:
        """Write the bank; a bank that is there already is replaced."""
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
    def open(cls, folder: Path) -> TouchBank:
        """The bank in a folder, its arrays mapped into memory and read-only.

        Raises:
            CorruptFile: there is none, or its files are not what was written.
        """
        try:
            manifest = unsealed_json((folder / MANIFEST).read_text(encoding="utf-8"))
            if manifest["format"] != _FORMAT:
                raise CorruptFile(f"{folder} is no {_FORMAT} but {manifest['format']!r}")
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

    def require_labels(self, shape_labels: tuple[str, ...], num_poses: int) -> None:
        """Check that an observation model fits.

        Raises:
            LabelMismatch: it is about other shapes or poses.
        """
        if (self.shape_labels, len(self.pose_labels)) != (tuple(shape_labels), num_poses):
            raise LabelMismatch(
                f"the bank has the shapes {list(self.shape_labels)} in {len(self.pose_labels)} poses, the observation "
                f"model is about {list(shape_labels)} in {num_poses}"
            )


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
