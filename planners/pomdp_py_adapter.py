r"""Online planning by tree search with pomdp-py: POUCT (Silver & Veness 2010).

A state is (object, its shape, whether a target was rejected), or the end. The probability that the next object is the
target is hypergeometric; that the other shapes differ from each other is ignored. Every decision plans anew from the
given belief. In the tree all touches are independent; at its root only the least used of the useful poses are allowed.

Leaves are valued by rollouts that take the right action for the sampled state: optimistic by the same amount for all
actions that continue. pomdp-py's random rollout sooner or later confirms a wrong object, so touches seem to have no
value. The constant of exploration grows with the number of simulations up to the range of returns, which Silver &
Veness use.

Only this module needs pomdp-py, the extra ``pomdp``. It draws from Python's global generator, which is seeded for each
plan and restored afterwards; plans of several threads run one after the other.

>>> from belief import Belief
>>> table = OutcomeTable(np.array([[[0.9, 0.1], [0.1, 0.9]]]))
>>> problem = SearchProblem(("cube", "cone"), ("front",), num_objects=1, composition="independent")
>>> info = InformationState(problem, 0, Belief.uniform(("cube", "cone")))
>>> Pouct(table, simulations=300).decide(info, np.random.default_rng(0)).action
Probe(pose=0)
"""

from __future__ import annotations

import random
import threading
import warnings
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from scipy.special import rel_entr

from belief.observation_model.outcome_table import OutcomeTable
from belief.problem import Action, Confirm, Probe, Reject, SearchProblem
from belief.validation import MOST_REPEATED, require_count
from planners.continuation_value import belief_with_missed, shapes_ahead
from planners.decider import Decision, InformationState, are_touches_used, require_fit, touch_share
from planners.episode import ACTION_NAMES

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of an escape in its documentation, each time that it is compiled
    import pomdp_py
    from pomdp_py.utils.templates import SimpleAction, SimpleObservation, SimpleState

_ONE_PLAN_AT_A_TIME = threading.Lock()  # the generator is global to the process

END = SimpleState("end")
NOTHING = SimpleObservation("nothing")
CONFIRM, REJECT = SimpleAction("confirm"), SimpleAction("reject")
_EXPLORATION = (0.25, 1.0)  # constant of UCB1, relative to the range of returns: least, and most
_ROUNDING = 1e-12  # divergence that is none
_DEPTH = 12  # planning depth, plus two for each remaining object


class Rules:
    """A search as tables from which the pomdp-py models draw.

    Attributes:
        actions: our actions by those of pomdp-py, without useless touches; CONFIRM and REJECT come first and win ties.
        states: all states, by object, shape and whether a target was rejected.
        outcome_probs: p(outcome | pose, shape), ``(P, K, M)``.
        shape_probs: p(shape) of object i before it is touched, by whether a target was rejected, ``(N, 2, K)``.
    """

    def __init__(self, problem: SearchProblem, target: int, table: OutcomeTable) -> None:
        require_fit(table, problem)
        self.problem, self.target, self.outcome_probs = problem, target, table.probs
        self.actions: dict[SimpleAction, Action] = {CONFIRM: Confirm(), REJECT: Reject()}
        self.actions |= {SimpleAction(f"probe_{pose}"): Probe(pose) for pose in useful_poses(problem, table)}
        self.poses = {action.name: ours.pose for action, ours in self.actions.items() if isinstance(ours, Probe)}
        keys = np.ndindex(problem.num_objects, problem.num_shapes, 2)
        self.states = {key: SimpleState(key) for key in keys}
        self.outcomes = [SimpleObservation(outcome) for outcome in range(table.num_outcomes)]
        self.shape_probs = shapes_ahead(problem, target)
        self.cumulative_shapes = self.shape_probs.cumsum(axis=2).tolist()
        self.cumulative_outcomes = self.outcome_probs.cumsum(axis=2).tolist()

    def is_target(self, state: SimpleState) -> bool:
        """Whether the current object is the target."""
        return bool(state.data[1] == self.target)

    def is_missed(self, state: SimpleState) -> bool:
        """Whether a target is among the rejected objects once the current one is rejected, too."""
        return bool(state.data[2] or self.is_target(state))

    def histogram(self, info: InformationState) -> dict[SimpleState, float]:
        """The belief as probabilities of states, without states of probability zero."""
        joint = belief_with_missed(info)
        return {
            self.states[info.object_index, int(shape), int(missed)]: float(joint[missed, shape])
            for shape, missed in np.argwhere(joint.T > 0.0)
        }


class SearchModel(pomdp_py.BlackboxModel):
    """Draws the result of an action: probes give an outcome, REJECT brings the next object (decision 0004)."""

    def __init__(self, rules: Rules, rng: np.random.Generator) -> None:
        self._rules, self._rng = rules, rng
        self._touch_cost = float(np.float32(rules.problem.touch_cost))  # pomdp-py has rewards in single precision

    def sample(self, state: SimpleState, action: SimpleAction) -> tuple[SimpleState, SimpleObservation, float, int]:
        """The next state, an observation, the reward, and the number of steps, which is one."""
        rules = self._rules
        if state is END:
            return END, NOTHING, 0.0, 1
        if (pose := rules.poses.get(action.name)) is not None:
            outcome = _draw(rules.cumulative_outcomes[pose][state.data[1]], self._rng)
            return state, rules.outcomes[outcome], -self._touch_cost, 1
        if action.name == CONFIRM.name:
            return END, NOTHING, 1.0 if rules.is_target(state) else -1.0, 1
        index, missed = state.data[0] + 1, int(rules.is_missed(state))
        if index == rules.problem.num_objects:
            return END, NOTHING, -1.0 if missed else 1.0, 1
        return rules.states[index, _draw(rules.cumulative_shapes[index][missed], self._rng), missed], NOTHING, 0.0, 1


