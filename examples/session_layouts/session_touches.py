"""The touches of sessions as arrays: what the files of both layouts hold. The two other scripts import this one.

Run: python examples/session_layouts/session_touches.py LOG [LOG ...]   (prints what is in logs of sessions)
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadRecording
from activetouch.recorded.formats import standing_touches
from activetouch.rendering import PressureRenderer
from belief.frozen import FrozenArrays
from belief.journal import array_from
from belief.naming import checked_names
from belief.validation import Floats

if TYPE_CHECKING:
    from activetouch.scene import Scene

_DTYPES = ("uint8", "uint16", "float32", "float64")
_TARGET = "an object"
_DEFAULTS: dict[str, Any] = {"sessions": 0, "objects": 0, "forces": np.nan}
_TYPES: dict[str, type] = {"times": np.float64, "forces": np.float64}


class TaxelLayout(NamedTuple):
    """Where taxels are, and what a unit of their image means.

    Attributes:
        positions: in the sensor's frame, ``(T, 3)`` [m], in the order of the image's rows.
        newtons_per_unit: force on a taxel whose image has the value 1 [N].
    """

    positions: Floats
    newtons_per_unit: float

    @classmethod
    def of(cls, scene: Scene) -> TaxelLayout | None:
        """The layout of a scene's taxels in the frame of its pad, or None if its images are not of pressure."""
        if not isinstance(scene.renderer, PressureRenderer):
            return None
        pad, size = scene.pad, scene.image_shape[0]
        edge = ((np.arange(size) + 0.5) / size * 2 - 1) * pad.half_width
        z, y = np.meshgrid(edge, edge, indexing="ij")
        full_scale = pad.stiffness * pad.max_depth * (2 * pad.half_width / size) ** 2
        return cls(np.stack([np.zeros(z.size), y.ravel(), z.ravel()], axis=1), full_scale / 255)


