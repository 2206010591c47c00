r"""Online planning by tree search with pomdp-py: POUCT and POMCP (Silver & Veness 2010).

The search as pomdp-py sees it: a state is (object, its shape, whether a target was given away), or the end. CONFIRM and
a last REJECT lead to the end; an earlier REJECT brings the next object, which is the target with the chance that
drawing without putting back gives it, or else any of the other shapes: that no two of *these* are alike is left out.
One object by itself is a search of one (paper §5.8). Every decision plans anew from the belief it is given. In the tree
all touches are fresh; at its root only the poses used least may be probed in, because repeats are not (decision 0006).

Leaves of the tree are valued by rollouts. pomdp-py's own rollout acts at random: from any belief it sooner or later
confirms something wrong, so touching hardly seems worth its price, and the planner stops far too early. An *informed*
rollout looks at the state and does what is right for it. That is far too optimistic, but the same for all actions that
go on; CONFIRM is valued as it is.

Only this module needs pomdp-py, whose wheels exist for Linux and Python 3.11 and 3.12; elsewhere it is the extra
``pomdp``. It draws from Python's global generator, which is seeded for the time of a plan and put back after; plans of
several threads take turns, so that each is a function of the information state and ``rng`` alone.

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
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pomdp_py
from pomdp_py.utils.templates import SimpleAction, SimpleObservation, SimpleState

from belief import Confirm, Probe, Reject, SearchProblem
from belief.observation_model import OutcomeTable
from belief.problem import Action, Floats
from planners.continuation_value import prob_missed, target_chances
from planners.decider import Decision, InformationState, require_fit

_ONE_PLAN_AT_A_TIME = threading.Lock()  # the generator is the process's

END = SimpleState("end")
NOTHING = SimpleObservation("nothing")
CONFIRM, REJECT = SimpleAction("confirm"), SimpleAction("reject")
_EXPLORATION = 0.5  # of UCB1; returns lie in about [-1, 1]
_DEPTH = 12  # steps ahead beyond the two that every object left may need


class Rules:
    """A search as tables that the models draw from.

    Attributes:
        problem: the search.
        target: index of the shape sought.
        actions: ours by pomdp-py's; CONFIRM and REJECT first, so that of equally good actions one of these is taken.
        states: all, by object, shape and whether a target was given away.
        outcomes: what probes observe.
        outcome_probs: p(outcome | pose, shape), ``(P, K, M)``.
        shape_probs: of object i before it is touched, ``(N, 2, K)``.
    """

    def __init__(self, problem: SearchProblem, target: int, table: OutcomeTable) -> None:
        require_fit(table, problem)
        self.problem, self.target, self.outcome_probs = problem, target, table.probs
        self.actions: dict[SimpleAction, Action] = {CONFIRM: Confirm(), REJECT: Reject()}
        self.actions |= {SimpleAction(f"probe_{pose}"): Probe(pose) for pose in range(table.num_poses)}
        self.poses = {action.name: ours.pose for action, ours in self.actions.items() if isinstance(ours, Probe)}
        keys = np.ndindex(problem.num_objects, problem.num_shapes, 2)
        self.states = {key: SimpleState(key) for key in keys}
        self.outcomes = [SimpleObservation(outcome) for outcome in range(table.num_outcomes)]
        self.shape_probs = _shape_probs(problem, target)
        self.cumulative_shapes = self.shape_probs.cumsum(axis=2).tolist()
        self.cumulative_outcomes = self.outcome_probs.cumsum(axis=2).tolist()

    def is_target(self, state: SimpleState) -> bool:
        """Whether the current object is the target."""
        return bool(state.data[1] == self.target)

    def is_missed(self, state: SimpleState) -> bool:
        """Whether a target was given away, should the current object be rejected."""
        return bool(state.data[2] or self.is_target(state))


class TransitionModel(pomdp_py.TransitionModel):
    """Probes change nothing; REJECT brings the next object."""

    def __init__(self, rules: Rules, rng: np.random.Generator) -> None:
        self._rules, self._rng = rules, rng

    def sample(self, state: SimpleState, action: SimpleAction) -> SimpleState:
        """The next state."""
        rules = self._rules
        if state is END or action.name in rules.poses:
            return state
        index = state.data[0] + 1
        if action.name == CONFIRM.name or index == rules.problem.num_objects:
            return END
        missed = int(rules.is_missed(state))
        return rules.states[index, _draw(rules.cumulative_shapes[index][missed], self._rng), missed]

    def probability(self, next_state: SimpleState, state: SimpleState, action: SimpleAction) -> float:
        """p(next state | state, action)."""
        rules = self._rules
        if state == END or action.name in rules.poses:
            return float(next_state == state)
        index = state.data[0] + 1
        if action.name == CONFIRM.name or index == rules.problem.num_objects:
            return float(next_state == END)
        missed = int(rules.is_missed(state))
        if next_state == END or (next_state.data[0], next_state.data[2]) != (index, missed):
            return 0.0
        return float(rules.shape_probs[index, missed, next_state.data[1]])

    def get_all_states(self) -> list[SimpleState]:
        """Every state; the end comes last."""
        return [*self._rules.states.values(), END]


class ObservationModel(pomdp_py.ObservationModel):
    """Probes observe an outcome, other actions nothing."""

    def __init__(self, rules: Rules, rng: np.random.Generator) -> None:
        self._rules, self._rng = rules, rng

    def sample(self, next_state: SimpleState, action: SimpleAction) -> SimpleObservation:
        """What is observed."""
        pose = self._rules.poses.get(action.name)
        if pose is None or next_state is END:
            return NOTHING
        return self._rules.outcomes[_draw(self._rules.cumulative_outcomes[pose][next_state.data[1]], self._rng)]

    def probability(self, observation: SimpleObservation, next_state: SimpleState, action: SimpleAction) -> float:
        """p(observation | next state, action)."""
        pose = self._rules.poses.get(action.name)
        if pose is None or next_state == END:
            return float(observation == NOTHING)
        if observation == NOTHING:
            return 0.0
        return float(self._rules.outcome_probs[pose, next_state.data[1], observation.data])

    def get_all_observations(self) -> list[SimpleObservation]:
        """Every observation."""
        return [*self._rules.outcomes, NOTHING]


class RewardModel(pomdp_py.RewardModel):
    """The reward of a search (decision 0004), step by step."""

    def __init__(self, rules: Rules) -> None:
        self._rules = rules

    def sample(self, state: SimpleState, action: SimpleAction, next_state: SimpleState) -> float:
        """The reward, which is no matter of chance."""
        rules = self._rules
        if state is END:
            return 0.0
        if action.name in rules.poses:
            return -rules.problem.touch_cost
        if action.name == CONFIRM.name:
            return 1.0 if rules.is_target(state) else -1.0
        if next_state is END:
            return -1.0 if rules.is_missed(state) else 1.0
        return 0.0


class RandomRollout(pomdp_py.RolloutPolicy):
    """Acts at random: what pomdp-py does by itself, kept to show that it fails."""

    def __init__(self, rules: Rules, rng: np.random.Generator, now: Sequence[SimpleAction] | None = None) -> None:
        self._rules, self._rng = rules, rng
        self._all = list(rules.actions)
        self._now = self._all if now is None else list(now)  # what there is to choose from before anything was done

    def get_all_actions(
        self, state: SimpleState | None = None, history: tuple[object, ...] | None = None
    ) -> list[SimpleAction]:
        """Every action that makes sense now, every one at all later; at the end one is as good as another."""
        if state is END:
            return [CONFIRM]
        return self._all if history else self._now

    def sample(self, state: SimpleState) -> SimpleAction:
        """Any action."""
        return self._all[int(self._rng.random() * len(self._all))]

    def rollout(self, state: SimpleState, history: tuple[object, ...]) -> SimpleAction:
        """Any action."""
        return self.sample(state)


class InformedRollout(RandomRollout):
    """Knows the state and does what is right for it: confirms the target, rejects anything else, touches nothing."""

    def rollout(self, state: SimpleState, history: tuple[object, ...]) -> SimpleAction:
        """CONFIRM or REJECT."""
        return CONFIRM if state is END or self._rules.is_target(state) else REJECT


@dataclass(frozen=True, eq=False)
class Pouct:
    """POUCT from the belief as a histogram.

    Attributes:
        table: p(outcome | pose, shape).
        simulations: of each decision; its price and its quality.
        rollout: values the leaves of the tree.

    Raises:
        ValueError: fewer simulations than it takes to try every action once.
    """

    table: OutcomeTable
    simulations: int = 1000
    rollout: type[RandomRollout] = InformedRollout

    def __post_init__(self) -> None:
        _require_enough(self.simulations, self.table)

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        rules = Rules(info.problem, info.target, self.table)
        policy = self.rollout(rules, rng, _root_actions(rules, info))
        agent = make_agent(rules, pomdp_py.Histogram(belief_histogram(rules, info)), policy, rng)
        planner = pomdp_py.POUCT(**_settings(info, self.simulations, agent))
        return _plan(planner, agent, rules, info, rng)


@dataclass(frozen=True, eq=False)
class Pomcp:
    """POMCP from particles, resampled from the belief in every decision, as many as simulations.

    Attributes and errors are those of :class:`Pouct`.
    """

    table: OutcomeTable
    simulations: int = 1000
    rollout: type[RandomRollout] = InformedRollout

    def __post_init__(self) -> None:
        _require_enough(self.simulations, self.table)

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        rules = Rules(info.problem, info.target, self.table)
        policy = self.rollout(rules, rng, _root_actions(rules, info))
        histogram = belief_histogram(rules, info)
        states, probs = list(histogram), np.array(list(histogram.values()))
        drawn = rng.choice(len(states), size=self.simulations, p=probs / probs.sum())
        particles = pomdp_py.Particles([states[index] for index in drawn.tolist()])
        agent = make_agent(rules, particles, policy, rng)
        planner = pomdp_py.POMCP(**_settings(info, self.simulations, agent))
        return _plan(planner, agent, rules, info, rng)


def make_agent(
    rules: Rules, belief: pomdp_py.GenerativeDistribution, policy: pomdp_py.PolicyModel, rng: np.random.Generator
) -> pomdp_py.Agent:
    """An agent of pomdp-py, for its planners and whatever else takes one; its models draw from ``rng``."""
    return pomdp_py.Agent(belief, policy, TransitionModel(rules, rng), ObservationModel(rules, rng), RewardModel(rules))


def belief_histogram(rules: Rules, info: InformationState) -> dict[SimpleState, float]:
    """The belief as probabilities of states; states of probability zero are left out."""
    missed = prob_missed(info)
    counts = info.problem.counts
    histogram: dict[SimpleState, float] = {}
    for shape, prob in enumerate(info.belief.probs.tolist()):
        only_target = shape == info.target and counts is not None and counts[shape] == 1
        for given_away, share in enumerate((1.0, 0.0) if only_target else (1.0 - missed, missed)):
            if prob * share > 0.0:
                histogram[rules.states[info.object_index, shape, given_away]] = prob * share
    return histogram


def _shape_probs(problem: SearchProblem, target: int) -> Floats:
    chances = target_chances(problem, target)[..., None]  # (N, 2, 1)
    others = np.where(np.arange(problem.num_shapes) == target, 0.0, problem.prior_probs)
    if not others.any():  # there is nothing else to be
        chances, others = np.ones_like(chances), others
    others /= others.sum() if others.any() else 1.0
    probs = (1.0 - chances) * others
    probs[..., target] = chances[..., 0]
    return np.asarray(probs)


def _draw(cumulative: list[float], rng: np.random.Generator) -> int:
    return min(bisect_right(cumulative, rng.random() * cumulative[-1]), len(cumulative) - 1)


def _settings(info: InformationState, simulations: int, agent: pomdp_py.Agent) -> dict[str, object]:
    return {
        "max_depth": _DEPTH + 2 * info.num_left,
        "num_sims": simulations,
        "discount_factor": 1.0,
        "exploration_const": _EXPLORATION,
        "rollout_policy": agent.policy_model,
    }


def _root_actions(rules: Rules, info: InformationState) -> list[SimpleAction]:
    """What makes sense now: not to confirm what is ruled out, nor to repeat a pose while another is fresher."""
    uses = info.uses
    all_used = len(info.history) >= max(info.problem.touch_limit // info.problem.num_objects, 1)
    return [
        theirs
        for theirs, ours in rules.actions.items()
        if not (isinstance(ours, Confirm) and info.target_prob == 0.0)
        and not (isinstance(ours, Probe) and (all_used or uses[ours.pose] > uses.min()))
    ]


def _plan(
    planner: pomdp_py.Planner, agent: pomdp_py.Agent, rules: Rules, info: InformationState, rng: np.random.Generator
) -> Decision:
    with _seeded_global_random(int(rng.integers(2**63))):
        planner.plan(agent)
    nodes = {theirs: agent.tree[theirs] for theirs in agent.tree.children}
    values = {rules.actions[theirs]: float(node.value) for theirs, node in nodes.items() if node.num_visits}
    scores = {"target_prob": info.target_prob}
    for action, value in values.items():
        label = info.problem.pose_labels[action.pose] if isinstance(action, Probe) else type(action).__name__.lower()
        scores[f"value_{label}"] = value
    return Decision(max(values, key=values.__getitem__), scores)


@contextmanager
def _seeded_global_random(seed: int) -> Iterator[None]:
    with _ONE_PLAN_AT_A_TIME:
        before = random.getstate()
        random.seed(seed)
        try:
            yield
        finally:
            random.setstate(before)


def _require_enough(simulations: int, table: OutcomeTable) -> None:
    least = table.num_poses + 3  # the first simulation only makes the root; the others try every action
    if simulations < least:
        raise ValueError(f"{table.num_poses} poses need at least {least} simulations, got {simulations}")
