"""Wrappers that change the observation or shape the reward.

    env = PosteriorState(gymnasium.make("activetouch.envs:activetouch/ObjectTest-v0", scene="coarse", target="cone"))

Only one wrapper may replace the observation; :class:`BeliefShaping` can be inside or outside of it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from activetouch.envs.base import TouchEnv
from belief.errors import ActiveTouchError
from belief.observation_model.evidence import start
from belief.policy_state import certainty, expected_gains, gains_state, posterior_state

_SMALLEST = 36  # pixels; the convolutions of common libraries need this many


class NoImage(ActiveTouchError, TypeError):
    """The touches have no images."""


class WrappedTwice(ActiveTouchError, TypeError):
    """Two wrappers replace the observation."""


def _untouched(env: gymnasium.Env, wrapper: type) -> TouchEnv:
    """The wrapped environment.

    Raises:
        WrappedTwice: a wrapper has replaced its observation.
    """
    own, inner = _touch_env(env), env
    while isinstance(inner, gymnasium.Wrapper):
        if isinstance(inner, gymnasium.ObservationWrapper) or inner.observation_space != inner.env.observation_space:
            raise WrappedTwice(
                f"{wrapper.__name__} and {type(inner).__name__} both replace the environment's observation: use one of "
                f"them. General wrappers go outside: FlattenObservation({wrapper.__name__}(env))"
            )
        inner = inner.env
    return own


def _touch_env(env: gymnasium.Env) -> TouchEnv:
    if not isinstance(env.unwrapped, TouchEnv):
        raise TypeError(f"this wrapper needs an environment of activetouch.envs, got {env.unwrapped}")
    return env.unwrapped


class PosteriorState(gymnasium.ObservationWrapper, RecordConstructorArgs):
    """The posterior as observation, a ``Box(-1, 1)`` of K + P + 2 numbers.

    It contains :func:`belief.policy_state.posterior_state` and, in a whole search, the fraction of objects left.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.ObservationWrapper.__init__(self, env)
        _untouched(env, type(self))
        size = cast(spaces.Box, env.observation_space).shape[0] - 1  # P poses and the log-odds replace P + 2 actions
        self.observation_space = spaces.Box(-1.0, 1.0, (size,), np.float32)

    def observation(self, observation: Any) -> NDArray[np.float32]:
        """The state in place of the paper's."""
        env = _touch_env(self.env)
        return env.observe(posterior_state(env.situation, env.target))


class GainState(PosteriorState):
    """The posterior and the expected gain of each pose as observation, a ``Box(-1, 1)`` of K + 2 P + 2 numbers.

    It contains :func:`belief.policy_state.gains_state` and, in a whole search, the fraction of objects left; with a
    target that is drawn at reset it is :func:`belief.policy_state.goal_state`.

    Raises:
        NoGains: the touches are of a sensor whose belief is not about one rigid body.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        own = _touch_env(env)
        labels = own.problem.shape_labels
        expected_gains(start(own.touches.model), np.full(len(labels), -np.log(len(labels))), 0)  # raises
        size = cast(spaces.Box, self.observation_space).shape[0] + own.problem.num_poses
        self.observation_space = spaces.Box(-1.0, 1.0, (size,), np.float32)

    def observation(self, observation: Any) -> NDArray[np.float32]:
        """The state in place of the paper's."""
        env = _touch_env(self.env)
        return env.observe(gains_state(replace(env.situation, gains=env.gains[None]), env.target))


class RawImage(gymnasium.ObservationWrapper, RecordConstructorArgs):
    """The sensor's image as observation, for policies with their own image encoder.

    A `Dict` of ``image``, ``(H, W, 1)`` or ``(H, W, 3)`` uint8, black before an object's first touch, and ``state``:
    the previous action, one-hot, the time, and in a whole search the fraction of objects left. Pixels are repeated so
    that images have at least 36 × 36.

    Raises:
        NoImage: the touches are not live.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.ObservationWrapper.__init__(self, env)
        touches = _untouched(env, type(self)).touches
        sensor = getattr(touches, "sensor", None)
        if sensor is None:
            raise NoImage(f"only live touches have images, got {type(touches).__name__}")
        height, width, *channels = sensor.scene.image_shape
        self._repeat = -(-_SMALLEST // min(height, width)) if min(height, width) < _SMALLEST else 1
        shape = (height * self._repeat, width * self._repeat, *(channels or [1]))
        old = cast(spaces.Box, env.observation_space)
        self._num_shapes = _touch_env(env).problem.num_shapes
        self.observation_space = spaces.Dict(
            image=spaces.Box(0, 255, shape, np.uint8),
            state=spaces.Box(0.0, 1.0, (old.shape[0] - self._num_shapes,), np.float32),
        )

    def observation(self, observation: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
        """Image and state."""
        shape = cast(spaces.Box, cast(spaces.Dict, self.observation_space)["image"]).shape
        press = _touch_env(self.env).last_press
        if press is None:
            image = np.zeros(shape, np.uint8)
        else:
            image = press.image.repeat(self._repeat, axis=0).repeat(self._repeat, axis=1).reshape(shape)
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
