"""Hypotheses of a scene's objects, embedded by a reader: the table that the joint observation model works with."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import WrongScene
from activetouch.orientations import LyingAnyhow
from activetouch.perception.reader import TactileReader
from activetouch.poses import multiply, turned
from activetouch.scene import Scene
from belief.errors import InvalidArgument
from belief.frozen import frozen
from belief.observation_model.outcome_mixture import Views

_FEW_POSES = 12
_MOST_IN_SINGLE = 1 << 25  # numbers in the tables of all poses


@dataclass(frozen=True, eq=False)
class HypothesisTable:
    """Embeds any number of hypotheses in every pose of a scene."""

    reader: TactileReader
    scene: Scene

    def __call__(self, num_hypotheses: int) -> NDArray[np.float32]:
        """Embedded hypotheses ``(P, K, N, D)``, N of each shape, the same orientations and sizes for all shapes."""
        return np.stack([self._embed(num_hypotheses, pose) for pose in range(len(self.scene.poses))])

    def in_pose(self, num_hypotheses: int, pose: int) -> NDArray[np.floating]:
        """Embedded hypotheses in one pose, ``(K, N, D)``, read-only; in half precision if all poses exceed 128 MB."""
        key = num_hypotheses, pose
        if key not in self._kept:
            found = self._embed(num_hypotheses, pose)
            is_large = len(self.scene.poses) * found.size > _MOST_IN_SINGLE
            self._kept[key] = frozen(found.astype(np.float16) if is_large else found)
        return self._kept[key]

    @cached_property
    def _kept(self) -> dict[tuple[int, int], NDArray[np.floating]]:
        return {}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_kept"}

    def _embed(self, num_hypotheses: int, pose: int) -> NDArray[np.float32]:
        if self.reader.hypotheses is None:
            raise InvalidArgument("this reader tells shapes only; one that knows orientations is trained with its own")
        return self.reader.hypotheses.embedded(self.scene, self.scene.hypotheses(num_hypotheses), pose)

    @property
    def groups(self) -> tuple[int, ...]:
        """Group of each pose, by its aim; empty for few poses, and if objects do not lie in random orientations."""
        turns_with_body = self.scene.hand is not None and self.scene.hand.offset == "kept"
        few = len(self.scene.poses) <= _FEW_POSES or turns_with_body
        if few or not isinstance(self.scene.presentation, LyingAnyhow):
            return ()
        aims = list(map(tuple, self.scene.aim_offsets.tolist()))
        return tuple(list(dict.fromkeys(aims)).index(aim) for aim in aims)

    def views(self, num_hypotheses: int) -> Views:
        """The hypotheses that look alike in different poses, by orientation."""
        if not self.groups:
            raise WrongScene(
                f"this observation model takes poses as alike, which holds for more than {_FEW_POSES} poses of objects "
                f"that lie anyhow, not for {self.scene!r}. Fit one to touches of this scene (activetouch calibrate)"
            )
        from activetouch.rotation_cells import nearest

        groups, rotations = np.array(self.groups), list(self.scene.rotations.values())
        rests = self.scene.hypotheses(num_hypotheses).rests
        first = np.unique(groups, return_index=True)[1][groups]
        back = [
            multiply(rotations[begin] * (1.0, -1.0, -1.0, -1.0), each)
            for begin, each in zip(first, rotations, strict=True)
        ]
        return Views(groups, np.stack([nearest(turned(rotation, rests), rests) for rotation in back]))
