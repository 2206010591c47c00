"""Objects of a collection that were touched in every pose, and what a sensor makes of their touches."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from activetouch.data.dataset import read_split
from activetouch.data.manifest import read_manifest
from activetouch.sensor import TactileSensor
from belief.seeding import keyed_rng
from belief.touch_batch import TouchBatch
from benchmarks.held_out import Stream


@dataclass(frozen=True, eq=False)
class TouchedObjects:
    """Readings of M objects, each touched once in every pose, and the order of the touches.

    Attributes:
        readings: by pose, ``(M, P, n, n)`` uint8.
        shapes: true shapes, ``(M,)``.
        orders: pose of each touch, first to last, ``(M, P)``.
    """

    readings: NDArray[np.uint8]
    shapes: NDArray[np.int64]
    orders: NDArray[np.int64]


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


def sensor_evidence(sensor: TactileSensor, touched: TouchedObjects, orders: NDArray[np.int64]) -> NDArray[np.float64]:
    """Log likelihood of the first n touches of each object under the sensor's observation model, ``(M, T, K)``.

    Args:
        sensor: reader and observation model.
        touched: the objects.
        orders: pose of each touch, ``(M, T)``.
    """
    readings = np.take_along_axis(touched.readings, orders[:, :, None, None], axis=1)
    reading = sensor.reader.read(readings.reshape(-1, *readings.shape[2:]), batch_size=256)
    batch = TouchBatch(orders, reading.logits.reshape(*orders.shape, -1), reading.embeddings.reshape(*orders.shape, -1))
    found = [sensor.model.log_likelihood_batch(batch.first(n)) for n in range(1, batch.num_touches + 1)]
    return np.stack(found, axis=1)