@dataclass(frozen=True, eq=False)
class SessionTouches(FrozenArrays):
    """n touches of S sessions, in the order in which they were made.

    Attributes:
        images: ``(n, H, W)``, ``(n, H, W, 3)``, or features ``(n, F)``; of type uint8, uint16, float32 or float64.
        times: when each was made [s since 1970], ``(n,)``.
        poses: index of the pose or action of each, ``(n,)``.
        pose_labels: of the P poses.
        sessions: session of each from 0, none left out, never falling, ``(n,)``; all 0 by default.
        objects: number of the touched object in its session, ``(n,)``; all 0 by default.
        targets: what each session sought, S names; "an object" by default.
        shapes: true shape of the touched object, n names; empty where nobody said.
        forces: of each contact, NaN where it was not stated [N], ``(n,)``.
        layout: of the taxels, or None if it is not known.

    Raises:
        BadRecording: arrays that do not fit each other, or values out of their range; the message names them.

    >>> touches = SessionTouches(np.zeros((2, 4, 4), np.uint8), [10.0, 12.5], [0, 0], ("press",), shapes=("mug", "can"))
    >>> len(touches), touches.targets, touches.newtons is None
    (2, ('an object',), True)
    """

    images: NDArray[Any]
    times: Floats
    poses: NDArray[np.int64]
    pose_labels: tuple[str, ...]
    sessions: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    objects: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    targets: tuple[str, ...] = ()
    shapes: tuple[str, ...] = ()
    forces: Floats = field(default_factory=lambda: np.empty(0))
    layout: TaxelLayout | None = None

    def __post_init__(self) -> None:
        images, n = np.asarray(self.images), len(self.images)
        fits = images.dtype.name in _DTYPES and images.ndim in (2, 3, 4) and images.size
        wanted = f"(n, H, W), (n, H, W, 3) or (n, F), at least one, of type {', '.join(_DTYPES)}"
        _require(fits, "images", wanted, f"{images.dtype} {images.shape}")
        for name in ("times", "poses", *_DEFAULTS):
            given = np.asarray(getattr(self, name))
            values = np.full(n, _DEFAULTS[name]) if name in _DEFAULTS and not given.size else given
            _require(values.shape == (n,), name, f"({n},) as there are {n} images", values.shape)
            with np.errstate(invalid="ignore"):
                changed: NDArray[Any] = values.astype(_TYPES.get(name, np.int64))
            fits = np.array_equal(changed, values, equal_nan=values.dtype.kind == "f")
            _require(fits, name, f"of {changed.dtype}", values.tolist()[:4])
            object.__setattr__(self, name, changed)
        labels = checked_names("pose_labels", self.pose_labels)
        for name, good, wanted in (
            ("times", np.isfinite(self.times) & (self.times >= 0.0), "finite and ≥ 0"),
            ("poses", (self.poses >= 0) & (self.poses < len(labels)), f"in [0, {len(labels)})"),
            ("objects", self.objects >= 0, "≥ 0"),
            ("sessions", np.isin(np.diff(self.sessions, prepend=0), (0, self.sessions[0] == 0)), "0, 0, …, 1, 1, …"),
        ):
            row = int(good.argmin())
            _require(good.all(), name, wanted, f"{getattr(self, name)[row]} for touch {row}")
        number = int(self.sessions[-1]) + 1
        shapes, targets = tuple(self.shapes) or ("",) * n, tuple(self.targets) or (_TARGET,) * number
        for name, names, size in (("shapes", shapes, n), ("targets", targets, number)):
            fits = len(names) == size and all(isinstance(word, str) for word in names)
            _require(fits, name, f"{size} names", f"{len(names)}: {names[:4]!r}")
        layout = self.layout
        if layout is not None:
            layout = TaxelLayout(np.asarray(layout.positions, np.float64), float(layout.newtons_per_unit))
            shape = int(np.prod(images.shape[1:])), 3
            fits = layout.positions.shape == shape and bool(np.isfinite(layout.positions).all())
            _require(fits, "positions of taxels", f"finite and {shape}", layout.positions.shape)
            _require(0.0 < layout.newtons_per_unit < np.inf, "newtons_per_unit", "positive", layout.newtons_per_unit)
        own = {"images": images, "pose_labels": labels, "shapes": shapes, "targets": targets, "layout": layout}
        for name, value in own.items():
            object.__setattr__(self, name, value)
        self.freeze()

    @classmethod
    def of_logs(cls, paths: Sequence[str | Path], layout: TaxelLayout | None = None) -> SessionTouches:
        """The touches in the logs of sessions, without those that were taken back.

        Args:
            paths: of the logs, one for each session.
            layout: of the taxels of the sensor, such as ``TaxelLayout.of(sensor.scene)``.

        Raises:
            BadRecording: a log is damaged, has other poses than the first, or a touch without an image.
        """
        rows: list[tuple[Any, ...]] = []
        targets: list[str] = []
        labels: tuple[str, ...] = ()
        for path in map(Path, paths):
            try:
                header, truth, touches = standing_touches(path)
                poses = tuple(header["problem"]["poses"])
                _require(poses == (labels or poses), f"the poses in {path}", f"{labels} as in the first log", poses)
                labels = poses
                targets += [header["target"]] * bool(touches)
                for number, touch in enumerate(touches):
                    _require("image" in touch, f"touch {number} in {path}", "told with an image", "none")
                    where = labels.index(touch["pose"]), len(targets) - 1, touch["object"]
                    label, force = truth[touch["object"]] or "", touch.get("force", np.nan)
                    rows.append((array_from(touch["image"]), float(touch["time"]), *where, label, force))
            except (LookupError, TypeError, ValueError, AttributeError) as error:
                raise (
                    error if isinstance(error, BadRecording) else BadRecording(f"{path} is no log: {error}")
                ) from error
        _require(rows, "logs", "of one touch or more", [*map(str, paths)])
        images, times, at, sessions, objects, shapes, forces = zip(*rows, strict=True)
        sizes = {image.shape for image in images}
        _require(len(sizes) == 1, "images", "of one shape", sizes)
        return cls(
            np.stack(images),
            np.array(times),
            np.array(at),
            labels,
            np.array(sessions),
            np.array(objects),
            tuple(targets),
            shapes,
            np.array(forces),
            layout,
        )

    def __len__(self) -> int:
        return len(self.images)

    @property
    def newtons(self) -> Floats | None:
        """Force on each taxel ``(n, T)`` [N]; None without a layout."""
        if self.layout is None:
            return None
        return self.images.reshape(len(self), -1).astype(np.float64) * self.layout.newtons_per_unit


def _require(fits: Any, name: str, wanted: str, got: object) -> None:
    if not fits:
        raise BadRecording(f"{name} must be {wanted}; got {got}")


if __name__ == "__main__":
    found = SessionTouches.of_logs(sys.argv[1:])
    print(f"{len(found)} touches of {len(found.targets)} sessions, images of {found.images.shape[1:]}")
