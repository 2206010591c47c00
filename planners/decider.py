"""The interface of deciders: from an :class:`InformationState` to a :class:`Decision`.

A :class:`SequentialDecider` combines a stopping rule with a probe selector.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any, Protocol, TypeVar, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from belief.bayes import Belief
from belief.errors import ActiveTouchError, InvalidArgument, UnknownName
from belief.naming import index_of
from belief.observation_model.evidence import ObjectEvidence
from belief.observation_model.outcome_table import OutcomeTable
from belief.problem import Confirm, Probe, Reject, SearchProblem, Touch, TouchHistory, Unsure
from belief.scene_belief import SceneBelief, SceneView
from belief.validation import Floats, are_finite, require_index


class BadState(ActiveTouchError, TypeError):
    """An argument of an information state has the wrong type."""


@dataclass(frozen=True, eq=False)
class InformationState:
    """Everything that a decider may base its action on; immutable.

    Attributes:
        problem: the search.
        target: index of the shape sought; a label becomes its index.
        belief: belief about the current object, given all touches of all objects, over the problem's shapes.
        history: touches of the current object, oldest first; stored as a :class:`belief.TouchHistory`.
        object_index: number of objects rejected before this one, in [0, N).
        scene: the joint belief about all objects, for deciders that plan beyond the current one.

    Raises:
        BadState: ``scene`` is not a :class:`belief.SceneView`.
        UnknownName: no shape has the target's name.
        InvalidArgument: a target or an object index out of range, or a belief about other shapes than the problem's.
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
                f"scene must be a SceneView, got {type(self.scene).__name__}; the method view() of a SceneBelief "
                f"returns one, and InformationState.of takes the SceneBelief itself"
            )
        labels = self.problem.shape_labels
        object.__setattr__(self, "target", index_of("target", labels, self.target))
        if self.belief.labels != labels:
            raise InvalidArgument(f"the problem is about {labels}, the belief about {self.belief.labels}")
        require_index("object_index", self.object_index, self.problem.num_objects)
        if not isinstance(self.history, TouchHistory):
            object.__setattr__(self, "history", TouchHistory(self.history))

    @classmethod
    def of(cls, problem: SearchProblem, target: int, scene: SceneBelief, object_index: int) -> InformationState:
        """The information state at an object of a scene."""
        return cls(problem, target, scene.belief(object_index), scene.touches(object_index), object_index, scene.view())

    @property
    def target_prob(self) -> float:
        """Probability that the current object is the target."""
        return float(np.exp(self.belief.log_probs[self.target]))

    @property
    def probs(self) -> Floats:
        """Probabilities of the shapes with a sum of 1, ``(K,)``: of what deciders plan with.

        An object of an unlisted shape is not the target. It counts as one of the other shapes, in their proportion.

        >>> problem = SearchProblem(("cube", "cone", "ball"), ("front",), num_objects=1, unlisted=0.1)
        >>> InformationState(problem, 0, Belief.from_probs(problem.shape_labels, [0.5, 0.2, 0.0], 0.3)).probs.tolist()
        [0.5, 0.5, 0.0]
        """
        found = self.belief.probs
        if not self.belief.unlisted:
            return found
        others = np.where(np.arange(len(found)) == self.target, 0.0, found)
        if not others.any():
            others = np.where(np.arange(len(found)) == self.target, 0.0, 1.0)
        if not others.any():  # the target alone is listed
            return np.ones(1)
        found = np.where(others > 0.0, others * ((1.0 - found[self.target]) / others.sum()), found)
        return np.asarray(found / found.sum())

    @property
    def log_probs(self) -> Floats:
        """Logarithms of :attr:`probs`, exact where no unlisted shape is possible, ``(K,)``."""
        if not self.belief.unlisted:
            return self.belief.log_probs
        with np.errstate(divide="ignore"):
            return np.log(self.probs)

    @property
    def evidence(self) -> ObjectEvidence | None:
        """The evidence of all touches of the current object; None without a joint belief (``scene``)."""
        return None if self.scene is None else self.scene.evidence(self.object_index)

    @property
    def uses(self) -> NDArray[np.int64]:
        """Number of touches of the current object in each pose, ``(P,)``.

        >>> problem = SearchProblem(("cube", "cone"), ("front", "side", "top"), num_objects=1)
        >>> touches = [Touch(pose, np.zeros(2)) for pose in (0, 2, 2)]
        >>> InformationState(problem, 0, Belief.uniform(("cube", "cone")), touches).uses.tolist()
        [1, 0, 2]
        """
        assert isinstance(self.history, TouchHistory), "converted at construction"
        return self.history.uses(len(self.problem.pose_labels))

    @property
    def num_left(self) -> int:
        """Objects not yet rejected, including the current one."""
        return self.problem.num_objects - self.object_index


