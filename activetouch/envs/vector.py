"""The paper's task on recorded touches as a Gymnasium ``VectorEnv``."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from activetouch.envs.base import BadOption
from activetouch.envs.batched_episodes import BankEpisodes, as_actions


class BankVectorEnv(VectorEnv):
    """:class:`activetouch.envs.batched_episodes.BankEpisodes` for learners that use Gymnasium.

    An episode that ends is replaced in the same step; ``infos["final_obs"]`` has its last observation, and
    ``infos["final_info"]`` what Gymnasium's own environments say of it. ``infos`` also has ``is_success``,
    ``num_touches`` and ``target_prob`` of every episode before the replacement.

        bank = TouchBank.open(Path("data/coarse-bank/calibration"))
        envs = BankVectorEnv(BankEpisodes(bank, model, target="cone", num_envs=64, state="posterior"))
    """

    metadata: ClassVar[dict[str, Any]] = {"autoreset_mode": AutoresetMode.SAME_STEP}  # type: ignore[misc]

    def __init__(self, episodes: BankEpisodes) -> None:
        self._episodes, self._is_started = episodes, False
        self.num_envs = episodes.num_envs
        self.single_action_space = spaces.Discrete(episodes.num_actions)
        low = 0.0 if episodes.state == "paper" else -1.0
        self.single_observation_space = spaces.Box(low, 1.0, episodes.observe().shape[1:], np.float32)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def action_masks(self) -> NDArray[np.bool_]:
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
        self._is_started = True
        self._episodes.reset(np.arange(self.num_envs), self.np_random)
        return self._episodes.observe(), self._infos(np.zeros(self.num_envs, np.bool_))

    def step(
        self, actions: NDArray[np.integer]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Take one action in each episode.

        Raises:
            BadAction: there is not one action for each episode, or one is outside the action space.
            ResetNeeded: no episode was started.
        """
        if not self._is_started:
            raise ResetNeeded("no episode was started: call reset()")
        result = self._episodes.step(as_actions(actions))
        observations, infos = self._episodes.observe(), self._infos(result.success)
        ended = result.terminated | result.truncated
        rows = np.flatnonzero(ended)
        if rows.size:
            final = np.full(self.num_envs, None, object)
            for row in rows.tolist():
                final[row] = observations[row]
            last = infos | {f"_{name}": ended for name in infos}
            infos |= {"final_obs": final, "_final_obs": ended, "final_info": last, "_final_info": ended}
            self._episodes.reset(rows, self.np_random)
            observations = self._episodes.observe()
        return observations, result.reward, result.terminated, result.truncated, infos

    def _infos(self, success: NDArray[np.bool_]) -> dict[str, Any]:
        now = self._episodes
        probs = np.exp(now.log_probs[np.arange(self.num_envs), now.targets])
        return {"is_success": success, "num_touches": now.num_touches, "target_prob": probs}
