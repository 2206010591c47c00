"""Scenes as active classification tasks of ap_gym, for its agents; importing this module registers the id.

    env = ap_gym.make("activetouch.envs.apgym:activetouch/ShapeTouch-v0", scene="coarse")

Only this module needs ap_gym, the extra ``apgym``.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from ap_gym import ActiveClassificationEnv, ActiveClassificationLogWrapper, ImageSpace, register
from gymnasium import spaces
from numpy.typing import NDArray
from scipy.special import log_softmax

from activetouch.envs.drawing import draw
from activetouch.envs.object_search import BadAction, key_of
from activetouch.envs.touch_source import LiveTouches
from activetouch.sensor import TactileSensor
from belief.bayes import Belief
from belief.errors import UnknownName
from belief.seeding import arrangement_rng, touch_rng
from belief.validation import require_count

ID = "activetouch/ShapeTouch-v0"
REGULARIZATION = 1e-3
"""Price of an action per unit of its length, as in ap_gym's tasks."""


class ShapeTouchEnv(ActiveClassificationEnv[dict[str, NDArray[Any]], NDArray[np.floating]]):
    """Which shape is it? Each step presses the object in a pose; the prediction is of its shape.

    Spaces, loss and end are those of ap_gym's tasks: an action is ``{"action": a, "prediction": logits}``, and the
    reward is minus the normalised cross-entropy of the prediction, less ``REGULARIZATION`` ‖a‖. The entries of ``a``,
    ``(P,)`` in [-1, 1], are scores of the poses; the highest is pressed. The first press, at reset, is in a random
    pose. ``reset(options={"seed": (…)})`` makes the episode with that key.

    Args:
        scene: a named scene, with its shipped sensor.
        step_limit: steps of an episode, which then terminates.
        touches: another source of live touches.
        render_mode: "rgb_array" for the image and the prediction, side by side.

    Raises:
        InvalidArgument: the limit is below 1.
        UnknownName: the scene or the render mode is unknown.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 2}  # noqa: RUF012

    def __init__(
        self,
        scene: str = "gel",
        step_limit: int = 12,
        touches: LiveTouches | None = None,
        render_mode: str | None = None,
    ) -> None:
        require_count("step_limit", step_limit)
        if render_mode not in (None, "rgb_array"):
            raise UnknownName("render mode", str(render_mode), ["rgb_array"])
        source = touches if touches is not None else LiveTouches(TactileSensor.shipped(scene))
        self._touches, self._step_limit, self.render_mode = source, step_limit, render_mode
        self._labels, num_poses = source.model.shape_labels, len(source.pose_labels)
        super().__init__(len(self._labels), spaces.Box(-1.0, 1.0, (num_poses,), np.float32))
        height, width, *channels = source.sensor.scene.image_shape
        self.observation_space = spaces.Dict(
            sensor_img=ImageSpace(width, height, *(channels or [1])),
            sensor_pose=spaces.Box(0.0, 1.0, (num_poses,), np.float32),
            time_step=spaces.Box(-1.0, 1.0, (), np.float32),
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Start an episode with its first press."""
        key = key_of(options)
        super().reset(seed=seed)
        self._key = key if key is not None else (int(self.np_random.integers(2**32)),)
        rng = arrangement_rng(self._key)
        self._shape = int(rng.integers(len(self._labels)))
        self._world = self._touches.world((self._shape,), rng)
        self._uses = np.zeros(self.inner_action_space.shape[0], np.int64)
        self._log_probs = np.full(len(self._labels), -np.log(len(self._labels)))
        return self._press(int(rng.integers(len(self._uses)))), {"prediction": {"target": np.asarray(self._shape)}}

    def _step(
        self, action: NDArray[np.floating], prediction: NDArray[np.floating]
    ) -> tuple[dict[str, NDArray[Any]], float, bool, bool, dict[str, Any], NDArray[np.int64]]:
        if not (np.isfinite(action).all() and np.isfinite(prediction).all()):
            raise BadAction(f"actions and predictions must be finite, got {action} and {prediction}")
        self._log_probs = log_softmax(np.asarray(prediction, np.float64))
        seen = self._press(int(np.argmax(action)))
        price = REGULARIZATION * float(np.linalg.norm(action))
        return seen, -price, bool(self._uses.sum() > self._step_limit), False, {}, np.asarray(self._shape)

    def _press(self, pose: int) -> dict[str, NDArray[Any]]:
        image, _ = self._world.press(pose, touch_rng(self._key, 0, pose, int(self._uses[pose])))
        self._uses[pose] += 1
        self._image = image
        space = self.observation_space["sensor_img"]
        return {
            "sensor_img": (image.astype(np.float32) / 255.0).reshape(space.shape),
            "sensor_pose": (np.arange(len(self._uses)) == pose).astype(np.float32),
            "time_step": np.array(2.0 * (self._uses.sum() - 1) / self._step_limit - 1.0, np.float32),
        }

    def render(self) -> NDArray[np.uint8] | None:
        """The image and the prediction, side by side, ``(H, W, 3)`` uint8."""
        if self.render_mode is None:
            return None
        return draw(self._image, Belief(self._labels, self._log_probs), self._shape)


def _logged(**settings: Any) -> gymnasium.Env:
    return ActiveClassificationLogWrapper(ShapeTouchEnv(**settings))


if ID not in gymnasium.registry:  # also if the module is reloaded
    register(ID, _logged)
