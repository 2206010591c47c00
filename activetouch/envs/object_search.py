"""The environment of a whole search: find the target among several objects, one in front of the pad at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from activetouch.envs.drawing import Window, draw
from activetouch.envs.search_episodes import Ints, SearchEpisodes, StepResult
from activetouch.envs.touch_source import EpisodeWorld, LiveTouches, Touches
from activetouch.extras import missing_package
from activetouch.hand import Hand
from activetouch.named_scenes import SCENES, NamedScene
from activetouch.sensor import TactileSensor
from activetouch.sensor_files import scene_of
from belief.bayes import Belief
from belief.composition import Composition
from belief.errors import ActiveTouchError, InvalidArgument, UnknownName
from belief.observation_model.evidence import start
from belief.policy_state import WITH_GAINS, Situation, expected_gains, frame_probs, state_size
from belief.problem import SearchProblem, TouchHistory
from belief.scene_belief import SceneBelief
from belief.search_progress import Outcome, right_outcomes
from belief.seeding import arrangement_rng, checked_key, touch_rng
from belief.synthetic import sample_arrangement

try:
    import gymnasium
    from gymnasium import spaces
except ModuleNotFoundError as error:
    raise missing_package(["gymnasium"], "rl") from error

State = NDArray[np.float32]
STATES = ("paper", "posterior", "gains")
"""What an environment may observe: keys of :data:`belief.policy_state.ENCODINGS`."""


class BadAction(ActiveTouchError, ValueError):
    """An action is outside the action space."""


class BadOption(ActiveTouchError, ValueError):
    """An option of ``reset()`` is unknown, or its value is invalid."""


class ObjectSearchEnv(gymnasium.Env[State, int]):
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

    Attributes:
        problem: numbers of shapes, poses and objects, and the reward.
        target: index of the target shape.
        last_image: of the last press of the current object; None before the first, or without physics.

    Raises:
        UnknownName: the scene, the target, the state or the render mode is unknown.
        NoGains: the state is "gains", and the touches are of a sensor whose belief is not about one rigid body.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["human", "rgb_array"], "render_fps": 2}  # type: ignore[misc]
    _num_more = 1  # entries of an observation beyond the state
    _truncation_reward = -1.0  # reward of the probe beyond the touch limit
    _begun: _OneSearch | None = None
    _prior: Belief | None = None  # of every object of an ``independent`` problem

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
        labels = list(problem.shape_labels)
        for what, given, known in (
            ("target", target, labels),
            ("state", state, STATES),
            ("render mode", render_mode, (None, *self.metadata["render_modes"])),
        ):
            if given not in known:
                raise UnknownName(what, str(given), [str(name) for name in known])
        self.touches, self.target, self.render_mode = source, labels.index(target), render_mode
        self.problem = problem.seeking(target)
        self.state = state
        if state in WITH_GAINS:
            expected_gains(start(source.model), np.full(len(labels), -np.log(len(labels))), 0)  # raises
        self._window: Window | None = None
        has_unsure = problem.unsure_reward is not None
        self.action_space: spaces.Discrete[Any] = spaces.Discrete(problem.num_poses + 2 + has_unsure)
        size = state_size(state, len(labels), problem.num_poses) + self._num_more
        self.observation_space = spaces.Box(0.0 if state == "paper" else -1.0, 1.0, (size,), np.float32)

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
    def _search(self) -> _OneSearch:
        if self._begun is None:
            raise gymnasium.error.ResetNeeded("no episode was started: call reset()")
        return self._begun

    @property
    def _scene(self) -> SceneBelief:
        return self._search.scene

    @property
    def belief(self) -> Belief:
        """The belief about the current object; raises ResetNeeded before the first episode."""
        return self._scene.belief(self._search.object_index)

    @property
    def arrangement(self) -> tuple[int, ...]:
        """True shapes, in order of visit; for scoring only."""
        return self._arrangement

    @property
    def history(self) -> TouchHistory:
        """Touches of the current object, oldest first."""
        return self._scene.touches(self._search.object_index)

    @property
    def last_image(self) -> NDArray[np.uint8] | None:
        """Image of the last press of the current object; None before the first, or without physics."""
        return None if self._begun is None else self._begun.last_image

    @property
    def situation(self) -> Situation:
        """The inputs of a policy, as a batch of one row; with gains if the state has them."""
        return self._search.situation()

    def observe(self) -> State:
        """The observation ``(S,)``."""
        return np.append(self._search.observe()[0], self._more()).astype(np.float32)

    def action_masks(self) -> NDArray[np.bool_]:
        """Valid actions, one of each in the action space: probes are invalid at the touch limit."""
        return self._search.action_masks()[0]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[State, dict[str, Any]]:
        """Start an episode; ``options={"seed": (0, 3, 17)}`` reproduces the episode with that key.

        Searches of ``activetouch compare`` have the keys (seed, target index, number), so in a search among several
        objects the second of three numbers must be the index of the target.

        Raises:
            BadOption: an option is unknown, the seed is no key, or it is the key of a search for another target.
        """
        key = key_of(options)
        if self.problem.num_objects > 1 and key is not None and len(key) == 3 and key[1] != self.target:
            labels = self.problem.shape_labels
            sought = f"the {labels[key[1]]}" if key[1] < len(labels) else f"shape {key[1]} of {len(labels)}"
            raise BadOption(
                f"the key {key} is of a search for {sought}, and this environment searches for the "
                f"{labels[self.target]}, which has the number {self.target}"
            )
        super().reset(seed=seed)
        key = key if key is not None else (int(self.np_random.integers(2**32)),)
        rng = arrangement_rng(key)
        self._arrangement = self._sample_arrangement(rng)
        world = self.touches.world(self._arrangement, rng)
        self._begun = _OneSearch(self, key, world, SceneBelief(self.problem, self.touches.model, self._prior))
        self._follow()
        return self.observe(), self._info(np.zeros(1, np.bool_))

    def step(self, action: int) -> tuple[State, float, bool, bool, dict[str, Any]]:
        """Probe, confirm, reject, or be unsure where the search has this action."""
        if self._begun is None or self._begun.progress.outcome(0) is not None:
            raise gymnasium.error.ResetNeeded("the episode is over or was not started: call reset()")
        if not self.action_space.contains(action):
            raise BadAction(f"action must be an integer in [0, {self.action_space.n - 1}], got {action!r}")
        result = self._begun.act(int(action))
        self._follow()
        ends = bool(result.terminated[0]), bool(result.truncated[0])
        return self.observe(), float(result.reward[0]), *ends, self._info(result.success)

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

    def _sample_arrangement(self, rng: np.random.Generator) -> tuple[int, ...]:
        """Shapes of the objects of a new episode; sets ``_prior`` if the episode has its own."""
        return sample_arrangement(self.problem, rng)

    def _more(self) -> NDArray[np.floating]:
        """What an observation has beyond the state: here the fraction of objects left."""
        return 1.0 - self._search.progress.num_rejected / self.problem.num_objects

    def _info(self, success: NDArray[np.bool_]) -> dict[str, Any]:
        facts = {name: column.item() for name, column in self._search.infos(success).items()}
        return facts | self._more_info()

    def _more_info(self) -> dict[str, Any]:
        progress = self._search.progress
        unsure = {} if self.unsure is None else {"is_unsure": progress.outcome(0) is Outcome.UNSURE}
        return {"object_index": progress.num_rejected.item(), **unsure}


class _OneSearch(SearchEpisodes):
    """The batch of one search, whose touches a world makes."""

    last_image: NDArray[np.uint8] | None = None

    def __init__(self, env: ObjectSearchEnv, key: tuple[int, ...], world: EpisodeWorld, scene: SceneBelief) -> None:
        super().__init__(env.problem, 1, env.state, env._truncation_reward)
        self._key, self._world, self.scene = key, world, scene
        self.targets[0] = env.target
        self.right = right_outcomes(self.targets, np.array([env.arrangement]))
        self._face(scene.belief(0))

    @property
    def object_index(self) -> int:
        return int(self.progress.objects[0])

    def act(self, action: int) -> StepResult:
        return self._step(np.array([action]))

    def _touch(self, rows: Ints, poses: Ints) -> None:
        index, pose = self.object_index, int(poses[0])
        touch = self._world.touch(pose, touch_rng(self._key, index, pose, int(self.uses[0, pose])))
        self.last_image = getattr(self._world, "last_image", None)
        belief, self.uses = self.scene.update(index, [touch]), self.uses.copy()
        self.uses[0, pose] += 1
        self._know(belief, frame_probs(touch.require_logits()))

    def _advance(self, rows: Ints) -> None:
        self._world.advance()
        self.last_image = None
        self._face(self.scene.belief(self.object_index))

    def _face(self, belief: Belief) -> None:
        """Begin with an object that was not touched yet."""
        self.uses = np.zeros_like(self.uses)
        self._know(belief, np.full(len(belief.labels), 1.0 / len(belief.labels)))

    def _know(self, belief: Belief, frame: NDArray[np.float64]) -> None:
        """Set what is known of the current object."""
        self.log_probs, self._frame_probs = belief.log_probs[None], frame[None]
        if self.state in WITH_GAINS:
            evidence = self.scene.evidence(self.object_index)
            self._gains = expected_gains(evidence, belief.log_probs, int(self.targets[0]))[None]


def live_or_given(touches: Touches | None, scene: str, hand: Hand | str | None) -> Touches:
    """The given touches, or live touches of the scene's shipped sensor, or live grasps of a hand in the scene."""
    if touches is None:
        if not isinstance(scene, str):
            raise InvalidArgument(
                f"scene is the name of a scene, got {scene!r:.80}; of a scene or meshes of your own give "
                "touches=LiveTouches(sensor)"
            )
        if scene_of(scene) not in SCENES:
            raise UnknownName("scene", scene, [*SCENES])
        named = SCENES.get(scene, NamedScene())
        return LiveTouches(TactileSensor.shipped(scene, None if hand is None else named.scene.with_hand(hand)))
    if hand is not None:
        raise InvalidArgument(f"the given touches are made already; leave out the hand {hand!r:.80}")
    return touches


def key_of(options: Mapping[str, Any] | None) -> tuple[int, ...] | None:
    """The key of an episode in the options of ``reset()``, or None; raises BadOption for any other option.

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
