"""Statistics of episodes: calibration at stopping, success by position of the target, regret, overprobing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from belief.metrics import CalibrationAtStop, calibration_at_stop
from belief.problem import Confirm, Reject, SearchProblem
from belief.statistics import paired_bootstrap, wilson_interval
from planners import Episode


def calibration_of_confirmations(episodes: Sequence[Episode]) -> CalibrationAtStop | None:
    """Calibration of the stated confidence at confirmation, by number of touches of the confirmed object.

    The stated confidence is the posterior probability at confirmation that the object is the target.

    Returns:
        None if no object was confirmed.
    """
    stops = [(e, e.steps[-1]) for e in episodes if e.steps and isinstance(e.steps[-1].decision.action, Confirm)]
    if not stops:
        return None
    return calibration_at_stop(
        [min(float(step.belief.probs[episode.target]), 1.0) for episode, step in stops],
        [episode.success for episode, _ in stops],
        [sum(s.touch is not None and s.object_index == last.object_index for s in e.steps) for e, last in stops],
    )


@dataclass(frozen=True)
class Place:
    """Results of the searches whose target has one position in the order of visit.

    Attributes:
        position: position of the first object of the target shape, from 0; None if the target is absent.
        num_episodes: number of searches.
        successes: searches that succeeded.
        wrong: searches that confirmed an object of another shape.
        touches: mean number of touches per search.
    """

    position: int | None
    num_episodes: int
    successes: int
    wrong: int
    touches: float

    @property
    def success(self) -> float:
        """Fraction of searches that succeeded."""
        return self.successes / self.num_episodes

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the success rate."""
        return wilson_interval(self.successes, self.num_episodes)

    @property
    def label(self) -> str:
        """The position counted from 1, or "absent"."""
        return "absent" if self.position is None else f"{self.position + 1}"


def position(episode: Episode) -> int | None:
    """Position of the first object of the target shape in the order of visit; None if the target is absent."""
    return episode.arrangement.index(episode.target) if episode.target in episode.arrangement else None


def by_position(episodes: Sequence[Episode]) -> list[Place]:
    """Results by position of the target, in order of visit, absent targets last; positions without searches omitted."""
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


def regret(
    episodes: Mapping[str, Sequence[Episode]],
    solved: Mapping[str, Sequence[bool]],
    problem: SearchProblem,
    rng: np.random.Generator,
) -> tuple[float, float, float]:
    """Return of the full-information oracle minus that of a decider on the same episodes: mean and 95 % interval.

    The oracle's touches are free, so its return is +1 or -1.

    Args:
        episodes: searches of the decider, by target; the first ones are those on which the oracle was run.
        solved: whether the oracle succeeds in each of the first episodes, by target.
        problem: rules of the search.
        rng: random generator of the bootstrap.
    """
    best = [1.0 if right else -1.0 for target in episodes for right in solved[target]]
    got = [
        episode.reward(problem)
        for target, some in episodes.items()
        for episode, _ in zip(some, solved[target], strict=False)
    ]
    return paired_bootstrap(best, got, rng)


CERTAIN = 0.95
"""Posterior probability from which it counts as certain whether an object is the target."""


@dataclass(frozen=True)
class Overprobing:
    """Touches and errors of a decider after the posterior was certain whether an object is the target (paper §7.2).

    Attributes:
        objects: number of objects for which the posterior became certain.
        late_touches: mean number of touches after the first touch with a certain posterior.
        went_on: number of these objects that were touched again.
        doubted: number for which a later touch made the posterior uncertain again.
        first_wrong: number for which the first certain decision would have been wrong.
        wrong: number for which the final decision was wrong; no decision counts as wrong.
    """

    objects: int
    late_touches: float
    went_on: int
    doubted: int
    first_wrong: int
    wrong: int


def overprobing(episodes: Iterable[Episode], confidence: float = CERTAIN) -> Overprobing | None:
    """Count touches and errors after certainty, over all objects of all episodes.

    Args:
        episodes: searches of one decider.
        confidence: smallest posterior that counts as certain.

    Returns:
        None if the posterior never became certain.
    """
    found = [
        counted
        for episode in episodes
        for index in range(len(episode.arrangement))
        if (counted := _after_certainty(episode, index, confidence)) is not None
    ]
    if not found:
        return None
    late, doubted, first_wrong, wrong = zip(*found, strict=True)
    went_on = sum(number > 0 for number in late)
    return Overprobing(len(found), float(np.mean(late)), went_on, sum(doubted), sum(first_wrong), sum(wrong))


def _after_certainty(episode: Episode, index: int, confidence: float) -> tuple[int, bool, bool, bool] | None:
    """Late touches, and whether the posterior was doubted, first wrong and wrong; None if it never was certain."""
    steps = [step for step in episode.steps if step.object_index == index]
    probs = np.array([step.belief.probs[episode.target] for step in steps])
    sure = np.maximum(probs, 1.0 - probs) >= confidence
    sure[:1] = False  # before the first touch
    if not sure.any():
        return None
    is_target, first, last = episode.arrangement[index] == episode.target, int(sure.argmax()), steps[-1].decision.action
    right = isinstance(last, Confirm) if is_target else isinstance(last, Reject)
    late = sum(step.touch is not None for step in steps[first:])
    return late, not bool(sure[first:].all()), bool(probs[first] >= 0.5) != is_target, not right