@dataclass(frozen=True)
class Decision:
    """An action, and named scores that explain it and are recorded with the episode."""

    action: Probe | Confirm | Reject | Unsure
    scores: Mapping[str, float] = field(default_factory=dict)


class HasScores(Protocol):
    """A decision of any kind of search: a dataclass with an action and scores."""

    @property
    def scores(self) -> Mapping[str, float]:
        """Named numbers that explain the action."""


AnyDecision = TypeVar("AnyDecision", bound=HasScores)


class TableMismatch(ActiveTouchError, ValueError):
    """A decider's table has other numbers of poses or shapes than the search."""


def require_fit(table: OutcomeTable, problem: SearchProblem) -> None:
    """Raise :class:`TableMismatch` unless a table has the problem's numbers of poses and shapes."""
    if table.probs.shape[:2] != (len(problem.pose_labels), len(problem.shape_labels)):
        raise TableMismatch(
            f"the decider's table has {table.num_poses} poses and {table.num_shapes} shapes, the search has "
            f"{problem.num_poses} and {problem.num_shapes}; make the decider from the outcome_table() of its model"
        )


def pose_scores(name: str, problem: SearchProblem, values: NDArray[np.floating]) -> dict[str, float]:
    """Scores of a decision: ``values (P,)`` by name and label of the pose, without those of -inf."""
    pairs = zip(problem.pose_labels, values.tolist(), strict=True)
    return {f"{name}_{label}": value for label, value in pairs if value != -np.inf}


