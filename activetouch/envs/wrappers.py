"""Wrappers that change the observation or shape the reward.

env = RawImage(gymnasium.make("activetouch:activetouch/ObjectTest-v0", scene="coarse", target="cone"))
"""

from __future__ import annotations

from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from activetouch.envs.base import TouchEnv
from belief.errors import ActiveTouchError
from belief.policy_state import certainty

_SMALLEST = 36  # pixels; the convolutions of common libraries need this many


class NoImage(ActiveTouchError, TypeError):
    """There is no image to observe."""


def _touch_env(env: gymnasium.Env) -> TouchEnv:
    if not isinstance(env.unwrapped, TouchEnv):
        raise TypeError(f"this wrapper needs an environment of activetouch.envs, got {env.unwrapped}")
    return env.unwrapped


class RawImage(gymnasium.ObservationWrapper, RecordConstructorArgs):
    """The sensor's image as observation, for policies with their own image encoder.

    A `Dict` of ``image``, ``(H, W, 1)`` or ``(H, W, 3)`` uint8, black before an object's first touch, and ``state``:
    the previous action, one-hot, the time, and in a whole search the fraction of objects left. Pixels are repeated so
    that images have at least 36 × 36.

    Raises:
        NoImage: the touches are not live, or another observation was replaced already.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.ObservationWrapper.__init__(self, env)
        own = _touch_env(env)
        sensor = getattr(own.touches, "sensor", None)
        if sensor is None:
            raise NoImage(f"only live touches have images, got {type(own.touches).__name__}")
        height, width, *channels = sensor.scene.image_shape
        self._repeat = -(-_SMALLEST // min(height, width)) if min(height, width) < _SMALLEST else 1
        shape = (height * self._repeat, width * self._repeat, *(channels or [1]))
        if own.state != "paper" or env.observation_space != own.observation_space:
            raise NoImage("RawImage replaces the observation of the state 'paper'; put it inside of other wrappers")
        self._num_shapes, size = own.problem.num_shapes, cast(spaces.Box, own.observation_space).shape[0]
        self.observation_space = spaces.Dict(
            image=spaces.Box(0, 255, shape, np.uint8),
            state=spaces.Box(0.0, 1.0, (size - self._num_shapes,), np.float32),
        )

    def observation(self, observation: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
        """Image and state."""
        shape = cast(spaces.Box, cast(spaces.Dict, self.observation_space)["image"]).shape
        seen = _touch_env(self.env).last_image
        if seen is None:
            image = np.zeros(shape, np.uint8)
        else:
            image = seen.repeat(self._repeat, axis=0).repeat(self._repeat, axis=1).reshape(shape)
        return {"image": image, "state": observation[self._num_shapes :]}


class BeliefShaping(gymnasium.Wrapper, RecordConstructorArgs):
    """Potential-based shaping of the reward by the certainty of the belief: the paper's β (decision 0031).

    Adds β (γ Φ(s') - Φ(s)) with Φ = |:func:`belief.policy_state.certainty`|, and Φ = 0 after termination. This does not
    change the optimal policy (Ng, Harada & Russell 1999).

    Args:
        env: the environment.
        beta: β, ≥ 0.
        discount: γ of the learner.
    """

    def __init__(self, env: gymnasium.Env, beta: float, discount: float) -> None:
        RecordConstructorArgs.__init__(self, beta=beta, discount=discount)
        gymnasium.Wrapper.__init__(self, env)
        _touch_env(env)  # raises
        if not (0.0 <= beta < np.inf and 0.0 <= discount <= 1.0):
            raise ValueError(f"need a finite beta ≥ 0 and a discount in [0, 1], got {beta} and {discount}")
        self._beta, self._discount = beta, discount
        self._potential = 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """See :class:`gymnasium.Env`."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._potential = self._of_belief()
        return observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """See :class:`gymnasium.Env`; ``info["reward"]`` is the reward without shaping."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        before, self._potential = self._potential, 0.0 if terminated else self._of_belief()
        shaped = float(reward) + self._beta * (self._discount * self._potential - before)
        return observation, shaped, terminated, truncated, {**info, "reward": float(reward)}

    def _of_belief(self) -> float:
        env = _touch_env(self.env)
        return float(abs(certainty(env.belief.log_probs, env.target)))