class InformedRollout(pomdp_py.RolloutPolicy):
    """Rollouts that confirm a sampled target and reject any other shape; ``now`` are the actions at the root."""

    def __init__(self, rules: Rules, rng: np.random.Generator, now: Sequence[SimpleAction] | None = None) -> None:
        self._rules, self._rng = rules, rng
        self._all = list(rules.actions)
        self._now = self._all if now is None else list(now)

    def get_all_actions(
        self, state: SimpleState | None = None, history: tuple[object, ...] | None = None
    ) -> list[SimpleAction]:
        """The allowed actions: those of the root before any action, all later, CONFIRM at the end."""
        if state is END:
            return [CONFIRM]
        return self._all if history else self._now

    def sample(self, state: SimpleState) -> SimpleAction:
        """A random action."""
        return self._all[int(self._rng.random() * len(self._all))]

    def rollout(self, state: SimpleState, history: tuple[object, ...]) -> SimpleAction:
        """CONFIRM or REJECT."""
        return CONFIRM if state is END or self._rules.is_target(state) else REJECT


@dataclass(frozen=True, eq=False)
class Pouct:
    """POUCT with a number of ``simulations`` per decision, from the belief as a histogram."""

    table: OutcomeTable
    simulations: int = 1000
    rollout: type[InformedRollout] = InformedRollout

    def __post_init__(self) -> None:
        require_count("simulations", self.simulations, most=MOST_REPEATED)
        least = self.table.num_poses + 3  # the first simulation creates the root; the others try every action
        if self.simulations < least:
            raise ValueError(f"{self.table.num_poses} poses need at least {least} simulations, got {self.simulations}")

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        rules = self.rules(info)
        policy = self.rollout(rules, rng, _root_actions(rules, info))
        agent = pomdp_py.Agent(
            pomdp_py.Histogram(rules.histogram(info)), policy, blackbox_model=SearchModel(rules, rng)
        )
        depth = _DEPTH + 2 * info.num_left
        planner = pomdp_py.POUCT(
            max_depth=depth,
            num_sims=self.simulations,
            discount_factor=1.0,
            exploration_const=_exploration(self.simulations) * (2.0 + info.problem.touch_cost * depth),
            rollout_policy=agent.policy_model,
        )
        with _seeded_global_random(int(rng.integers(2**63))):
            planner.plan(agent)
        nodes = {rules.actions[theirs]: agent.tree[theirs] for theirs in agent.tree.children}
        values = {action: float(node.value) for action, node in nodes.items() if node.num_visits}
        scores, labels = {"target_prob": info.target_prob}, info.problem.pose_labels
        for action, value in values.items():
            name = labels[action.pose] if isinstance(action, Probe) else ACTION_NAMES[type(action)]
            scores[f"value_{name}"] = value
        return Decision(max(values, key=values.__getitem__), scores)

    def rules(self, info: InformationState) -> Rules:
        """The search as the tree sees it from an information state."""
        return Rules(info.problem, info.target, self.table)


def _exploration(simulations: int) -> float:
    """Constant of UCB1 relative to the range of returns, which is from -1 less all touches to 1.

    >>> [_exploration(number) for number in (20, 100, 400, 10_000)]
    [0.25, 0.25, 0.5, 1.0]
    """
    least, most = _EXPLORATION
    return min(max(least * (simulations / 100.0) ** 0.5, least), most)


def useful_poses(problem: SearchProblem, table: OutcomeTable) -> list[int]:
    """The poses worth a touch: none if no number of touches can pay, else all whose outcome depends on the shape.

    Rollouts know the sampled shape, so a touch without information would seem better than an answer. The information of
    n touches is at most n C, with C the largest divergence between two shapes in any pose, and an answer gains at most
    2 √(n C / 2) by it (Pinsker's inequality). This is below the cost n λ for every n if √(2 C) ≤ λ.

    >>> table = OutcomeTable(np.array([[[0.5, 0.5], [0.5, 0.5]], [[0.9, 0.1], [0.1, 0.9]]]))
    >>> useful_poses(SearchProblem(("cube", "cone"), ("front", "top"), 1, "independent"), table)
    [1]
    """
    one, other = table.probs[:, :, None], table.probs[:, None]
    divergence = rel_entr(one, other).sum(axis=3).max(axis=(1, 2))  # (P,)
    if np.sqrt(2.0 * divergence.max()) <= problem.touch_cost:
        return []
    return np.flatnonzero(divergence > _ROUNDING).tolist()


def _draw(cumulative: list[float], rng: np.random.Generator) -> int:
    return min(bisect_right(cumulative, rng.random() * cumulative[-1]), len(cumulative) - 1)


def _root_actions(rules: Rules, info: InformationState) -> list[SimpleAction]:
    """Actions at the root: no CONFIRM of a target with probability zero, and only the least used of the useful poses.

    Beyond the object's share of the touch limit there are no touches.
    """
    uses = info.uses
    least = min((uses[pose] for pose in rules.poses.values()), default=0)
    is_over = len(info.history) >= touch_share(info.problem) or are_touches_used(info)
    return [
        theirs
        for theirs, ours in rules.actions.items()
        if not (isinstance(ours, Confirm) and info.target_prob == 0.0)
        and not (isinstance(ours, Probe) and (is_over or uses[ours.pose] > least))
    ]


@contextmanager
def _seeded_global_random(seed: int) -> Iterator[None]:
    with _ONE_PLAN_AT_A_TIME:
        before = random.getstate()
        random.seed(seed)
        try:
            yield
        finally:
            random.setstate(before)
