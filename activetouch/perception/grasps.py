"""Hypotheses of grasps: embeddings of their fingers, and of a body's positions in the palm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from activetouch.perception.contacts.hypotheses import mean_ratios, num_hypotheses, taking_turns

if TYPE_CHECKING:
    from activetouch.hand import Hand
    from activetouch.hypotheses import Bodies
    from activetouch.perception.contacts.hypotheses import Hypotheses
    from activetouch.perception.hypothesis_embedding import Floats32
    from activetouch.scene import Scene


@dataclass(frozen=True, eq=False)
class GraspHypotheses:
    """Embeds hypotheses for grasps: the embedding of a grasp is those of its fingers, one after another.

    The product of two of them is the sum of the fingers' log ratios: given the body, how it lies, its size and its
    position in the palm, what fingers feel is taken as independent. A position that each grasp draws anew is one of
    several alternatives of a hypothesis, whose embeddings stand one after another.

    Attributes:
        single: embeds them for single touches, in any orientation.
        scene: with the hand.
        reach: offsets over which the reader of single touches averages, each way [m].
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
        """How many hypotheses of each shape a model of these grasps has."""
        return num_hypotheses(self.scene, len(self.places))

    def bound_to(self, scene: Scene) -> GraspHypotheses:
        """The same for the objects and the hand of another scene."""
        return GraspHypotheses(self.single.bound_to(scene), scene, self.reach)

    def embedded(self, scene: Scene, bodies: Bodies, pose: int) -> Floats32:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`: ``(K, N, D)``, or ``(K, N, O · D)``."""
        return np.concatenate([self._at(place, scene, bodies, pose) for place in self.places], axis=2)

    def _at(self, place: NDArray[np.float64], scene: Scene, bodies: Bodies, pose: int) -> Floats32:
        """Embeddings of hypotheses of a body at one place in the palm, ``(K, N, D)``."""
        fingers = []
        for one, across in zip(scene.fingers, self.hand.across(place), strict=True):
            aims = {**one.aims, one.pose_labels[pose]: tuple((one.aim_offsets[pose] + across).tolist())}
            fingers.append(replace(one, aims=aims) if across.any() else one)
        found = [self.single.embedded(one, bodies, pose) for one in fingers]
        return np.concatenate(found, axis=2)

    def shape_logits(self, embeddings: Floats32) -> NDArray[np.float64]:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`; the mean is over all poses."""
        return mean_ratios(embeddings, self._fixed.reshape(len(self._fixed), -1, embeddings.shape[1]))

    @cached_property
    def _fixed(self) -> Floats32:
        return taking_turns(self, self.scene, self.number)

    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, as a file has them: those for single touches."""
        return self.single.tensors()
