"""Pictures of what a joint belief knows about a body: the mean picture of a shape over its orientations and sizes.

Before the first touch it is a blurred ball. Each touch rules out orientations, and the body appears. Orientations that
look alike because of a shape's symmetry give the same picture, so symmetric shapes become as sharp as others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.placement import WorldObject
from activetouch.poses import to_matrices
from activetouch.sensor import TactileSensor
from activetouch.solids.solid import Shape
from belief.observation_model.rigid_body import joint_model
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence

Floats = NDArray[np.float64]

_TOWARDS = np.array([0.80, -0.45, 0.40])  # from the body to the camera; the pad comes along x
_LIGHT = np.array([0.55, -0.05, 0.85])
_STEP = 1e-3  # between the rays that give a normal, relative to the bounding radius


@dataclass(frozen=True, eq=False)
class Bodies:
    """Hypotheses of the objects' orientations and sizes, and the shapes they may have.

    Attributes:
        shapes: solids by label; the nominal one of a family.
        rests: orientations at rest, unit quaternions ``wxyz``, ``(N, 4)``.
        sizes: size factors, ``(N,)``.
        pixels: width and height of a picture; its cost grows with the square.
        draws: bodies of which a picture is the mean.
    """

    shapes: Mapping[str, Shape]
    rests: Floats
    sizes: Floats
    pixels: int = 96
    draws: int = 64

    @classmethod
    def of(cls, sensor: TactileSensor, pixels: int = 96, draws: int = 64) -> Bodies | None:
        """Those of a sensor's joint belief; None for a sensor with any other observation model.

        Args:
            sensor: the sensor.
            pixels: width and height of a picture.
            draws: bodies of which a picture is the mean.
        """
        model = joint_model(sensor.model)
        if model is None:
            return None
        rests, sizes, _ = HypothesisTable(sensor.reader, sensor.scene).hypotheses(model.num_hypotheses)
        return cls(sensor.scene.solids, rests, sizes, pixels, draws)

    def likeliest(self, evidence: RigidBodyEvidence, probs: Floats, number: int) -> list[tuple[str, float, Floats]]:
        """Label, probability and mean picture of the most probable shapes.

        Args:
            evidence: about the object.
            probs: posterior of its shape, ``(K,)``.
            number: of shapes.
        """
        labels = list(self.shapes)
        found = []
        for shape in np.argsort(-probs, kind="stable")[:number].tolist():
            rows, counts = _draws(evidence.log_weights[shape], self.draws)
            rotations, solid = to_matrices(self.rests[rows]), self.shapes[labels[shape]]
            each = [
                _shaded(solid, turn, size, self._radius, self.pixels)
                for turn, size in zip(rotations, self.sizes[rows], strict=True)
            ]
            found.append((labels[shape], float(probs[shape]), np.average(each, axis=0, weights=counts)))
        return found

    def outline(self, label: str, body: WorldObject) -> Floats:
        """Whether the true body, whose shape has this label, covers each pixel, ``(H, W)``, for its outline."""
        solid = self.shapes[label] if body.member is None else body.member
        return _shaded(solid, to_matrices(body.orientation[None])[0], body.scale, self._radius, self.pixels)[..., 1]

    @property
    def _radius(self) -> float:
        """Half of a picture's width [m]."""
        return max(solid.bounding_radius for solid in self.shapes.values()) * float(self.sizes.max())


def _draws(log_weights: Floats, number: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of some hypotheses, and how many of so many even quantiles of the weights fall on each."""
    weights = np.exp(log_weights - log_weights.max())
    order = np.random.default_rng(0).permutation(len(weights))  # neighbours in the sequence have similar orientations
    above = weights[order].cumsum()
    drawn = np.searchsorted(above, (np.arange(number) + 0.5) / number * above[-1])
    rows, counts = np.unique(order[np.minimum(drawn, len(order) - 1)], return_counts=True)
    return rows, counts


@lru_cache(maxsize=1)
def _camera() -> tuple[Floats, Floats, Floats]:
    """Unit vectors along the view, to the right and up."""
    forward = -_TOWARDS / np.linalg.norm(_TOWARDS)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return forward, right, np.cross(right, forward)


def _shaded(solid: Shape, rotation: Floats, size: float, reach: float, pixels: int) -> Floats:
    """Shade times coverage, and coverage, of every pixel, ``(H, W, 2)``; row 0 is at the bottom.

    Args:
        solid: the shape.
        rotation: from its frame to the world's, ``(3, 3)``.
        size: its size factor.
        reach: half of the picture's width [m].
        pixels: width and height of the picture.
    """
    forward, right, up = _camera()
    step, away = _STEP * reach, 2.0 * reach
    place = reach * (2.0 * np.arange(pixels) + 1.0 - pixels) / pixels
    across, high = (grid.ravel() for grid in np.meshgrid(place, place))

    def distances(across: Floats, high: Floats) -> Floats:
        starts = right[:, None] * across + up[:, None] * high - forward[:, None] * away
        return size * solid.entry_distance(rotation.T @ starts / size, rotation.T @ forward)

    depth = distances(across, high)
    hit = np.isfinite(depth)
    with np.errstate(invalid="ignore"):
        slopes = [(distances(across + a, high + b) - depth) / step for a, b in ((step, 0.0), (0.0, step))]
    along, upward = (np.where(np.isfinite(slope), slope, 0.0) for slope in slopes)
    normals = along[:, None] * right + upward[:, None] * up - forward
    light = np.clip(normals @ _LIGHT / np.linalg.norm(_LIGHT) / np.linalg.norm(normals, axis=1), 0.0, 1.0)
    return np.stack([np.where(hit, 0.25 + 0.75 * light, 0.0), hit], axis=1).reshape(pixels, pixels, 2)
