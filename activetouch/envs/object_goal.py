"""The environment of the paper's task (§5.8) for any target: the target is drawn at reset and observed."""

from __future__ import annotations

from typing import Any

import numpy as np

from activetouch.envs.base import State
from activetouch.envs.object_test import ObjectTestEnv
from activetouch.envs.priors import ObjectPriors, TargetProb
from activetouch.envs.touch_source import Touches
from belief.policy_state import TOUCH_LIMIT


class ObjectGoalEnv(ObjectTestEnv):
    """`activetouch/ObjectTest-v0` with another target in each episode: one policy for all targets.

    ## Description
    As `activetouch/ObjectTest-v0`. The target is drawn uniformly at reset.

    ## Action Space
    As in `activetouch/ObjectTest-v0`.

    ## Observation Space
    That of `activetouch/ObjectTest-v0`, followed by the target, one-hot: a `Box(0, 1, (17,), float32)` with four shapes
    and six poses. The wrappers keep the target at the end of the state.

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

    def __init__(
        self,
        scene: str = "gel",
        touch_cost: float = 0.02,
        touch_limit: int = TOUCH_LIMIT,
        target_prob: TargetProb = 0.5,
        touches: Touches | None = None,
        render_mode: str | None = None,
    ) -> None:
        first = None if touches is None else touches.model.shape_labels[0]
        super().__init__(scene, first or "cone", touch_cost, touch_limit, target_prob, touches, render_mode)
        self._target_prob = target_prob

    @property
    def _observation_size(self) -> int:
        return super()._observation_size + self.problem.num_shapes

    def observe(self, state: np.ndarray) -> State:
        """The encoded situation and the target, one-hot."""
        goal = np.arange(self.problem.num_shapes) == self.target
        return np.append(super().observe(state), goal.astype(np.float32))

    def _sample_arrangement(self, rng: np.random.Generator) -> tuple[int, ...]:
        self.target = int(rng.integers(self.problem.num_shapes))
        self._priors = ObjectPriors.of(self.problem.num_shapes, self.target, self._target_prob)
        return super()._sample_arrangement(rng)

    def _info(self, success: bool) -> dict[str, Any]:
        return {**super()._info(success), "target": self.problem.shape_labels[self.target]}
