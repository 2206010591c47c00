"""A wrapper that changes the observation.

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

_SMALLEST = 36  # pixels; the convolutions of common libraries need this many


class NoImage(ActiveTouchError, TypeError):
    """There is no image to observe."""


class RawImage(gymnasium.ObservationWrapper, RecordConstructorArgs):
    """The sensor's image as observation, for policies with their own image encoder.

    A `Dict` of ``image``, ``(H, W, 1)`` or ``(H, W, 3)`` uint8, black before an object's first touch, and ``state``:
    the previous action, one-hot, the time, and in a whole search the fraction of objects left. Pixels are repeated so
    that images have at least 36 × 36.

    Raises:
        NoImage: the touches are not live, or another observation was replaced already.
        TypeError: it is no environment of this package.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.ObservationWrapper.__init__(self, env)
        own = env.unwrapped
        if not isinstance(own, TouchEnv):
            raise TypeError(f"this wrapper needs an environment of activetouch.envs, got {own}")
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
        seen = cast(TouchEnv, self.unwrapped).last_image
        if seen is None:
            image = np.zeros(shape, np.uint8)
        else:
            image = seen.repeat(self._repeat, axis=0).repeat(self._repeat, axis=1).reshape(shape)
        return {"image": image, "state": observation[self._num_shapes :]}
