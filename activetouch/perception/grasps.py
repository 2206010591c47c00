"""Hypotheses of grasps: embeddings of their fingers."""

from __future__ import annotations

from dataclasses import dataclass
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

    The product of two of them is the sum of the fingers' log ratios: given the body, how it lies and its size, what
    fingers feel is taken as independent.

    Attributes:
        single: embeds them for single touches, in any orientation.
        scene: with the hand.
    """

    single: Hypotheses
    scene: Scene

    @property
    def hand(self) -> Hand:
        """The hand of the scene."""
        assert self.scene.hand is not None, "checked by the reader"
        return self.scene.hand

    def bound_to(self, scene: Scene) -> GraspHypotheses:
        """The same for the objects and the hand of another scene."""
        return GraspHypotheses(self.single.bound_to(scene), scene)

    def embedded(self, scene: Scene, bodies: Bodies, pose: int) -> Floats32:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`."""
        return np.concatenate([self.single.embedded(one, bodies, pose) for one in scene.fingers], axis=2)

    def shape_logits(self, embeddings: Floats32) -> NDArray[np.float64]:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`; the mean is over all poses."""
        return mean_ratios(embeddings, self._fixed)

    @cached_property
    def _fixed(self) -> Floats32:
        return taking_turns(self, self.scene, num_hypotheses(self.scene))

    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, as a file has them: those for single touches."""
        return self.single.tensors()
