"""Hypotheses of grasps: embeddings of their fingers, of a body's positions in the palm, and of the fingers' travel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Bodies, kronecker, quantiles
from activetouch.hand import Hand
from activetouch.perception.cached_arrays import cached_array
from activetouch.perception.contacts.hypotheses import Hypotheses, cell_of, mean_ratios, num_hypotheses, taking_turns
from activetouch.perception.imaging import Floats32
from activetouch.poses import to_matrix, turned
from activetouch.pressing.height_maps import Window, predicted_contacts
from activetouch.scene import Scene
from activetouch.scene_description import scene_fields
from belief.files import array_digest

_STEP = 0.8191725133961645  # step of a sequence that is spread independently of sizes and members
_PIXELS = 16  # pixels along the edge of the pad for predictions of travel
_LEVER = 0.5  # distance that a turn moves a body's surface, relative to its radius and the angle


@dataclass(frozen=True, eq=False)
class GraspHypotheses:
    """Embeds hypotheses for grasps: the embedding of a grasp is those of its fingers, one after another.

    The product of two of them is the sum of the fingers' log ratios: given the body, its orientation, size and position
    in the palm, the readings of fingers are taken as independent. If each grasp draws a new position, the positions are
    alternatives of a hypothesis, whose embeddings stand one after another; if it is kept, it belongs to the hypothesis.
    Where the hand reads travel, two further parts make the Gaussian log density of the stops of the fingers. The reader
    of single touches averages over offsets of up to ``reach`` each way [m].
    """

    single: Hypotheses
    scene: Scene
    reach: float = 0.0

    @property
    def hand(self) -> Hand:
        """The hand of the scene."""
        assert self.scene.hand is not None, "checked by the reader"
        return self.scene.hand

    @cached_property
    def places(self) -> NDArray[np.float64]:
        """Positions in the palm over which the belief sums, ``(O, 3)`` [m]: one, the middle, if none is latent."""
        if self.hand.offset == "averaged":
            return np.zeros((1, 3))
        return self.hand.places(self.scene.variation.offset, self.reach)

    @property
    def number(self) -> int:
        """Number of hypotheses of each shape in a model of these grasps."""
        fitting = num_hypotheses(self.scene, len(self.places))
        return fitting * len(self.places) if self.hand.offset == "kept" else fitting

    def bound_to(self, scene: Scene) -> GraspHypotheses:
        """The same for the objects and the hand of another scene."""
        return GraspHypotheses(self.single.bound_to(scene), scene, self.reach)

    def embedded(self, scene: Scene, bodies: Bodies, pose: int) -> Floats32:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`: ``(K, N, D)``, or ``(K, N, O · D)``."""
        if self.hand.offset != "kept":
            return np.concatenate([self._at(place, scene, bodies, pose) for place in self.places], axis=2)
        places = self.places @ to_matrix(scene.rotations[scene.pose_labels[pose]]).T
        of_place = (len(places) * kronecker(_STEP, len(bodies.rests))).astype(np.int64)
        rows = [np.flatnonzero(of_place == number) for number in range(len(places))]
        parts = [
            self._at(place, scene, bodies.take(some), pose)
            for place, some in zip(places, rows, strict=True)
            if len(some)
        ]
        return np.concatenate(parts, axis=1)[:, np.argsort(np.concatenate(rows))]

    def _at(self, place: NDArray[np.float64], scene: Scene, bodies: Bodies, pose: int) -> Floats32:
        """Embeddings of hypotheses of a body at one place in the palm, ``(K, N, D)``."""
        fingers = []
        for one, across in zip(scene.fingers, self.hand.across(place), strict=True):
            aims = {**one.aims, one.pose_labels[pose]: tuple((one.aim_offsets[pose] + across).tolist())}
            fingers.append(replace(one, aims=aims) if across.any() else one)
        found = [self.single.embedded(one, bodies, pose) for one in fingers]
        if self.hand.travel is not None:
            stops, (whiten, usual, _) = [predicted_stops(one, bodies, pose) for one in fingers], self._errors
            mean = (np.stack(stops, axis=2) - usual) @ whiten.T
            found.append(np.concatenate([mean, np.square(mean).sum(axis=2, keepdims=True)], axis=2, dtype=np.float32))
        return np.concatenate(found, axis=2)

    def of_travel(self, stops: NDArray[np.float64]) -> Floats32:
        """Numbers to append to embeddings of N grasps for stops ``(N, m)`` [m]: ``(N, m + 1)``; none without travel."""
        if self.hand.travel is None:
            return np.zeros((len(stops), 0), np.float32)
        whiten, usual, shift = self._errors
        found = (stops - usual + shift) @ whiten.T
        return np.concatenate([found, np.full((len(stops), 1), -0.5)], axis=1, dtype=np.float32)

    @cached_property
    def _errors(self) -> tuple[NDArray[np.float64], float, NDArray[np.float64]]:
        """A matrix that whitens errors of stops, ``(m, m)``; a usual stop [m]; shifts of the mean by offsets, ``(m,)``.

        Errors are those of the measurement, of a turn within the cell of a hypothesis, and of the body's position along
        the fingers, which these share.
        """
        vary, axes = self.scene.variation, self.hand.axes
        offsets = quantiles(vary.offset, (np.arange(64) + 0.5) / 64)
        radius = np.mean([solid.bounding_radius for solid in self.scene.solids.values()]) * np.mean(vary.size.support)
        turned = _LEVER * radius * cell_of(num_hypotheses(self.scene, len(self.places)))
        own = np.eye(len(axes)) * ((self.hand.travel or 0.0) ** 2 + turned**2)
        whiten = np.linalg.inv(np.linalg.cholesky(own + np.var(offsets) * axes @ axes.T))
        return whiten, float(radius), axes @ np.full(3, np.mean(offsets))

    def shape_logits(self, embeddings: Floats32) -> NDArray[np.float64]:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`; the mean is over all poses."""
        return mean_ratios(embeddings, self._fixed.reshape(len(self._fixed), -1, embeddings.shape[1]))

    @cached_property
    def _fixed(self) -> Floats32:
        return taking_turns(self, self.scene, self.number)

    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, as a file has them: those for single touches."""
        return self.single.tensors()


def predicted_stops(scene: Scene, bodies: Bodies, pose: int) -> NDArray[np.float32]:
    """Distance of bodies' centres from a pad that presses with the mean force, ``(K, N)`` [m]; 0 for a miss."""
    rotation, aim = scene.rotations[scene.pose_labels[pose]], scene.aim_offsets[pose]
    pad, window = replace(scene.pad, num_taxels=_PIXELS), Window.of(scene.pad, 0.0, _PIXELS)
    force = float(np.mean(quantiles(scene.variation.force, (np.arange(64) + 0.5) / 64)))

    def stops() -> NDArray[np.float32]:
        found = np.zeros((len(scene.shapes), len(bodies.rests)), np.float32)
        for shape, label in enumerate(scene.shape_labels):
            solids, members = scene.bodies(label, bodies.shares)
            for member, solid in enumerate(solids):
                rows = np.flatnonzero(members == member)
                turns = turned(rotation, bodies.rests[rows])
                maps = predicted_contacts(solid, turns, aim, window, bodies.sizes[rows])
                for row, reached in zip(rows, maps, strict=True):
                    if np.isfinite(highest := reached.max()):
                        found[shape, row] = highest - pad.indentation(highest - reached, force)
        return found

    fields = scene_fields(scene)
    described = {name: fields.get(name) for name in ("shapes", "families", "pad")}
    where = [array_digest(bodies._asdict()), np.round([*rotation, *aim], 9).tolist(), force]
    return cached_array({"stops": described, "where": where}, stops)
