"""The paper's task on recorded touches as a Gymnasium ``VectorEnv``, with several hundred thousand steps per second.

envs = gymnasium.make_vec("activetouch:activetouch/ObjectTestBank-v0", num_envs=256, target="cone")
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from activetouch.envs.base import BadOption
from activetouch.envs.batched_episodes import BankEpisodes

Bools = NDArray[np.bool_]


class BankVectorEnv(VectorEnv):
    """:class:`activetouch.envs.batched_episodes.BankEpisodes` for learners that use Gymnasium.

    ``infos`` has ``is_success``, ``num_touches`` and ``target_prob`` of every episode.

    Args:
        episodes: the episodes.
        autoreset_mode: NEXT_STEP, in which the action after the end of an episode starts another one, or SAME_STEP.

    Raises:
        BadOption: the mode is DISABLED.
    """

    def __init__(self, episodes: BankEpisodes, autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP) -> None:
        mode = AutoresetMode(autoreset_mode)
        if mode is AutoresetMode.DISABLED:
            raise BadOption(f"autoreset_mode must be NEXT_STEP or SAME_STEP, got {autoreset_mode}")
        self._episodes, self._is_started, self._is_same_step = episodes, False, mode is AutoresetMode.SAME_STEP
        self._over = np.zeros(episodes.num_envs, np.bool_)  # to start again in the next step
        self.metadata, self.num_envs = {"autoreset_mode": mode}, episodes.num_envs
        self.single_action_space = spaces.Discrete(episodes.num_actions)
        self.single_observation_space = episodes.observation_space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def action_masks(self) -> Bools:
        """Valid actions, ``(B, P + 2)``."""
        return self._episodes.action_masks()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start new episodes in all rows.

        Raises:
            BadOption: there are options.
        """
        if options:
            raise BadOption(f"reset() of episodes from a bank has no options, got {options!r}")
        super().reset(seed=seed)
        self._is_started, self._over = True, np.zeros(self.num_envs, np.bool_)
        self._episodes.reset(np.arange(self.num_envs), self.np_random)
        return self._episodes.observe(), self._infos(self._over.copy())

    def step(
        self, actions: NDArray[np.integer]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], Bools, Bools, dict[str, Any]]:
        """Take one action in each episode.

        Raises:
            BadAction: there is not one action for each episode, or one is outside the action space.
            ResetNeeded: no episode was started.
        """
        if not self._is_started:
            raise ResetNeeded("no episode was started: call reset()")
        now, over = self._episodes, self._over
        result = now.step(actions)
        terminated, truncated, success = (~over & flags for flags in result[1:])
        if over.any():
            now.reset(np.flatnonzero(over), self.np_random)
        observations, infos, ended = now.observe(), self._infos(success), terminated | truncated
        if not self._is_same_step:
            self._over = ended
        elif ended.any():
            final, rows = np.full(self.num_envs, None, object), np.flatnonzero(ended)
            final[rows] = list(observations[rows])
            last = infos | {f"_{name}": ended for name in infos}
            infos = infos | {"final_obs": final, "_final_obs": ended, "final_info": last, "_final_info": ended}
            now.reset(rows, self.np_random)
            observations = now.observe()
        return observations, np.where(over, 0.0, result.reward), terminated, truncated, infos

    def _infos(self, success: Bools) -> dict[str, Any]:
        now = self._episodes
        probs = np.exp(now.log_probs[np.arange(self.num_envs), now.targets])
        return {"is_success": success, "num_touches": now.num_touches, "target_prob": probs}


def recorded_tests(
    num_envs: int = 1,
    scene: str = "paper",
    target: str = "cone",
    autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
    **settings: Any,
) -> BankVectorEnv:
    """What ``gymnasium.make_vec("activetouch/ObjectTestBank-v0")`` makes; see :meth:`BankEpisodes.shipped`."""
    return BankVectorEnv(BankEpisodes.shipped(scene, target, num_envs, **settings), autoreset_mode)
