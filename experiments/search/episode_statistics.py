"""Statistics of episodes: calibration at stopping, success by place of the target, regret and gap to the bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from belief import Confirm, SearchProblem
from belief.metrics import CalibrationAtStop, calibration_at_stop
from belief.statistics import paired_bootstrap, wilson_interval
from planners import Episode


def claims(episodes: Sequence[Episode]) -> CalibrationAtStop | None:
    """Calibration of the searches that confirmed an object, by touches of that object.

    The stated confidence is the posterior probability at confirmation that the object is the target.

    Returns:
        None if no object was confirmed.
    """
    stops = [(episode, episode.steps[-1]) for episode in episodes if _confirmed(episode)]
    if not stops:
        return None
    return calibration_at_stop(
        [min(float(step.belief.probs[episode.target]), 1.0) for episode, step in stops],
        [episode.success for episode, _ in stops],
        [sum(s.touch is not None and s.object_index == last.object_index for s in e.steps) for e, last in stops],
    )


def _confirmed(episode: Episode) -> bool:
    return bool(episode.steps) and isinstance(episode.steps[-1].decision.action, Confirm)


@dataclass(frozen=True)
class Place:
    """Searches whose target lay at one place in the order of visit.

    Attributes:
        position: of the first object of the target shape, from 0; None where there was none.
        num_episodes: searches.
        successes: that ended right.
        wrong: confirmed something else.
        touches: mean per search.
    """

    position: int | None
    num_episodes: int
    successes: int
    wrong: int
    touches: float

    @property
    def success(self) -> float:
        """Share that succeeded."""
        return self.successes / self.num_episodes

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson, 95 %."""
        return wilson_interval(self.successes, self.num_episodes)

    @property
    def label(self) -> str:
        """As a reader counts: from one."""
        return "absent" if self.position is None else f"{self.position + 1}"


def position(episode: Episode) -> int | None:
    """Where the first object of the target shape lies in the order of visit; None if there is none."""
    return episode.arrangement.index(episode.target) if episode.target in episode.arrangement else None


def by_position(episodes: Sequence[Episode]) -> list[Place]:
    """Success by where the target lay, in order of visit, absent ones last; places that never occurred are left out."""
    groups: dict[int | None, list[Episode]] = {}
    for episode in episodes:
        groups.setdefault(position(episode), []).append(episode)
    return [
        Place(
            place,
            len(some),
            sum(e.success for e in some),
            sum(e.confirmed_shape not in (None, e.target) for e in some),
            float(np.mean([e.num_touches for e in some])),
        )
        for place, some in sorted(groups.items(), key=lambda item: np.inf if item[0] is None else item[0])
    ]


def gap(
    episodes: Mapping[str, Sequence[Episode]],
    bounds: Mapping[str, float | None],
    problem: SearchProblem,
    rng: np.random.Generator,
) -> tuple[float, float, float] | None:
    """Upper bound of the discretised model minus a decider's mean return: mean and 95 % interval.

    Args:
        episodes: of one decider, by target.
        bounds: of the expected return, by target; None where there is none.
        problem: the rules.
        rng: source of the bootstrap.

    Returns:
        None if the bound of some target is not known.
    """
    known = {target: bound for target, bound in bounds.items() if bound is not None}
    if not episodes.keys() <= known.keys():
        return None
    best = [known[target] for target, some in episodes.items() for _ in some]
    return paired_bootstrap(best, [e.reward(problem) for some in episodes.values() for e in some], rng)


def regret(
    episodes: Mapping[str, Sequence[Episode]],
    solved: Mapping[str, Sequence[bool]],
    problem: SearchProblem,
    rng: np.random.Generator,
) -> tuple[float, float, float]:
    """Return of the full-information oracle minus that of a decider on the same episodes: mean and 95 % interval.

    The oracle touches every object in every pose free of charge before it answers, so its return is +1 or -1.

    Args:
        episodes: of one decider, by target, beginning with those on which the oracle was run.
        solved: whether the oracle succeeds in each of the first episodes, by target.
        problem: the rules.
        rng: source of the bootstrap.
    """
    best = [1.0 if right else -1.0 for target in episodes for right in solved[target]]
    got = [
        episode.reward(problem)
        for target, some in episodes.items()
        for episode, _ in zip(some, solved[target], strict=False)
    ]
    return paired_bootstrap(best, got, rng)
