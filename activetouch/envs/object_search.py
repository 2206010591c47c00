"""The whole search: find the target among several objects that come one after the other."""

from __future__ import annotations

from typing import Any

import numpy as np

from activetouch.envs.base import TouchEnv, live_or_given
from activetouch.envs.touch_source import Touches
from activetouch.named_scenes import SCENES, NamedScene
from belief import Composition, SearchProblem
from belief.policy_state import TOUCH_LIMIT
from belief.synthetic import sample_arrangement


class ObjectSearchEnv(TouchEnv):
    """Objects one after the other: probe, reject, and confirm the one that is the target.

    ## Description
    The search that `activetouch compare` plays. The objects of the scene, of unknown size, orientation and order, come
    one at a time; REJECT puts one aside for good. The belief about each knows what the others told about it: four
    objects of four shapes are all different.

    ## Action Space
    `Discrete(8)` with the six poses of the named scenes: 0 … 5 probe the current object, 6 is CONFIRM, 7 is REJECT.
    `env.unwrapped.action_masks()` says which of them make sense.

    ## Observation Space
    A `Box(0, 1, (14,), float32)` with four shapes and six poses: the paper's state of the current object, as in
    `activetouch/ObjectTest-v0` but that the time is that of the whole search, and then the share of objects not yet
    rejected. Other observations by wrapper, as there.

    ## Starting State
    Objects as the scene's composition says, nothing felt yet. `reset(options={"seed": (…)})` makes the episode of that
    key: (seed, target index, number) for one of `activetouch compare`.

    ## Rewards
    Decision 0004, not the sum of the paper's single-object rewards: CONFIRM +1 where right, -1 where wrong; REJECT 0,
    but -1 with the last object, or +1 if the target was not there; `-touch_cost` (λ) for a probe; -1 for truncation.
    They sum to :meth:`belief.SearchProblem.reward`.

    ## Episode End
    - Termination: CONFIRM, or REJECT of the last object.
    - Truncation: a probe when `touch_limit` touches were made in all; it feels nothing.

    ## Information
    As of `activetouch/ObjectTest-v0`, and `object_index`: how many objects were rejected.

    ## Arguments
    ```python
    import gymnasium
    gymnasium.make("activetouch.envs:activetouch/ObjectSearch-v0", scene="coarse", target="cone")
    ```
    - `scene="gel"`: the named scene, with its objects and the sensor that comes with it.
    - `target="cone"`: the shape sought.
    - `touch_cost=0.02`: λ, in units of a success.
    - `num_objects=None`, `composition=None`: the scene's by default.
    - `touch_limit=None`: of the whole search; 12 an object by default.
    - `touches=None`: other touches than the scene's live ones, a :class:`activetouch.envs.touch_source.Touches`.
    - `render_mode=None`: or `"rgb_array"`.

    ## Version History
    * v0: first version
    """

    def __init__(
        self,
        scene: str = "gel",
        target: str = "cone",
        touch_cost: float = 0.02,
        num_objects: int | None = None,
        composition: Composition | None = None,
        touch_limit: int | None = None,
        touches: Touches | None = None,
        render_mode: str | None = None,
    ) -> None:
        source = live_or_given(touches, scene)
        named = SCENES.get(scene, NamedScene())
        number = named.num_objects if num_objects is None else num_objects
        problem = SearchProblem(
            source.model.shape_labels,
            source.pose_labels,
            number,
            named.composition if composition is None else composition,
            touch_cost,
            TOUCH_LIMIT * number if touch_limit is None else touch_limit,
        )
        super().__init__(problem, source, target, render_mode)

    @property
    def _observation_size(self) -> int:
        return super()._observation_size + 1

    def observe(self, state: np.ndarray) -> np.ndarray:
        """The encoded situation and the share of objects left."""
        left = 1.0 - self._num_rejected / self.problem.num_objects
        return np.append(super().observe(state), np.float32(left))

    def _sample_arrangement(self, rng: np.random.Generator) -> tuple[int, ...]:
        return sample_arrangement(self.problem, rng)

    def _act(self, action: int) -> tuple[float, bool, bool, bool]:
        cost = self.problem.touch_cost
        if action < self.confirm:
            if self._num_touches == self.problem.touch_limit:
                return -1.0, False, True, False
            self._probe(action)
            return -cost, False, False, False
        self._previous = action
        if action == self.confirm:
            right = self._arrangement[self._object_index] == self.target
            return (1.0 if right else -1.0), True, False, right
        self._num_rejected += 1
        if self._num_rejected == self.problem.num_objects:
            right = self.target not in self._arrangement
            return (1.0 if right else -1.0), True, False, right
        self._objects.advance()
        self.last_press = None
        return 0.0, False, False, False

    def _info(self, success: bool) -> dict[str, Any]:
        return {**super()._info(success), "object_index": self._num_rejected}
