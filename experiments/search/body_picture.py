"""Pictures of what a joint belief knows about a body: the mean picture of a shape over its orientations and sizes.

Before the first touch it is a blurred ball. Each touch rules out orientations, and the body appears. Orientations that
look alike because of a shape's symmetry give the same picture, so symmetric shapes become as sharp as others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.placement import WorldObject
from activetouch.sensor import TactileSensor
from activetouch.solids.solid import Shape
from activetouch.view.portrait import portraits
from belief.observation_model.rigid_body import joint_model
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence

Floats = NDArray[np.float64]


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
        """Those of a sensor's joint belief; None for a sensor with any other observation model."""
        model = joint_model(sensor.model)
        if model is None:
            return None
        rests, sizes, _ = HypothesisTable(sensor.reader, sensor.scene).hypotheses(model.num_hypotheses)
        return cls(sensor.scene.solids, rests, sizes, pixels, draws)

    def likeliest(self, evidence: RigidBodyEvidence, probs: Floats, number: int) -> list[tuple[str, float, Floats]]:
        """Label, probability and mean picture of the likeliest shapes, by the evidence and their posterior ``(K,)``.

        A picture is shade times coverage, and coverage, ``(H, W, 2)``.
        """
        labels = list(self.shapes)
        found = []
        for shape in np.argsort(-probs, kind="stable")[:number].tolist():
            rows, counts = _draws(evidence.log_weights[shape], self.draws)
            solid = self.shapes[labels[shape]]
            each = portraits(solid, self.rests[rows], self._radius, self.pixels, self.sizes[rows])
            picture = np.stack([np.nan_to_num(each), np.isfinite(each)], axis=3)
            found.append((labels[shape], float(probs[shape]), np.average(picture, axis=0, weights=counts)))
        return found

    def outline(self, label: str, body: WorldObject) -> Floats:
        """Whether the true body, whose shape has this label, covers each pixel, ``(H, W)``, for its outline."""
        solid = self.shapes[label] if body.member is None else body.member
        picture = portraits(solid, body.orientation[None], self._radius, self.pixels, body.scale)[0]
        return np.isfinite(picture).astype(float)

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
