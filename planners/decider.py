"""What every decider sees and answers: one signature for thresholds, planners and learned policies.

A decider gets an :class:`InformationState`, all it may use and nothing more (never the true shape), and answers
with a :class:`Decision`: the action, and the scores that led to it. The commonest decider is a
:class:`SequentialDecider`: a stopping rule asked first, and a probe selector for when it does not stop, so that
"these poses with that stop" is a constructor call.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from belief import Belief, Confirm, Probe, Reject, SceneBelief, SceneView, SearchProblem, Touch, TouchHistory
from belief.errors import ActiveTouchError
from belief.observation_model import OutcomeTable


class BadState(ActiveTouchError, TypeError):
    """An information state was to be made of something else than it takes."""


@dataclass(frozen=True, eq=False)
class InformationState:
    """Everything a decider may base its action on.

    Attributes:
        problem: the search.
        target: index of the shape sought.
        belief: about the current object, given all touches of all objects.
        history: touches of the current object, oldest first; becomes a :class:`belief.TouchHistory`.
        object_index: how many objects were rejected before this one.
        scene: the joint belief about all objects as it is now, for deciders that plan beyond the current one.

    Nothing in it changes when more is felt, and nothing in it can be changed.

    Raises:
        BadState: the scene is a :class:`belief.SceneBelief`, which can be changed; its :meth:`view` is for deciders.
    """

    problem: SearchProblem
    target: int
    belief: Belief
    history: Sequence[Touch] = ()
    object_index: int = 0
    scene: SceneView | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.scene, SceneView | None):
            raise BadState(
                f"a decider reads a SceneView, got {type(self.scene).__name__}; the method view() of a SceneBelief "
                f"makes one, and InformationState.of takes the SceneBelief itself"
            )
        if not isinstance(self.history, TouchHistory):
            object.__setattr__(self, "history", TouchHistory(self.history))

    @classmethod
    def of(cls, problem: SearchProblem, target: int, scene: SceneBelief, object_index: int) -> InformationState:
        """What a decider sees of a scene when it is at an object."""
        return cls(problem, target, scene.belief(object_index), scene.touches(object_index), object_index, scene.view())

    @property
    def target_prob(self) -> float:
        """Probability that the current object is the target."""
        return float(np.exp(self.belief.log_probs[self.target]))

    @property
    def uses(self) -> NDArray[np.int64]:
        """How often the current object was touched in each pose, ``(P,)``.

        >>> problem = SearchProblem(("cube", "cone"), ("front", "side", "top"), num_objects=1)
        >>> touches = [Touch(pose, np.zeros(2)) for pose in (0, 2, 2)]
        >>> InformationState(problem, 0, Belief.uniform(("cube", "cone")), touches).uses.tolist()
        [1, 0, 2]
        """
        assert isinstance(self.history, TouchHistory), "made one at construction"
        return self.history.uses(self.problem.num_poses)

    @property
    def num_left(self) -> int:
        """Objects not yet rejected, the current one included."""
        return self.problem.num_objects - self.object_index


@dataclass(frozen=True)
class Decision:
    """An action and why: named numbers that the choice was made on, recorded with every episode."""

    action: Probe | Confirm | Reject
    scores: Mapping[str, float] = field(default_factory=dict)


class TableMismatch(ActiveTouchError, ValueError):
    """A decider's table is about other numbers of poses or shapes than the search."""


def require_fit(table: OutcomeTable, problem: SearchProblem) -> None:
    """Raise :class:`TableMismatch` unless a table has the problem's poses and shapes."""
    if (table.num_poses, table.num_shapes) != (problem.num_poses, problem.num_shapes):
        raise TableMismatch(
            f"the decider's table is about {table.num_poses} poses and {table.num_shapes} shapes, the search has "
            f"{problem.num_poses} and {problem.num_shapes}; make the decider from the outcome_table() of its model"
        )


class Decider(Protocol):
    """Chooses the next action."""

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """The action for this information state; ``rng`` is the only source of chance."""


class StoppingRule(Protocol):
    """Decides when enough is known about the current object."""

    def stop(self, info: InformationState) -> Decision | None:
        """CONFIRM or REJECT, or None to go on probing."""


class ProbeSelector(Protocol):
    """Chooses the next pose."""

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """A PROBE."""


@dataclass(frozen=True)
class SequentialDecider:
    """Ask the stopping rule; where it does not stop, probe as the selector says.

    Attributes:
        stopping: when to confirm or reject.
        probing: which pose otherwise.
    """

    stopping: StoppingRule
    probing: ProbeSelector

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`Decider`."""
        return self.stopping.stop(info) or self.probing.choose(info, rng)
