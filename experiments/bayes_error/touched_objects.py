"""Objects that were touched once in every pose, to test readers of several touches on."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from activetouch.data.dataset import read_manifest, read_split
from activetouch.errors import UnstablePress
from activetouch.scene import MOST_ATTEMPTS, Scene
from belief.seeding import keyed_rng
from experiments.bayes_error.estimator import chunks
from experiments.bayes_error.held_out import Stream
from experiments.parallel import run_tasks

Bytes = NDArray[np.uint8]
_OBJECTS_PER_TASK = 20


@dataclass(frozen=True, eq=False)
class TouchedObjects:
    """Readings of M objects, each touched once in every pose, and the order of the touches.

    Attributes:
        readings: by pose, ``(M, P, n, n)`` uint8.
        shapes: true shapes, ``(M,)``.
        orders: pose of each touch, first to last, ``(M, P)``.
    """

    readings: Bytes
    shapes: NDArray[np.int64]
    orders: NDArray[np.int64]

    @property
    def digest(self) -> str:
        """SHA-256 of readings and orders."""
        return hashlib.sha256(self.readings.tobytes() + self.orders.astype("<i8").tobytes()).hexdigest()


def press_objects(scene: Scene, per_shape: int, seed: int, jobs: int) -> TouchedObjects:
    """Press new objects of every shape, as the scene presses.

    Raises:
        UnstablePress: objects drawn in turn could not be pressed.
    """
    total = per_shape * len(scene.shapes)
    tasks = [partial(_press_some, scene, seed, numbers) for numbers in chunks(total, _OBJECTS_PER_TASK)]
    parts = sorted(run_tasks(tasks, jobs, "touching held-out objects"), key=lambda part: part[0])
    readings = np.concatenate([some for _, some in parts])
    return TouchedObjects(readings, np.arange(total) % len(scene.shapes), touch_orders(total, len(scene.poses), seed))


def recorded_objects(folder: Path, seed: int) -> TouchedObjects:
    """The test objects of a collection, each in its first round of poses.

    Raises:
        CorruptFile: there is no such collection, or it is damaged.
    """
    manifest, touches = read_manifest(folder), read_split(folder, "test")
    num_poses, image = len(manifest.pose_labels), manifest.image_shape
    readings = touches.images.reshape(-1, manifest.touches_per_object, *image)[:, :num_poses]
    shapes = touches.shapes[:: manifest.touches_per_object]
    return TouchedObjects(readings, shapes, touch_orders(len(shapes), num_poses, seed))


def touch_orders(num_objects: int, num_poses: int, seed: int) -> NDArray[np.int64]:
    """A random order of the poses for each object, ``(M, P)``, from generators keyed by its number."""
    rngs = (keyed_rng([seed, Stream.ORDER, number], is_fixed_length=True) for number in range(num_objects))
    return np.stack([rng.permutation(num_poses) for rng in rngs])


def _press_some(scene: Scene, seed: int, numbers: range) -> tuple[int, Bytes]:
    return numbers[0], np.stack([_press(scene, seed, number) for number in numbers])


def _press(scene: Scene, seed: int, number: int) -> Bytes:
    """Readings of an object in every pose, ``(P, n, n)``; an object with a press that does not settle is drawn anew."""
    for draw in range(MOST_ATTEMPTS):
        rng = keyed_rng([seed, Stream.TOUCHED, number, draw], is_fixed_length=True)
        thing = scene.sample_object(number % len(scene.shapes), rng)
        try:
            return np.stack([scene.press(thing, pose, rng, attempts=1).image for pose in range(len(scene.poses))])
        except UnstablePress as error:
            last = error
    raise UnstablePress(f"none of {MOST_ATTEMPTS} objects could be pressed; the last one: {last}") from last
