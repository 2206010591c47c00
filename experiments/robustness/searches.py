"""Live searches under changed conditions, on the same episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import accumulate, count
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from activetouch import Scene, TactileSensor
from activetouch.named_scenes import NamedScene
from activetouch.world import touch_many
from belief.problem import SearchProblem
from belief.statistics import clopper_pearson_interval, cluster_bootstrap, wilson_interval
from experiments.parallel import run_tasks
from experiments.search.comparison import compare
from experiments.search.play import make_world
from experiments.search.summary import ALL
from planners import Decider, Episode, Outcome, make_decider, search_lockstep
from planners.abstaining import Abstaining
from planners.search import log_bets_after

CONFIDENCE = 0.95
"""Smallest stated confidence of an answer of a decider that may answer "I do not know"."""
ROBOTS = 8
"""Most robots that share the searches of a condition, where they may answer "I do not know"."""
_DECIDER = "information_gain"


def search_scores(
    sensor: TactileSensor,
    scenes: Mapping[str, Scene],
    named: NamedScene,
    episodes: int,
    seed: int,
    jobs: int,
    abstain: float | None = None,
) -> dict[str, dict[str, Any]]:
    """Success and calibration at confirmation of live searches, by condition.

    Args:
        sensor: reads the touches.
        scenes: by condition.
        named: the scene of the sensor and its search.
        episodes: for every target.
        seed: of the episodes.
        jobs: number of processes.
        abstain: false-alarm rate of the conflict test, with which the same searches are made again by a decider that
            may answer "I do not know", also below a stated confidence of :data:`CONFIDENCE`; not by default.

    Returns:
        By condition: ``number`` of searches, ``success`` with ``interval``, ``touches`` a search, fraction of wrong
        confirmations with its interval, ``wrong``, and ``stated`` confidence and ``achieved`` accuracy at confirmation,
        None without one. With ``abstain`` also ``abstaining``, see :func:`_unsure_scores`.
    """
    found: dict[str, dict[str, Any]] = {}
    for condition, scene in scenes.items():
        changed, world = replace(sensor, scene=scene), replace(named, scene=scene)
        comparison = compare(world, [_DECIDER], episodes=episodes, seed=seed, sensor=changed, anyway=True, jobs=jobs)
        cell, stops = comparison.cells[_DECIDER, ALL], comparison.calibration[_DECIDER]
        found[condition] = {
            "number": cell.num_episodes,
            "success": cell.success,
            "interval": list(cell.success_interval),
            "touches": cell.touches,
            "wrong": [cell.wrong / cell.num_episodes, *wilson_interval(cell.wrong, cell.num_episodes)],
            "stated": None if stops is None else stops.overall.mean_stated,
            "achieved": None if stops is None else stops.overall.share_right,
        }
    if abstain is not None:
        problem = replace(comparison.problem, unsure_reward=0.0)
        tasks = [
            partial(_unsure_scores, condition, replace(sensor, scene=scene), problem, episodes, seed, abstain)
            for condition, scene in scenes.items()
        ]
        for condition, scores in run_tasks(tasks, jobs, "searching once more, unsure"):
            found[condition]["abstaining"] = scores
    return found


def _unsure_scores(
    condition: str, sensor: TactileSensor, problem: SearchProblem, number: int, seed: int, abstain: float
) -> tuple[str, dict[str, Any]]:
    """The condition, and what robots do that may be unsure: :data:`ROBOTS` of them, or one for each of fewer searches.

    They search for all targets in random order: ``wrong`` and ``unsure``, fraction that ended with "I do not know", and
    ``right``, fraction of the confirmations, with their intervals; ``alarms``: how many robots had an alarm of their
    test, which runs on from search to search; ``searches_to_alarm`` and ``touches_to_alarm``: median number of the
    search in which, and of all touches until then.
    """
    decider: Decider = make_decider(_DECIDER, sensor.model.outcome_table(), sensor.model)
    seeds = [(seed, target, n) for target in range(problem.num_shapes) for n in range(number)]
    order = np.random.default_rng(seed).permutation(len(seeds)).tolist()
    shares = [[seeds[n] for n in order[first::ROBOTS]] for first in range(ROBOTS)]
    return condition, _abstention(_in_turn(sensor, problem, Abstaining(decider, abstain, CONFIDENCE), shares))


def _in_turn(
    sensor: TactileSensor, problem: SearchProblem, decider: Decider, seeds: Sequence[Sequence[tuple[int, int, int]]]
) -> list[list[Episode]]:
    """The searches of several robots, whose conflict tests run on from search to search (decision 0049)."""
    log_bets: list[ArrayLike] = [0.0] * len(seeds)
    played: list[list[Episode]] = [[] for _ in seeds]
    for turn in range(max(map(len, seeds))):
        robots = [robot for robot, own in enumerate(seeds) if turn < len(own)]
        now = [seeds[robot][turn] for robot in robots]
        episodes = search_lockstep(
            [make_world(problem, sensor, seed) for seed in now],
            decider,
            problem,
            [target for _, target, _ in now],
            sensor.model,
            now,
            lambda pending: touch_many(sensor, pending)[0],
            [log_bets[robot] for robot in robots],
        )
        for robot, episode in zip(robots, episodes, strict=True):
            played[robot].append(episode)
            log_bets[robot] = log_bets_after(episode, problem, sensor.model, log_bets[robot])
    return played


def _is_wrong(episode: Episode) -> bool:
    return episode.outcome is Outcome.CONFIRMED and episode.success is False


def _abstention(by_robot: Sequence[Sequence[Episode]]) -> dict[str, Any]:
    """How often robots were wrong and unsure, and when their conflict tests had an alarm."""
    played = [episode for episodes in by_robot for episode in episodes]
    robots = np.repeat(np.arange(len(by_robot)), list(map(len, by_robot)))

    def rate(events: Sequence[bool]) -> list[float]:
        """With an interval that resamples robots, because the searches of one are not independent.

        It is at least as wide as that of independent searches: with no event in any of few robots, it would be a point.
        """
        share, low, high = cluster_bootstrap(np.asarray(events), robots, np.random.default_rng(0))
        least, most = clopper_pearson_interval(sum(events), len(events))
        return [share, min(low, least), max(high, most)]

    right = [bool(episode.success) for episode in played if episode.outcome is Outcome.CONFIRMED]
    alarms = [alarm for episodes in by_robot if (alarm := _to_alarm(episodes)) is not None]
    searches, touches = np.median(alarms, axis=0).tolist() if alarms else (None, None)
    return {
        "wrong": rate([_is_wrong(episode) for episode in played]),
        "unsure": rate([episode.outcome is Outcome.UNSURE for episode in played]),
        "right": [sum(right) / len(right), *clopper_pearson_interval(sum(right), len(right))] if right else None,
        "alarms": len(alarms),
        "searches_to_alarm": searches,
        "touches_to_alarm": touches,
    }


def _to_alarm(episodes: Sequence[Episode]) -> tuple[int, int] | None:
    """Searches and touches of a robot until its conflict test first stopped it; None if it did not."""
    touches = accumulate(episode.num_touches for episode in episodes)
    after = zip(count(1), touches, episodes, strict=False)
    return next(
        ((n, touched) for n, touched, episode in after if "is_conflict" in episode.steps[-1].decision.scores), None
    )