def touch_share(problem: SearchProblem) -> int:
    """Share of one object in the touch limit of a search, at least 1.

    >>> touch_share(SearchProblem(tuple("abcd"), ("front",), num_objects=4, touch_limit=10))
    2
    """
    return max(problem.touch_limit // problem.num_objects, 1)


def num_touches(info: InformationState) -> int:
    """Touches of the whole search so far; of the current object alone without a joint belief."""
    if info.scene is None:
        return len(info.history)
    return sum(len(info.scene.touches(index)) for index in range(info.scene.num_objects))


def require_unsure(problem: SearchProblem, needs: str) -> None:
    """Check that searches have the answer "I do not know"; ``needs`` begins the message, as "a stop rule needs"."""
    if problem.unsure_reward is None:
        raise InvalidArgument(f"{needs} a search with the answer 'I do not know': SearchProblem(unsure_reward=0.0)")


def are_touches_used(info: InformationState) -> bool:
    """Whether the touch limit of the search forbids another touch."""
    return num_touches(info) >= info.problem.touch_limit


class Decider(Protocol):
    """Chooses the next action."""

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """The decision for this information state; ``rng`` is the only source of randomness."""


class StoppingRule(Protocol):
    """Decides when to stop touching the current object."""

    def stop(self, info: InformationState) -> Decision | None:
        """CONFIRM, REJECT or UNSURE, or None to go on probing."""


@runtime_checkable
class ProbeSelector(Protocol):
    """Chooses the next pose."""

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """A PROBE."""


@dataclass(frozen=True)
class SequentialDecider:
    """Follows a stopping rule, and probes by a selector where it does not stop.

    Attributes:
        stopping: decides when to stop.
        probing: chooses the next pose otherwise.
    """

    stopping: StoppingRule
    probing: ProbeSelector

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`Decider`."""
        return self.stopping.stop(info) or self.probing.choose(info, rng)


_MADE = "make_decider('information_gain', model.outcome_table(), model)"
_WORKS = "a decider returns Decision(Probe(pose)), Decision(Confirm()) or Decision(Reject())"


class BadDecision(ActiveTouchError, ValueError):
    """A decider returned something that is not a decision of this search."""


def checked_decision(decision: Any, decider: object, problem: SearchProblem) -> Decision:
    """The decision with Python numbers in place of numpy's; raises BadDecision if it is not one of this search.

    >>> problem = SearchProblem(("cube", "cone"), ("front",), num_objects=1)
    >>> checked_decision("confirm", None, problem)
    Traceback (most recent call last):
    ...
    planners.decider.BadDecision: the decider NoneType answered 'confirm'; a decider returns Decision(Probe(pose)), \
Decision(Confirm()) or Decision(Reject())
    """
    who = f"the decider {type(decider).__name__} answered"
    if not isinstance(decision, Decision):
        raise BadDecision(f"{who} {decision!r}; {_WORKS}")
    action = decision.action
    if isinstance(action, Probe):
        pose = _pose(action.pose, problem, who)
        if type(action.pose) is not int:
            decision = replace(decision, action=Probe(pose))
    elif isinstance(action, Unsure):
        if problem.unsure_reward is None:
            raise BadDecision(f"{who} Unsure(), which this search does not have: set SearchProblem(unsure_reward=0.0)")
    elif not isinstance(action, Confirm | Reject):
        raise BadDecision(f"{who} the action {action!r}; {_WORKS}")
    return with_plain_scores(decision, who)


def require_decider(decider: Any, method: str = "decide", works: str = _MADE) -> None:
    """Raise InvalidArgument unless an object, and no class, has the method that is asked for actions.

    >>> require_decider(SequentialDecider)
    Traceback (most recent call last):
    ...
    belief.errors.InvalidArgument: a decider must be an object with a method decide, such as \
make_decider('information_gain', model.outcome_table(), model); got <class 'planners.decider.SequentialDecider'>
    """
    if isinstance(decider, type) or not callable(getattr(decider, method, None)):
        raise InvalidArgument(
            f"a decider must be an object with a method {method}, such as {works}; got {decider!r:.80}"
        )


def _pose(pose: Any, problem: SearchProblem, who: str) -> int:
    if not isinstance(pose, bool):
        with suppress(TypeError):  # it is no integer of any type
            pose = operator.index(pose)
    try:
        return index_of("pose", problem.pose_labels, pose)
    except (InvalidArgument, UnknownName) as error:
        raise BadDecision(
            f"{who} Probe({pose!r}); a pose is an integer in [0, {problem.num_poses}), or one of "
            f"{list(problem.pose_labels)}"
        ) from error


def with_plain_scores(decision: AnyDecision, who: str) -> AnyDecision:
    """The decision with floats as its scores; raises BadDecision if they are not named, finite numbers."""
    scores = decision.scores
    if not isinstance(scores, Mapping):
        raise BadDecision(f"{who} with the scores {scores!r}; scores are named numbers, such as {{'value': 0.5}}")
    values = scores.values()
    wrong = [name for name, value in scores.items() if not (isinstance(name, str) and isinstance(value, Real))]
    if not wrong and not are_finite(*values):
        wrong = [name for name, value in scores.items() if not are_finite(value)]
    if wrong:
        raise BadDecision(f"{who} with the score {wrong[0]!r}: {scores[wrong[0]]!r}; scores are named, finite numbers")
    if all(isinstance(value, float) for value in values):
        return decision
    plain: Any = decision
    return cast(AnyDecision, replace(plain, scores={name: float(value) for name, value in scores.items()}))
