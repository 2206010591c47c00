"""Evidence from a learned likelihood ratio over bodies: the reader's counterpart of the simulated bank of bodies.

A reader that knows orientation gives log p(image | shape, rotation, size) / p(image) as the product of embeddings of
image and hypothesis (:class:`activetouch.perception.reader.TactileReader`).
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.poses import to_matrix
from activetouch.scene import Scene
from experiments.bayes_error.joint_evidence import Evidence, joint_log_likelihoods
from experiments.bayes_error.touched_objects import TouchedObjects

Floats32 = NDArray[np.float32]

_OBJECTS_AT_ONCE = 20


class JointReader(Protocol):
    """What is asked of a reader."""

    def read(self, images: NDArray[np.uint8]) -> Any:
        """A reading with the attribute ``embeddings`` of images ``(N, H, W)``, ``(N, D)``."""

    def embed(self, shapes: NDArray[np.int64], rotations: NDArray[Any], sizes: NDArray[Any]) -> Floats32:
        """Embeddings of hypotheses, ``(H, D)``."""


class Bodies(NamedTuple):
    """Hypotheses of an object, the same for every shape.

    Attributes:
        rests: orientations at rest, unit quaternions ``wxyz``, ``(N, 4)``.
        sizes: size factors, ``(N,)``.
    """

    rests: NDArray[np.float64]
    sizes: NDArray[np.float64]

    @classmethod
    def sample(cls, scene: Scene, number: int, rng: np.random.Generator) -> Bodies:
        """Bodies as the scene draws them."""
        things = [scene.sample_object(0, rng) for _ in range(number)]
        return cls(np.stack([thing.orientation for thing in things]), np.array([thing.scale for thing in things]))


def embedded_bodies(reader: JointReader, scene: Scene, bodies: Bodies) -> Floats32:
    """Embeddings of all bodies of every shape in every pose, ``(P, K, N, D)``."""
    rng = np.random.default_rng(0)  # of presentations that draw anew for every touch; the others draw nothing
    number, tables = len(bodies.sizes), []
    for pose in scene.poses.values():
        rotations = np.stack([to_matrix(scene.presentation.shown(rest, pose, rng)) for rest in bodies.rests])
        shapes = (np.full(number, shape) for shape in range(len(scene.shapes)))
        tables.append(np.stack([reader.embed(shape, rotations, bodies.sizes) for shape in shapes]))
    return np.stack(tables)


def learned_evidence(reader: JointReader, table: Floats32, touched: TouchedObjects) -> Evidence:
    """Evidence of touched objects from a reader's likelihood ratios.

    Args:
        reader: with an embedding.
        table: from :func:`embedded_bodies`.
        touched: the objects.
    """
    parts = []
    for first in range(0, len(touched.shapes), _OBJECTS_AT_ONCE):
        some = slice(first, first + _OBJECTS_AT_ONCE)
        readings = touched.readings[some]
        images = readings.reshape(-1, *readings.shape[2:])
        embeddings = reader.read(images).embeddings.reshape(*readings.shape[:2], 1, -1, 1)  # (B, P, 1, D, 1)
        ratios = np.matmul(table[None], embeddings)[..., 0]  # (B, P, K, N)
        parts.append(joint_log_likelihoods(ratios, touched.orders[some]))
    return Evidence.of_objects(parts)
