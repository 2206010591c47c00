"""Any function from an observation to an action, as a decider: ``policy:module:attribute``.

The function gets what ``activetouch/ObjectTest-v0`` shows, one array, and returns an action of it: the index of a pose,
P for CONFIRM or P + 1 for REJECT. Nothing of this package needs to be in it. It must depend on the observation alone.
An agent with a memory is a class, ``policy:module:Agent(remembers=True)``: for every decision a new one sees all
observations of the object in their order, so that the same touches lead to the same action.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from belief.errors import BrokenContract
from belief.policy_state import ENCODINGS, TOUCH_LIMIT, situation_of
from belief.problem import Confirm, Probe, Reject
from belief.references import Reference
from belief.validation import require_choice, require_count
from planners.decider import Decision, InformationState

STATES = ("paper", "posterior")
"""What a function may observe."""


def observation(info: InformationState, state: str, sees_target: bool, touch_limit: int) -> NDArray[np.float32]:
    """What an environment with this state would show: of the current object, and the target, one-hot, if it is seen.

    Args:
        info: the information state.
        state: one of :data:`STATES`.
        sees_target: whether the target follows, as in ``ObjectTestGoal-v0``.
        touch_limit: T_max of the environment, in touches of one object.

    Returns:
        The observation, ``(S,)`` or, with the target, ``(S + K,)``.
    """
    situation = situation_of(info.history, info.belief.log_probs, info.problem.num_poses, touch_limit)
    seen = ENCODINGS[state](situation, info.target)[0]
    if sees_target:
        seen = np.append(seen, np.arange(info.problem.num_shapes) == info.target)
    return seen.astype(np.float32)


def decision(info: InformationState, action: int, touch_limit: int) -> Decision:
    """The decision that an action of the environment stands for; at the touch limit the more probable answer."""
    num_poses, scores = info.problem.num_poses, {"target_prob": info.target_prob}
    if action < num_poses:
        if len(info.history) < touch_limit:
            return Decision(Probe(action), scores)
        action = num_poses + (info.target_prob < 0.5)
    return Decision(Confirm() if action == num_poses else Reject(), scores)


@dataclass(frozen=True)
class FunctionPolicy:
    """Takes the action of a function, object by object.

    Attributes:
        act: the function, or its ``module:attribute``; a class is called without arguments.
        state: what it observes, one of :data:`STATES`.
        sees_target: whether the target follows, one-hot.
        touch_limit: T_max; after so many touches of one object the more probable answer is taken.
        remembers: whether ``act`` is a class without arguments whose instances are called with the observations of one
            object, of the state "paper", from the first to the last; what they return for the last one counts.

    Raises:
        InvalidArgument: the state is unknown, or is another than "paper" of what remembers, or the limit is below 1.
        BadReference: there is no such module, or its attribute cannot be called.
    """

    act: Callable[[NDArray[np.float32]], Any] | str
    state: str = "paper"
    sees_target: bool = False
    touch_limit: int = TOUCH_LIMIT
    remembers: bool = False

    def __post_init__(self) -> None:
        require_choice("state", self.state, STATES[:1] if self.remembers else STATES)
        require_count("touch_limit", self.touch_limit)
        found = Reference.parse(self.act).load() if isinstance(self.act, str) else self.act
        object.__setattr__(self, "act", found() if isinstance(found, type) and not self.remembers else found)
        if not callable(self.act):
            raise BrokenContract(f"a policy is a function from an observation to an action; {self.act!r:.80} is none")

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`.

        Raises:
            BrokenContract: the function returns no action of the environment.
        """
        assert not isinstance(self.act, str), "loaded at construction"
        act: Callable[..., Any] = self.act
        if self.remembers:
            act = act()
        for number in range(0 if self.remembers else len(info.history), len(info.history) + 1):
            then = replace(info, history=info.history[:number])
            given = act(observation(then, self.state, self.sees_target, self.touch_limit))
        found = np.asarray(given)
        most = info.problem.num_poses + 1
        if found.size != 1 or found.dtype.kind not in "iu" or not 0 <= int(found.reshape(())) <= most:
            raise BrokenContract(
                f"{self.act!r:.80} must return an action, an integer from 0 to {most}, got {given!r:.80}: poses are 0 "
                f"to {most - 2}, CONFIRM is {most - 1}, REJECT is {most}"
            )
        return decision(info, int(found.reshape(())), self.touch_limit)
