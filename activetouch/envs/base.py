"""The base class of the environments: probe, confirm or reject the object in front of the pad."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from activetouch.envs.touch_source import EpisodeWorld, LiveTouches, RecordedPress, Touches
from activetouch.sensor import TactileSensor
from belief import Belief, SceneBelief, SearchProblem, TouchHistory
from belief.errors import ActiveTouchError, InvalidArgument, UnknownName
from belief.policy_state import NO_ACTION, Situation, expected_gains, frame_probs, paper_state
from belief.seeding import arrangement_rng, checked_key, touch_rng

State = NDArray[np.float32]


class BadAction(ActiveTouchError, ValueError):
    """An action is outside the action space."""


class BadOption(ActiveTouchError, ValueError):
    """An option of ``reset()`` is unknown, or its value is invalid."""


class TouchEnv(gymnasium.Env[State, int]):
    """A sequence of objects to probe, confirm or reject.

    Args:
        problem: numbers of shapes, poses and objects, and the reward.
        touches: the source of touches.
        target: label of the target shape; the attribute ``target`` is its index.
        render_mode: None or "rgb_array".

    Attributes:
        last_press: the last press of the current object; None before the first, or without physics.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 2}  # type: ignore[misc]

    def __init__(self, problem: SearchProblem, touches: Touches, target: str, render_mode: str | None) -> None:
        labels = list(problem.shape_labels)
        if target not in labels:
            raise UnknownName("target", target, labels)
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise UnknownName("render mode", render_mode, self.metadata["render_modes"])
        self.problem, self.touches, self.target, self.render_mode = problem, touches, labels.index(target), render_mode
        self.last_press: RecordedPress | None = None
        self._prior: Belief | None = None  # of every object of an ``independent`` problem
        self._begun: SceneBelief | None = None
        self._is_over = True
        has_unsure = problem.unsure_reward is not None
        self.action_space: spaces.Discrete[Any] = spaces.Discrete(problem.num_poses + 2 + has_unsure)
        self.observation_space = spaces.Box(0.0, 1.0, (self._observation_size,), np.float32)

    @property
    def _observation_size(self) -> int:
        return self.problem.num_shapes + self.problem.num_poses + 3

    @property
    def confirm(self) -> int:
        """Index of the action CONFIRM; smaller indices are poses."""
        return self.problem.num_poses

    @property
    def reject(self) -> int:
        """Index of the action REJECT."""
        return self.problem.num_poses + 1

    @property
    def unsure(self) -> int | None:
        """Index of the action UNSURE, "I do not know"; None in a search without it."""
        return None if self.problem.unsure_reward is None else self.problem.num_poses + 2

    @property
    def _object_index(self) -> int:
        return min(self._num_rejected, self.problem.num_objects - 1)  # the last one stays once it is rejected

    @property
    def _scene(self) -> SceneBelief:
        if self._begun is None:
            raise gymnasium.error.ResetNeeded("no episode was started: call reset()")
        return self._begun

    @property
    def belief(self) -> Belief:
        """The belief about the current object; raises ResetNeeded before the first episode."""
        return self._scene.belief(self._object_index)

    @property
    def arrangement(self) -> tuple[int, ...]:
        """True shapes, in order of visit; for scoring only."""
        return self._arrangement

    @property
    def history(self) -> TouchHistory:
        """Touches of the current object, oldest first."""
        return self._scene.touches(self._object_index)

    @property
    def situation(self) -> Situation:
        """The inputs of a policy, as a batch of one row."""
        problem, history = self.problem, self.history
        frame = history[-1].require_logits() if history else np.zeros(problem.num_shapes)
        poses = np.array([touch.pose for touch in history], np.int64)
        return Situation(
            frame_probs(frame)[None],
            self.belief.log_probs[None],
            np.array([self._previous]),
            np.bincount(poses, minlength=problem.num_poses)[None],
            np.array([self._num_touches / problem.touch_limit]),
        )

    @property
    def gains(self) -> NDArray[np.float64]:
        """Expected information of the next touch in each pose about the target [nats], ``(P,)``.

        Raises:
            NoGains: the observation model is none of one rigid body.
        """
        return expected_gains(self._scene.evidence(self._object_index), self.belief.log_probs, self.target)

    def observe(self, state: NDArray[np.float64]) -> State:
        """The observation ``(S,)`` from an encoded situation ``(1, S)``."""
        return state[0].astype(np.float32)

    def action_masks(self) -> NDArray[np.bool_]:
        """Valid actions, one of each in the action space: probes are invalid at the touch limit."""
        masks = np.ones(int(self.action_space.n), np.bool_)
        masks[: self.problem.num_poses] = self._num_touches < self.problem.touch_limit
        return masks

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[State, dict[str, Any]]:
        """Start an episode; ``options={"seed": (0, 3, 17)}`` reproduces the episode with that key.

        Searches of ``activetouch compare`` have the keys (seed, target index, number).

        Raises:
            BadOption: an option is unknown, or the seed is no key.
        """
        key = key_of(options)
        super().reset(seed=seed)
        self._key = key if key is not None else (int(self.np_random.integers(2**32)),)
        rng = arrangement_rng(self._key)
        self._arrangement = self._sample_arrangement(rng)
        self._world: EpisodeWorld = self.touches.world(self._arrangement, rng)
        self._begun = SceneBelief(self.problem, self.touches.model, self._prior)
        self._num_rejected = self._num_touches = 0
        self._previous = NO_ACTION
        self._is_over = False
        self.last_press = None
        return self.observe(paper_state(self.situation, self.target)), self._info(False)

    def step(self, action: int) -> tuple[State, float, bool, bool, dict[str, Any]]:
        """Probe, confirm, reject, or be unsure where the search has this action."""
        if self._is_over:
            raise gymnasium.error.ResetNeeded("the episode is over or was not started: call reset()")
        if not self.action_space.contains(action):
            raise BadAction(f"action must be an integer in [0, {self.action_space.n - 1}], got {action!r}")
        reward, terminated, truncated, success = self._act(int(action))
        self._is_over = terminated or truncated
        observation = self.observe(paper_state(self.situation, self.target))
        return observation, reward, terminated, truncated, self._info(success)

    def render(self) -> NDArray[np.uint8] | None:
        """The scene, the touch image and the belief, side by side, ``(H, W, 3)`` uint8."""
        if self.render_mode is None:
            return None
        from activetouch.envs.picture import draw

        return draw(self.last_press, self.belief, self.target)

    @abstractmethod
    def _sample_arrangement(self, rng: np.random.Generator) -> tuple[int, ...]:
        """Shapes of the objects of a new episode; sets ``_prior`` if the episode has its own."""

    @abstractmethod
    def _act(self, action: int) -> tuple[float, bool, bool, bool]:
        """Reward, terminated, truncated, success."""

    def _probe(self, pose: int) -> None:
        """Touch the current object."""
        repeat = int(self.history.uses(self.problem.num_poses)[pose])
        touch = self._world.touch(pose, touch_rng(self._key, self._object_index, pose, repeat))
        self.last_press = getattr(self._world, "last_press", None)
        self._scene.update(self._object_index, [touch])
        self._num_touches += 1
        self._previous = pose

    def _info(self, success: bool) -> dict[str, Any]:
        prob = float(np.exp(self.belief.log_probs[self.target]))
        return {"is_success": success, "num_touches": self._num_touches, "target_prob": prob}


def live_or_given(touches: Touches | None, scene: str) -> Touches:
    """The given touches, or live touches of the scene's shipped sensor."""
    return touches if touches is not None else LiveTouches(TactileSensor.shipped(scene))


def key_of(options: Mapping[str, Any] | None) -> tuple[int, ...] | None:
    """The key of an episode in the options of ``reset()``; None if they have none.

    Raises:
        BadOption: an option is unknown, or the seed is no key.

    >>> key_of({"seed": [0, 3, 17]}), key_of(None)
    ((0, 3, 17), None)
    """
    given = {} if options is None else options
    if not isinstance(given, Mapping) or set(given) - {"seed"}:
        raise BadOption(f"reset() has one option, 'seed'; got {options!r}")
    key = given.get("seed")
    if key is None:
        return None
    if not isinstance(key, Sequence | np.ndarray) or isinstance(key, str | bytes) or not len(key):
        raise BadOption(f"the option 'seed' must be a key such as (0, 3, 17), got {key!r}")
    try:
        return checked_key(list(key))
    except InvalidArgument as error:
        raise BadOption(f"the option 'seed' must be a key such as (0, 3, 17): {error}") from error
