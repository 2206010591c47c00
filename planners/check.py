"""Check of the contract of deciders."""

from __future__ import annotations

import json
import pickle

import numpy as np

from belief.composition import Composition
from belief.errors import BrokenContract
from belief.observation_model.model import ObservationModel
from belief.problem import SearchProblem
from belief.search_progress import Outcome
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners.decider import Decider, Decision, InformationState
from planners.episode import Episode
from planners.search import search

_COMPOSITIONS = (Composition.DISTINCT, Composition.INDEPENDENT)


class _Asked:
    """A decider that calls another one twice with equal generators and compares the decisions."""

    def __init__(self, decider: Decider) -> None:
        self._decider = decider

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        state = rng.bit_generator.state
        first = self._decider.decide(info, rng)
        again = np.random.default_rng()
        again.bit_generator.state = state
        second = self._decider.decide(info, again)
        if isinstance(first, Decision) and first != second:
            raise BrokenContract(
                f"for the same information state and the same rng it returns {first} and then {second}: "
                "decide must depend on nothing else"
            )
        return first


def check_decider(
    decider: Decider,
    rng: np.random.Generator,
    model: ObservationModel | None = None,
    num_searches: int = 20,
    touch_limit: int = 60,
    unsure_reward: float | None = None,
) -> list[Episode]:
    """Check that a decider keeps the contract of :class:`Decider`, in searches among synthetic objects.

    The checks are: valid decisions; decisions that depend only on the information state and ``rng``; scores that JSON
    can represent; the decider can be pickled; some search ends before the touch limit.

    Args:
        decider: the decider to check.
        rng: draws objects and touches.
        model: source of the touches; by default a random model with four shapes and three poses.
        num_searches: half of them among distinct shapes, half among independent ones.
        touch_limit: touch limit of each search.
        unsure_reward: reward of the answer "I do not know", which is a valid decision only where it has one.

    Returns:
        The searches.

    Raises:
        BrokenContract: the first rule that the decider violates.
        BadDecision: a decision is invalid.

    >>> from planners.registry import make_decider
    >>> rng = np.random.default_rng(0)
    >>> model = random_model(rng)
    >>> episodes = check_decider(make_decider("threshold", model.outcome_table()), rng, model)
    >>> len(episodes)
    20
    """
    model = model if model is not None else random_model(rng)
    poses = tuple(f"pose_{number}" for number in range(model.outcome_table().num_poses))
    episodes = []
    for number in range(num_searches):
        problem = SearchProblem(
            tuple(model.shape_labels), poses, min(3, len(model.shape_labels)), _COMPOSITIONS[number % 2],
            touch_limit=touch_limit, unsure_reward=unsure_reward,
        )  # fmt: skip
        arrangement = sample_arrangement(problem, rng)
        target = int(rng.integers(problem.num_shapes))
        seed = (int(rng.integers(2**31)),)
        episodes.append(search(SyntheticWorld(model, arrangement), _Asked(decider), problem, target, model, seed))
    for episode in episodes:
        for step in episode.steps:
            try:
                json.dumps(dict(step.decision.scores), allow_nan=False)
            except (TypeError, ValueError) as error:
                raise BrokenContract(f"scores must be finite numbers by name, got {step.decision.scores}") from error
    if all(episode.outcome is Outcome.TRUNCATED for episode in episodes):
        raise BrokenContract(f"none of {num_searches} searches ended within {touch_limit} touches: it never stops")
    try:
        pickle.loads(pickle.dumps(decider))
    except Exception as error:
        raise BrokenContract(f"it cannot be sent to another process: {error}") from error
    return episodes
