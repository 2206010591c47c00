"""Searches as environments, many at once as array operations; an environment of one search is a batch of one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from belief.policy_state import ENCODINGS, NO_ACTION, Situation
from belief.problem import SearchProblem
from belief.search_progress import ONGOING, TRUNCATED, BatchedProgress

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class StepResult(NamedTuple):
    """Results of one step of B episodes, each ``(B,)``; ``success`` says whether the decision was correct."""

    reward: NDArray[np.float64]
    terminated: Bools
    truncated: Bools
    success: Bools


class SearchEpisodes(ABC):
    """B searches by the rules of :class:`belief.search_progress.BatchedProgress`: what is observed, and what is paid.

    A subclass makes the touches: it sets ``log_probs``, ``uses``, ``_frame_probs`` and ``_gains`` of current objects.

    Attributes:
        problem: of all searches.
        state: encoding of the observations, a key of :data:`belief.policy_state.ENCODINGS`.
        targets: index of each episode's target shape, ``(B,)``.
        right: its :func:`belief.search_progress.right_outcomes`, ``(B, N)``.
        progress: where the searches are.
        log_probs: log posteriors of the current objects, ``(B, K)``.
        uses: number of their touches in each pose, ``(B, P)``.
    """

    def __init__(self, problem: SearchProblem, num_envs: int, state: str, truncation_reward: float) -> None:
        self.problem, self.num_envs, self.state = problem, num_envs, state
        self.progress = BatchedProgress(problem, num_envs)
        self.targets, self._previous = np.zeros(num_envs, np.int64), np.full(num_envs, NO_ACTION)
        self.right = np.zeros((num_envs, problem.num_objects), np.int64)
        self.log_probs, self._frame_probs = (np.zeros((num_envs, problem.num_shapes)) for _ in range(2))
        self.uses = np.zeros((num_envs, problem.num_poses), np.int64)
        self._gains: NDArray[np.float64] | None = None
        self._rewards = np.array([-1.0, -1.0, truncation_reward, problem.unsure_reward or 0.0, 0.0])  # by outcome

    def situation(self) -> Situation:
        """The inputs of a policy."""
        time = self.progress.num_touches / self.problem.touch_limit
        return Situation(self._frame_probs, self.log_probs, self._previous, self.uses, time, self._gains)

    def observe(self) -> NDArray[np.float32]:
        """The observations, ``(B, S)``."""
        return ENCODINGS[self.state](self.situation(), self.targets).astype(np.float32)

    def action_masks(self) -> Bools:
        """Valid actions, one of each in the action space, ``(B, P + 2)``, or with the action UNSURE ``(B, P + 3)``."""
        num_poses, has_unsure = self.problem.num_poses, self.problem.unsure_reward is not None
        masks = np.ones((self.num_envs, num_poses + 2 + has_unsure), np.bool_)
        masks[:, :num_poses] = self.progress.may_touch[:, None]
        return masks

    def infos(self, success: Bools) -> dict[str, Any]:
        """``is_success``, ``num_touches`` and ``target_prob`` of every episode, ``(B,)`` each."""
        probs = np.exp(self.log_probs[np.arange(self.num_envs), self.targets])
        return {"is_success": success, "num_touches": self.progress.num_touches.copy(), "target_prob": probs}

    def _step(self, actions: Ints) -> StepResult:
        """Take one action in each episode."""
        touched = self.progress.are_touches(actions)
        (rows,) = touched.nonzero()
        if rows.size:
            self._touch(rows, actions[rows])
        self.progress.act(actions, touched)
        outcomes, success = self.progress.outcomes, self.progress.are_right(self.right)
        reward = self._rewards.take(outcomes)
        reward[touched], reward[success] = -self.problem.touch_cost, 1.0
        truncated, ended = outcomes == TRUNCATED, outcomes > ONGOING
        self._previous = np.where(outcomes >= TRUNCATED, self._previous, actions)  # or unsure
        if self.problem.num_objects > 1:
            (rows,) = (~(touched | ended)).nonzero()
            if rows.size:
                self._advance(rows)
        return StepResult(reward, ended ^ truncated, truncated, success)

    @abstractmethod
    def _touch(self, rows: Ints, poses: Ints) -> None:
        """Touch the current objects of these rows."""

    def _advance(self, rows: Ints) -> None:  # noqa: B027
        """Go to the next objects of these rows; searches of one object have none."""
