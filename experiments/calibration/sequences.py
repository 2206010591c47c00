"""Sequences of touches, assembled from objects that were touched in every pose in several rounds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.data.dataset import TouchSet
from activetouch.envs.touch_bank import TouchRounds
from belief.touch_batch import TouchBatch

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rounds(TouchRounds):
    """Touches of a split, from which sequences are drawn; a joint model needs the ``features (N, R, P, F)``."""

    logits: Floats
    features: NDArray[np.floating] | None = None

    @classmethod
    def of(cls, truth: TouchSet, touches: TouchBatch, num_poses: int) -> Rounds:
        """Rounds of a split, from ``touches`` in one sequence that is ordered by object, round and pose."""
        by_object = (len(np.unique(truth.object_ids)), -1, num_poses)
        each = len(truth.object_ids) // by_object[0]
        return cls(
            touches.require_logits().reshape(*by_object, touches.num_shapes),
            truth.shapes[::each],
            None if touches.features is None else touches.features.reshape(*by_object, touches.features.shape[2]),
        )

    def distinct_poses(self, rng: np.random.Generator) -> Sequences:
        """R sequences per object, which share no touch: every pose once, in random order, from random rounds."""
        poses = rng.permuted(np.tile(np.arange(self.num_poses), (self.num_objects, self.num_rounds, 1)), axis=2)
        rounds = np.take_along_axis(self._shuffled_rounds(rng).swapaxes(1, 2), poses, axis=2)  # (N, R, P)
        return self._pick(rounds, poses)

    def one_pose(self, rng: np.random.Generator) -> Sequences:
        """P sequences per object, one for each pose: R touches in this pose, rounds in random order."""
        rounds = self._shuffled_rounds(rng)  # (N, P, R)
        return self._pick(rounds, np.broadcast_to(np.arange(self.num_poses)[:, None], rounds.shape))

    def _shuffled_rounds(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """Rounds in random order for every object and pose, ``(N, P, R)``."""
        return rng.permuted(np.tile(np.arange(self.num_rounds), (self.num_objects, self.num_poses, 1)), axis=2)

    def _pick(self, rounds: NDArray[np.int64], poses: NDArray[np.int64]) -> Sequences:
        """Sequences from rounds and poses ``(N, sequences, touches)``."""
        where, length = (np.arange(self.num_objects)[:, None, None], rounds, poses), poses.shape[2]
        logits, features = self.logits[where].reshape(-1, length, self.logits.shape[3]), self.features
        if features is not None:
            features = features[where].reshape(-1, length, features.shape[3])
        object_ids = np.arange(self.num_objects).repeat(poses.shape[1])
        return Sequences(TouchBatch(poses.reshape(-1, length), logits, features), self.shapes[object_ids], object_ids)


@dataclass(frozen=True, eq=False)
class Sequences:
    """S sequences of n touches, each of one object; ``shapes (S,)`` are true, ``object_ids (S,)`` are numbers."""

    batch: TouchBatch
    shapes: NDArray[np.int64]
    object_ids: NDArray[np.int64]


KINDS: Mapping[str, Callable[[Rounds, np.random.Generator], Sequences]] = {
    "distinct poses": Rounds.distinct_poses,
    "one pose": Rounds.one_pose,
}
"""Ways to choose the poses of a sequence, by name."""
