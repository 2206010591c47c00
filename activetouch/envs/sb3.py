"""The paper's task on recorded touches as a ``VecEnv`` of Stable-Baselines3; importing this module loads torch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.object_search import BadOption
from activetouch.extras import missing_package
from belief.seeding import checked_key, keyed_rng

try:
    from stable_baselines3.common.vec_env import VecEnv
except ModuleNotFoundError as error:
    raise missing_package(["stable_baselines3"], "rl") from error


class BankVecEnv(VecEnv):
    """:class:`activetouch.envs.batched_episodes.BankEpisodes` for learners of Stable-Baselines3.

    When an episode ends, its ``info`` has ``episode`` (shaped return, length), ``is_success`` and SB3's own keys.
    Truncation counts as termination: T_max is part of the task and of the state (decision 0031).

    Args:
        episodes: the episodes.
        seed: of the generator, one number or several; the seed set by ``seed()`` is appended.
    """

    def __init__(self, episodes: BankEpisodes, seed: int | Sequence[int]) -> None:
        self._episodes, self._seed = episodes, checked_key(seed)
        self._rng = keyed_rng(seed, is_fixed_length=True)
        self._returns, self._lengths = np.zeros(episodes.num_envs), np.zeros(episodes.num_envs, np.int64)
        self.render_mode = None
        super().__init__(episodes.num_envs, episodes.single_observation_space, episodes.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """Start new episodes in all rows; raises BadOption if options were set."""
        options = next((given for given in self._options if given), None)
        if options:
            raise BadOption(f"reset() of episodes from a bank has no options, got {options!r}")
        self._reset_options()
        if self._seeds[0] is not None:
            self._rng = keyed_rng([*self._seed, self._seeds[0]], is_fixed_length=True)
        self._reset_seeds()
        self._returns[:], self._lengths[:] = 0.0, 0
        self._episodes.restart(np.arange(self.num_envs), self._rng)
        return self._episodes.observe()

    def step_async(self, actions: NDArray[np.integer]) -> None:
        """Set the actions of the next :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Take the actions; replace episodes that end by new ones."""
        result, final = self._episodes.act(self._actions), self._episodes.observe()
        self._returns += result.reward
        self._lengths += 1
        ended = result.terminated | result.truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(ended).tolist():
            infos[row] = {
                "terminal_observation": final[row],
                "TimeLimit.truncated": False,
                "is_success": bool(result.success[row]),
                "episode": {"r": float(self._returns[row]), "l": int(self._lengths[row]), "t": 0.0},
            }
        self._returns[ended], self._lengths[ended] = 0.0, 0
        if ended.any():
            self._episodes.restart(np.flatnonzero(ended), self._rng)
            final = self._episodes.observe()
        return final, result.reward.astype(np.float32), ended, infos

    def close(self) -> None:
        """Do nothing."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the environment, repeated for each row."""
        return [getattr(self, attr_name)] * len(self._rows(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise ``NotImplementedError``: rows have no own attributes."""
        raise NotImplementedError(f"{type(self).__name__} cannot set {attr_name}: its rows share everything")

    def action_masks(self) -> NDArray[np.bool_]:
        """Valid actions, ``(B, P + 2)``."""
        return self._episodes.action_masks()

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Only ``action_masks``, which :class:`sb3_contrib.MaskablePPO` asks for."""
        if method_name != "action_masks":
            raise AttributeError(f"{type(self).__name__} has no method {method_name!r} of single rows")
        return list(self.action_masks()[self._rows(indices)])

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """False for each row."""
        return [False] * len(self._rows(indices))

    def _rows(self, indices: int | Sequence[int] | None) -> NDArray[np.intp]:
        return np.atleast_1d(np.arange(self.num_envs) if indices is None else np.asarray(indices))
