"""The environment of a whole search: find the target among several objects."""

from __future__ import annotations

from typing import Any

import numpy as np

from activetouch.envs.base import State, TouchEnv, live_or_given
from activetouch.envs.touch_source import Touches
from activetouch.hand import Hand
from activetouch.named_scenes import SCENES, NamedScene
from belief.composition import Composition
from belief.problem import SearchProblem
from belief.search_progress import Outcome
from belief.synthetic import sample_arrangement


class ObjectSearchEnv(TouchEnv):
    """The search of ``activetouch compare``: probe and reject objects one by one, and confirm the target.

    The objects of the scene, with unknown sizes, orientations and order, come one at a time; REJECT removes one for
    good. The touches of one object also change the belief about the others: four objects of four shapes all differ.

    ## Differences from `activetouch/ObjectTest-v0`
    - Actions: with `unsure_reward`, the last action is UNSURE: "I do not know".
    - Observation: the time is that of the whole search, and the fraction of objects not yet rejected follows.
    - Start: objects drawn from the scene's composition. A search of `activetouch compare` has the key (seed, target
      index, number).
    - Rewards: CONFIRM +1 if correct, else -1; REJECT 0, of the last object +1 if the target is absent, else -1; UNSURE
      `unsure_reward`; probe `-touch_cost`; truncation -1: the sum is :meth:`belief.SearchProblem.reward`.
    - End: CONFIRM, REJECT of the last object, or UNSURE, which leaves the observation as it is; a probe after
      `touch_limit` touches in all truncates.
    - Information: also `object_index`, the number of rejected objects, and with `unsure_reward` `is_unsure`.

    Args:
        scene: as of `activetouch/ObjectTest-v0`, and so are ``target``, ``touch_cost``, ``touches``, ``render_mode``,
            ``state`` and ``hand``.
        num_objects: that of the scene by default.
        composition: that of the scene by default.
        touch_limit: of the whole search; 12 per object by default.
        unsure_reward: reward of the action UNSURE, in [-1, 1); by default there is no such action.
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
        unsure_reward: float | None = None,
        state: str = "paper",
        hand: Hand | str | None = None,
    ) -> None:
        source = live_or_given(touches, scene, hand)
        named = SCENES.get(scene, NamedScene())
        number = named.num_objects if num_objects is None else num_objects
        problem = SearchProblem(
            source.model.shape_labels,
            source.pose_labels,
            number,
            named.composition if composition is None else composition,
            touch_cost,
            named.touches_per_object * number if touch_limit is None else touch_limit,
            unsure_reward,
        )
        super().__init__(problem, source, target, state, render_mode)

    @property
    def _num_more(self) -> int:
        return 1

    def observe(self) -> State:
        """The state and the fraction of objects left."""
        left = 1.0 - self._progress.num_rejected / self.problem.num_objects
        return np.append(super().observe(), np.float32(left))

    def _sample_arrangement(self, rng: np.random.Generator) -> tuple[int, ...]:
        return sample_arrangement(self.problem, rng)

    def _info(self, success: bool) -> dict[str, Any]:
        info = {**super()._info(success), "object_index": self._progress.num_rejected}
        return info if self.unsure is None else {**info, "is_unsure": self._progress.outcome is Outcome.UNSURE}
