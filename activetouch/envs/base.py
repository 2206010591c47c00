"""The environment that all others are: probe, confirm or reject the object in front of the pad."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from activetouch.envs.touch_source import EpisodeWorld, LiveTouches, Touches
from activetouch.hand import Hand
from activetouch.named_scenes import SCENES, NamedScene
from activetouch.sensor import TactileSensor
from belief.categorical import Belief
from belief.errors import ActiveTouchError, InvalidArgument, UnknownName
from belief.observation_model.evidence import start
from belief.policy_state import ENCODINGS, NO_ACTION, WITH_GAINS, Situation, expected_gains, frame_probs
from belief.problem import Action, Confirm, Probe, Reject, SearchProblem, TouchHistory, Unsure
from belief.scene_belief import SceneBelief
from belief.search_progress import Outcome, SearchProgress, success_of
from belief.seeding import arrangement_rng, checked_key, touch_rng

State = NDArray[np.float32]
STATES = ("paper", "posterior", "gains")
"""What an environment may observe: keys of :data:`belief.policy_state.ENCODINGS`."""


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
        state: what is observed, one of :data:`STATES`.
        render_mode: None, "rgb_array", or "human" for a window that follows the episode.

    Attributes:
        last_image: of the last press of the current object; None before the first, or without physics.

    Raises:
        UnknownName: the target, the state or the render mode is unknown.
        NoGains: the state is "gains", and the touches are of a sensor whose belief is not about one rigid body.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["human", "rgb_array"], "render_fps": 2}  # type: ignore[misc]

    def __init__(
        self, problem: SearchProblem, touches: Touches, target: str, state: str, render_mode: str | None
    ) -> None:
        labels = list(problem.shape_labels)
        for what, given, known in (
            ("target", target, labels),
            ("state", state, STATES),
            ("render mode", render_mode, (None, *self.metadata["render_modes"])),
        ):
            if given not in known:
                raise UnknownName(what, str(given), [str(name) for name in known])
        self.problem, self.touches, self.target, self.render_mode = problem, touches, labels.index(target), render_mode
        self.state = state
        if state in WITH_GAINS:
            expected_gains(start(touches.model), np.full(len(labels), -np.log(len(labels))), 0)  # raises
        self.last_image: NDArray[np.uint8] | None = None
        self._window: Window | None = None
        self._prior: Belief | None = None  # of every object of an ``independent`` problem
        self._begun: SearchProgress | None = None
        has_unsure = problem.unsure_reward is not None
        self.action_space: spaces.Discrete[Any] = spaces.Discrete(problem.num_poses + 2 + has_unsure)
        poses = {"paper": 3 + problem.num_poses, "posterior": 2 + problem.num_poses, "gains": 2 + 2 * problem.num_poses}
        size = problem.num_shapes + poses[state] + self._num_more
        self.observation_space = spaces.Box(0.0 if state == "paper" else -1.0, 1.0, (size,), np.float32)

    @property
    def _num_more(self) -> int:
        """Entries of an observation beyond the state."""
        return 0

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
    def _progress(self) -> SearchProgress:
        if self._begun is None:
            raise gymnasium.error.ResetNeeded("no episode was started: call reset()")
        return self._begun

    @property
    def _scene(self) -> SceneBelief:
        return self._progress.scene

    @property
    def belief(self) -> Belief:
        """The belief about the current object; raises ResetNeeded before the first episode."""
        return self._scene.belief(self._progress.object_index)

    @property
    def arrangement(self) -> tuple[int, ...]:
        """True shapes, in order of visit; for scoring only."""
        return self._arrangement

    @property
    def history(self) -> TouchHistory:
        """Touches of the current object, oldest first."""
        return self._scene.touches(self._progress.object_index)

    @property
    def situation(self) -> Situation:
        """The inputs of a policy, as a batch of one row; with gains if the state has them."""
        problem, history = self.problem, self.history
        log_probs, gains = self.belief.log_probs, None
        if self.state in WITH_GAINS:
            gains = expected_gains(self._scene.evidence(self._progress.object_index), log_probs, self.target)[None]
        frame = history[-1].require_logits() if history else np.zeros(problem.num_shapes)
        poses = np.array([touch.pose for touch in history], np.int64)
        return Situation(
            frame_probs(frame)[None],
            log_probs[None],
            np.array([self._previous]),
            np.bincount(poses, minlength=problem.num_poses)[None],
            np.array([self._progress.num_touches / problem.touch_limit]),
            gains,
        )

    def observe(self) -> State:
        """The observation ``(S,)``."""
        return ENCODINGS[self.state](self.situation, self.target)[0].astype(np.float32)

    def action_masks(self) -> NDArray[np.bool_]:
        """Valid actions, one of each in the action space: probes are invalid at the touch limit."""
        masks = np.ones(int(self.action_space.n), np.bool_)
        masks[: self.problem.num_poses] = self._progress.may_touch
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
        self._begun = SearchProgress(self.problem, self.touches.model, self._prior)
        self._previous = NO_ACTION
        self.last_image = None
        self._follow()
        return self.observe(), self._info(False)

    def step(self, action: int) -> tuple[State, float, bool, bool, dict[str, Any]]:
        """Probe, confirm, reject, or be unsure where the search has this action."""
        if self._begun is None or self._begun.outcome is not None:
            raise gymnasium.error.ResetNeeded("the episode is over or was not started: call reset()")
        if not self.action_space.contains(action):
            raise BadAction(f"action must be an integer in [0, {self.action_space.n - 1}], got {action!r}")
        reward, terminated, truncated, success = self._act(int(action))
        self._follow()
        return self.observe(), reward, terminated, truncated, self._info(success)

    def render(self) -> NDArray[np.uint8] | None:
        """The image of the last touch and the belief, side by side, ``(H, W, 3)`` uint8; or a window of it."""
        if self.render_mode is None:
            return None
        frame = draw(self.last_image, self.belief, self.target)
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            self._window = Window(type(self).__name__)
        self._window.show(frame)
        return None

    def _follow(self) -> None:
        """In mode "human", show the state without being asked."""
        if self.render_mode == "human":
            self.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    @abstractmethod
    def _sample_arrangement(self, rng: np.random.Generator) -> tuple[int, ...]:
        """Shapes of the objects of a new episode; sets ``_prior`` if the episode has its own."""

    @property
    def _truncation_reward(self) -> float:
        """Reward of the probe beyond the touch limit."""
        return -1.0

    def _act(self, action: int) -> tuple[float, bool, bool, bool]:
        """Reward, terminated, truncated, success."""
        problem, progress = self.problem, self._progress
        if action < self.confirm:
            if not progress.may_touch:
                progress.act(Probe(action))
                return self._truncation_reward, False, True, False
            self._probe(action)
            return -problem.touch_cost, False, False, False
        chosen: Action = Confirm() if action == self.confirm else Reject() if action == self.reject else Unsure()
        outcome = progress.act(chosen)
        if outcome is Outcome.UNSURE:
            assert problem.unsure_reward is not None, "the action exists"
            return problem.unsure_reward, True, False, False
        self._previous = action
        if outcome is None:
            self._world.advance()
            self.last_image = None
            return 0.0, False, False, False
        right = bool(success_of(outcome, self.target, self._arrangement, progress.object_index))
        return (1.0 if right else -1.0), True, False, right

    def _probe(self, pose: int) -> None:
        """Touch the current object."""
        progress = self._progress
        rng = touch_rng(self._key, progress.object_index, pose, progress.uses(pose))
        touch = self._world.touch(pose, rng)
        self.last_image = getattr(self._world, "last_image", None)
        progress.touch(touch)
        self._previous = pose

    def _info(self, success: bool) -> dict[str, Any]:
        prob = float(np.exp(self.belief.log_probs[self.target]))
        return {"is_success": success, "num_touches": self._progress.num_touches, "target_prob": prob}


def live_or_given(touches: Touches | None, scene: str, hand: Hand | str | None) -> Touches:
    """The given touches, or live touches of the scene's shipped sensor, or live grasps of a hand in the scene.

    Raises:
        UnknownName: there is no such sensor or hand.
        InvalidArgument: touches are given and a hand, too.
    """
    if touches is None:
        named = SCENES.get(scene, NamedScene())
        return LiveTouches(TactileSensor.shipped(scene, None if hand is None else named.scene.with_hand(hand)))
    if hand is not None:
        raise InvalidArgument(f"the given touches are made already; leave out the hand {hand!r:.80}")
    return touches


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


_SIZE = 240  # edge of each of the two panels [pixels]
_INK, _PAPER, _BAR, _TARGET = (40, 44, 52), (250, 250, 248), (150, 170, 200), (222, 122, 60)


def draw(image: NDArray[np.uint8] | None, belief: Belief, target: int) -> NDArray[np.uint8]:
    """The frame of an episode, ``(240, 480, 3)`` uint8.

    Args:
        image: of the last press; None leaves its panel blank.
        belief: about the current object.
        target: index of the target shape, whose bar has another colour.
    """
    picture = Image.new("RGB", (2 * _SIZE, _SIZE), _PAPER)
    if image is not None:
        picture.paste(Image.fromarray(image).convert("RGB").resize((_SIZE, _SIZE), Image.Resampling.NEAREST))
    pen, height = ImageDraw.Draw(picture), _SIZE / len(belief.labels)
    for index, (label, prob) in enumerate(zip(belief.labels, belief.probs, strict=True)):
        left, top = _SIZE + 8, index * height
        bar = [left, top + 0.55 * height, left + round((_SIZE - 16) * float(prob)), top + 0.9 * height]
        pen.rectangle(bar, fill=_TARGET if index == target else _BAR)
        pen.text((left, top + 0.1 * height), f"{label} {prob:.3f}", fill=_INK)
    return np.asarray(picture)


class Window:
    """A window of matplotlib that shows one frame after the other; where there is no display, nothing is seen."""

    def __init__(self, title: str) -> None:
        from matplotlib import pyplot  # takes half a second

        self._figure = pyplot.figure(num=title, figsize=(2 * _SIZE / 80, _SIZE / 80), dpi=80, clear=True)
        self._image: Any = None

    def show(self, frame: NDArray[np.uint8]) -> None:
        """Show a frame, ``(H, W, 3)`` uint8, in place of the last one."""
        if self._image is None:
            axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
            axes.set_axis_off()
            self._image = axes.imshow(frame)
        self._image.set_data(frame)
        self._figure.show(warn=False)
        self._figure.canvas.draw()
        self._figure.canvas.flush_events()

    def close(self) -> None:
        """Close the window."""
        from matplotlib import pyplot

        pyplot.close(self._figure)
