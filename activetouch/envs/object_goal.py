"""The environment of the paper's task (§5.8) for any target: the target is drawn at reset and observed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from activetouch.envs.base import State, live_or_given
from activetouch.envs.object_test import ObjectTestEnv
from activetouch.envs.touch_source import Touches


class ObjectGoalEnv(ObjectTestEnv):
    """`activetouch/ObjectTest-v0` with another target in each episode: one policy for all targets.

    ## Description
    As `activetouch/ObjectTest-v0`. The target is drawn uniformly at reset.

    ## Action Space
    As in `activetouch/ObjectTest-v0`.

    ## Observation Space
    That of `activetouch/ObjectTest-v0`, followed by the target, one-hot: a `Box(0, 1, (17,), float32)` with four shapes
    and six poses. It is last in the other states too.

    ## Starting State
    The target is uniform over the shapes; the object has its shape with probability `target_prob`.

    ## Rewards
    As in `activetouch/ObjectTest-v0`.

    ## Episode End
    As in `activetouch/ObjectTest-v0`.

    ## Information
    As in `activetouch/ObjectTest-v0`, and `target`: label of the target shape.

    ## Arguments
    ```python
    import gymnasium
    gymnasium.make("activetouch.envs:activetouch/ObjectTestGoal-v0", scene="coarse")
    ```
    Those of `activetouch/ObjectTest-v0` except `target`.

    ## Version History
    * v0: first version
    """

    def __init__(self, scene: str = "gel", *, touches: Touches | None = None, **settings: Any) -> None:
        source = live_or_given(touches, scene)
        super().__init__(scene, source.model.shape_labels[0], touches=source, **settings)

    @property
    def _num_more(self) -> int:
        return self.problem.num_shapes

    def observe(self) -> State:
        """The state and the target, one-hot."""
        goal = np.arange(self.problem.num_shapes) == self.target
        return np.append(super().observe(), goal.astype(np.float32))

    def _sample_arrangement(self, rng: np.random.Generator) -> tuple[int, ...]:
        self.target = int(rng.integers(self.problem.num_shapes))
        self._priors = replace(self._priors, target=self.target)
        return super()._sample_arrangement(rng)

    def _info(self, success: bool) -> dict[str, Any]:
        return {**super()._info(success), "target": self.problem.shape_labels[self.target]}
