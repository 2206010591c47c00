"""The paper's task on recorded touches: many episodes at once, as array operations, for learners of Gymnasium.

envs = gymnasium.make_vec("activetouch:activetouch/ObjectTestBank-v0", num_envs=256, target="cone")
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from activetouch.envs.bank_evidence import BankEvidence, JointEvidence, evidence_of
from activetouch.envs.object_search import BadAction, BadOption
from activetouch.envs.search_episodes import Bools, Ints, SearchEpisodes, StepResult
from activetouch.envs.touch_bank import TouchBank
from activetouch.envs.touch_source import ObjectPriors, TargetProb
from activetouch.errors import LabelMismatch
from activetouch.extras import missing_package
from activetouch.sensor_files import INDEPENDENT_SUFFIX, MODELS, fitted_model
from belief.bayes import update
from belief.composition import Composition
from belief.errors import InvalidArgument, UnknownName
from belief.observation_model.model import ArrayModel
from belief.policy_state import (
    ENCODINGS,
    GOAL,
    NO_ACTION,
    TOUCH_LIMIT,
    WITH_GAINS,
    certainty,
    frame_probs,
)
from belief.problem import SearchProblem
from belief.search_progress import right_outcomes
from belief.seeding import checked_key

try:
    from gymnasium import spaces
    from gymnasium.error import ResetNeeded
    from gymnasium.utils.seeding import np_random
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ModuleNotFoundError as error:
    raise missing_package(["gymnasium"], "rl") from error


class BankEpisodes(SearchEpisodes, VectorEnv):
    """B parallel episodes of :class:`activetouch.envs.object_test.ObjectTestEnv` on recorded touches.

    The first R touches of an object in a pose come from R different rounds of the bank, starting at a random one; then
    the rounds repeat. With gains they start at the first, so that equal touches, which take long to weigh, come again.

    ``infos`` of :meth:`reset` and :meth:`step` have ``is_success``, ``num_touches`` and ``target_prob`` of every
    episode. :meth:`restart` and :meth:`act` are the same for programs that start episodes themselves.

    Args:
        bank: the touches.
        model: the observation model.
        target: label of the target shape; None to draw one for every episode, which observations end with, one-hot.
        num_envs: B.
        state: encoding of the observations, a key of :data:`belief.policy_state.ENCODINGS`.
        touch_cost: λ.
        touch_limit: T_max.
        target_prob: prior of the target, or a range from which every episode draws its own.
        beta: weight β of the paper's shaping reward (decision 0031): β (γ Φ(s') - Φ(s)) is added with
            Φ = |:func:`belief.policy_state.certainty`|, 0 after a decision, which changes no optimal policy.
        discount: γ of the learner, for the shaping.
        autoreset_mode: NEXT_STEP, in which the action after the end of an episode starts another one, SAME_STEP, or
            DISABLED, in which only :meth:`reset` does.

    Attributes:
        objects: index of each episode's object in the bank, ``(B,)``.
        targets: index of its target shape, ``(B,)``.
        uses: number of its touches in each pose, ``(B, P)``.
        log_probs: its log posterior, ``(B, K)``.

    Raises:
        UnknownName: the target or the state is unknown.
        BadOption: the state "goal" has a fixed target, or a number is out of its range.
        ValueError: touch_cost or touch_limit is out of its range.
        LabelMismatch: bank and model have different shapes or poses.
        NoGains: the state has gains, and the model is no joint model or the bank has no features.
    """

    _gains: NDArray[np.float64]  # zeros where the state has none

    def __init__(
        self,
        bank: TouchBank,
        model: ArrayModel,
        target: str | None,
        num_envs: int,
        state: str = "paper",
        touch_cost: float = 0.02,
        touch_limit: int = TOUCH_LIMIT,
        target_prob: TargetProb = 0.5,
        beta: float = 0.0,
        discount: float = 1.0,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
    ) -> None:
        if target is not None and target not in bank.shape_labels:
            raise UnknownName("target", target, list(bank.shape_labels))
        if state not in ENCODINGS:
            raise UnknownName("state", state, list(ENCODINGS))
        if target is not None and state == GOAL:
            raise BadOption(f"the state {GOAL!r} goes with target=None, got target={target!r}")
        if num_envs < 1:
            raise BadOption(f"num_envs must be at least 1, got {num_envs}")
        if not (0.0 <= beta < np.inf and 0.0 <= discount <= 1.0):
            raise BadOption(f"need a finite beta ≥ 0 and a discount in [0, 1], got {beta} and {discount}")
        if (bank.shape_labels, bank.num_poses) != (tuple(model.shape_labels), model.num_poses):
            raise LabelMismatch(
                f"the bank has the shapes {list(bank.shape_labels)} in {bank.num_poses} poses, the model has "
                f"{list(model.shape_labels)} in {model.num_poses}"
            )
        labels = bank.shape_labels, bank.pose_labels
        problem = SearchProblem(*labels, 1, Composition.INDEPENDENT, touch_cost, touch_limit)
        super().__init__(problem, num_envs, state, -problem.touch_cost)
        self.bank, self.touch_limit = bank, touch_limit
        self._shapes = np.array(bank.shapes)  # a copy: a file mapped into memory is slow to index
        self.num_poses = len(bank.pose_labels)
        only = 0 if target is None else bank.shape_labels.index(target)
        self.targets[:], self._draws_target = only, target is None
        self._beta, self._discount = beta, discount
        self._priors = ObjectPriors.of(len(bank.shape_labels), target_prob)
        self._of_shape = [np.flatnonzero(bank.shapes == shape) for shape in range(len(bank.shape_labels))]
        self._frames = frame_probs(bank.logits)  # (N, R, P, K)
        make = JointEvidence if state in WITH_GAINS else evidence_of
        self._evidence: BankEvidence = make(bank, model, num_envs, touch_limit)
        self._log_priors, self.objects = np.zeros_like(self.log_probs), np.zeros(num_envs, np.int64)
        self._first_rounds, self._gains = np.zeros_like(self.uses), np.zeros(self.uses.shape)
        self._potential = np.zeros(num_envs)
        self.begin(np.arange(num_envs), self.objects)
        self.metadata = {"autoreset_mode": AutoresetMode(autoreset_mode)}
        self._generators: dict[int, np.random.Generator] = {}  # generators of rows with their own seed
        self._is_started, self._over = False, np.zeros(num_envs, np.bool_)  # to start again in the next step
        self.single_action_space = spaces.Discrete(self.num_poses + 2)
        least = 0.0 if state == "paper" else -1.0  # a saved policy shows by it which state it observed
        self.single_observation_space = spaces.Box(least, 1.0, self.observe().shape[1:], np.float32)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    @classmethod
    def shipped(
        cls, scene: str = "paper", target: str | None = "cone", num_envs: int = 1, **settings: Any
    ) -> BankEpisodes:
        """Episodes on the recorded touches of a scene that come with the package.

        Args:
            scene: name of a scene with a bank.
            target: label of the target shape.
            num_envs: number of parallel episodes.
            settings: further arguments of the class.

        Raises:
            UnknownName: the scene has no bank, or the target is unknown.
        """
        bank = TouchBank.shipped(scene)
        model = fitted_model(MODELS / f"{scene}{INDEPENDENT_SUFFIX}").model
        return cls(bank, model, target, num_envs, **settings)

    def observe(self) -> NDArray[np.float32]:
        """The observations, ``(B, S)``; a drawn target comes last, one-hot, as in ``ObjectTestGoal-v0``."""
        seen = super().observe()
        if not self._draws_target or self.state == GOAL:
            return seen
        is_target = self.targets[:, None] == np.arange(self.log_probs.shape[1])
        return np.concatenate([seen, is_target.astype(np.float32)], axis=1)

    @property
    def num_touches(self) -> Ints:
        """Number of touches made, ``(B,)``; a copy."""
        return self.progress.num_touches.copy()

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start new episodes in all rows, or in those where ``options["reset_mask"]``, ``(B,)`` bool, is true.

        One seed is that of all rows together. A list gives each row a generator of its own, also for its later
        episodes; a row with None keeps the one that it has. With a mask, a single seed s is the list s, s + 1, ….

        Raises:
            BadOption: there is another option, or the mask or the list does not fit the rows.
            ResetNeeded: a mask leaves out rows that never began.
        """
        rows = self._rows_of(options)
        if len(rows) < self.num_envs and not self._is_started:
            raise ResetNeeded("no episode was started: call reset() without a mask")
        if isinstance(seed, Sequence | np.ndarray) or (options and seed is not None):
            keys = self._keys_of(seed)
            self._generators |= {row: np_random(key)[0] for row in rows.tolist() if (key := keys[row]) is not None}
        elif not options:
            super().reset(seed=seed)
            self._generators = self._generators if seed is None else {}
        self._is_started, self._over[rows] = True, False
        self._start(rows)
        return self.observe(), self.infos(np.zeros(self.num_envs, np.bool_))

    def _rows_of(self, options: dict[str, Any] | None) -> Ints:
        """The rows that the options of :meth:`reset` select."""
        mask = np.asarray([True] * self.num_envs if not options else options.get("reset_mask"))
        fits = mask.shape == (self.num_envs,) and mask.dtype == np.bool_ and mask.any()
        if not fits or set(options or ()) - {"reset_mask"}:
            raise BadOption(
                f"reset() of episodes from a bank has one option, 'reset_mask', {self.num_envs} booleans of which one "
                f"is true; got {options!r}"
            )
        return np.flatnonzero(mask)

    def _keys_of(self, seed: int | Sequence[int | None]) -> list[int | None]:
        """The seed of each row."""
        seeds = seed if isinstance(seed, Sequence | np.ndarray) else [seed + row for row in range(self.num_envs)]
        try:
            keys = [None if one is None else checked_key(one)[0] for one in seeds]
        except InvalidArgument as error:
            raise BadOption(str(error)) from error
        if len(keys) != self.num_envs:
            raise BadOption(f"a list of seeds has one for each of the {self.num_envs} rows, got {len(keys)}")
        return keys

    def _start(self, rows: Ints) -> None:
        """Start new random episodes in rows: those with a generator of their own one by one, the others together."""
        own = [row for row in rows.tolist() if row in self._generators]
        for row in own:
            self.restart(np.array([row]), self._generators[row])
        if len(own) < len(rows):
            self.restart(np.setdiff1d(rows, own), self.np_random)

    def step(
        self, actions: NDArray[np.integer]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], Bools, Bools, dict[str, Any]]:
        """Take one action in each episode; errors as :meth:`act`, and ResetNeeded if one was not started."""
        over, mode = self._over, self.metadata["autoreset_mode"]
        if not self._is_started:
            raise ResetNeeded("no episode was started: call reset()")
        if mode is AutoresetMode.DISABLED and over.any():
            raise ResetNeeded(f"the episodes of the rows {np.flatnonzero(over).tolist()} are over: call reset()")
        result = self.act(actions)
        terminated, truncated, success = (~over & flags for flags in result[1:])
        if over.any():
            self._start(np.flatnonzero(over))
        observations, infos, ended = self.observe(), self.infos(success), terminated | truncated
        if mode is not AutoresetMode.SAME_STEP:
            self._over = ended
        elif ended.any():
            final, rows = np.full(self.num_envs, None, object), np.flatnonzero(ended)
            final[rows] = list(observations[rows])
            last = infos | {f"_{name}": ended for name in infos}
            infos = infos | {"final_obs": final, "_final_obs": ended, "final_info": last, "_final_info": ended}
            self._start(rows)
            observations = self.observe()
        return observations, np.where(over, 0.0, result.reward), terminated, truncated, infos

    def restart(self, rows: Ints, rng: np.random.Generator) -> None:
        """Start new random episodes in these rows."""
        if self._draws_target:
            self.targets[rows] = rng.integers(len(self._of_shape), size=len(rows))
        target_probs = self._priors.draw(rng, len(rows))
        shapes = _choose(self._priors.probs(target_probs, self.targets[rows]), rng)
        place = rng.random(len(rows))
        objects = np.empty(len(rows), np.int64)
        for shape, members in enumerate(self._of_shape):
            here = shapes == shape
            objects[here] = members[(place[here] * len(members)).astype(np.int64)]
        starts = 1 if self.state in WITH_GAINS else self.bank.num_rounds
        first_rounds = rng.integers(starts, size=(len(rows), self.num_poses))
        self.begin(rows, objects, first_rounds, target_probs)

    def begin(
        self, rows: Ints, objects: Ints, first_rounds: Ints | int = 0, target_probs: ArrayLike | None = None
    ) -> None:
        """Start episodes with given objects, and the targets that :attr:`targets` holds.

        Args:
            rows: of the batch, ``(n,)``.
            objects: indices in the bank, ``(n,)``.
            first_rounds: round of the first touch in each pose, ``(n, P)``.
            target_probs: priors of the target, ``(n,)``; by default the middle of the range.
        """
        start = self._priors.middle if target_probs is None else target_probs
        probs = np.broadcast_to(np.asarray(start, np.float64), (len(rows),))
        self._log_priors[rows] = np.log(self._priors.probs(probs, self.targets[rows]))
        self.objects[rows], self._first_rounds[rows] = objects, first_rounds
        self.right[rows] = right_outcomes(self.targets[rows], self._shapes[self.objects[rows]][:, None])
        self.uses[rows] = 0
        self.log_probs[rows], self._frame_probs[rows] = self._log_priors[rows], 1.0 / self.log_probs.shape[1]
        self._previous[rows] = NO_ACTION
        self.progress.begin(rows)
        if self._beta:
            self._potential[rows] = self._potential_of(rows)
        self._evidence.forget(rows)
        self._ask_gains(rows)

    def act(self, actions: NDArray[np.integer]) -> StepResult:
        """Take one action in each episode; episodes that end keep their state until they are started again.

        Raises:
            BadAction: there is not one action for each episode, or one is outside the action space or no integer.
        """
        chosen, limit = np.asarray(actions), self.num_poses + 1
        are_integers = chosen.dtype.kind in "iu" and chosen.shape == (self.num_envs,)
        if not (are_integers and chosen.min() >= 0 and chosen.max() <= limit):
            found = f"{chosen.shape} {chosen.dtype}: {chosen}"
            raise BadAction(f"actions must be {self.num_envs} integers in [0, {limit}], got {found}")
        return self._step(chosen.astype(np.int64, copy=False))

    def _step(self, actions: Ints) -> StepResult:
        result = super()._step(actions)
        if not self._beta:
            return result
        potential = np.where(result.terminated, 0.0, self._potential_of(np.arange(self.num_envs)))
        shaping = self._beta * (self._discount * potential - self._potential)
        self._potential = potential
        return result._replace(reward=result.reward + shaping)

    def _touch(self, rows: Ints, poses: Ints) -> None:
        objects = self.objects[rows]
        rounds = (self._first_rounds[rows, poses] + self.uses[rows, poses]) % self.bank.num_rounds
        self._evidence.add(rows, objects, rounds, poses)
        self._frame_probs[rows] = self._frames[objects, rounds, poses]
        self.uses[rows, poses] += 1
        self.log_probs, _ = update(self._log_priors, self._evidence.log_likelihoods)
        self._ask_gains(rows)

    def _ask_gains(self, rows: Ints) -> None:
        """Set the gains of rows that were touched or begun."""
        if isinstance(self._evidence, JointEvidence):
            now = self.log_probs[rows], self.targets[rows], self.uses[rows]
            self._gains[rows] = self._evidence.gains(rows, *now)

    def _potential_of(self, rows: Ints) -> NDArray[np.float64]:
        return np.abs(certainty(self.log_probs[rows], self.targets[rows]))


def _choose(probs: NDArray[np.float64], rng: np.random.Generator) -> Ints:
    """A shape from each of the distributions ``(n, K)``, sampled as ``rng.choice`` does."""
    up_to = probs.cumsum(axis=1)
    return (rng.random((len(probs), 1)) >= up_to / up_to[:, -1:]).sum(axis=1)


def recorded_tests(num_envs: int = 1, **settings: Any) -> BankEpisodes:
    """What ``gymnasium.make_vec("activetouch/ObjectTestBank-v0")`` calls; see :meth:`BankEpisodes.shipped`."""
    return BankEpisodes.shipped(num_envs=num_envs, **settings)
