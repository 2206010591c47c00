"""Searches in changed worlds by robots that may answer "I do not know", whose conflict tests run on.

Eight robots share the searches of a condition of ``robustness``. Each test continues from search to search
(decision 0049); from an e-value of 3.5 on a robot refuses to answer, and at 1 / 0.02 it has an alarm.

Run: python -m benchmarks.unsure_robots [SCENE] [SEARCHES]      (50 for every target by default; some minutes)
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import accumulate, count
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from activetouch import SCENES, TactileSensor
from activetouch.world import touch_many
from belief import SearchProblem
from belief.statistics import clopper_pearson_interval, cluster_bootstrap
from belief.table import Table, interval
from experiments.parallel import default_jobs, run_tasks
from experiments.robustness.conditions import applicable_conditions
from experiments.scene_choice import SceneChoice
from experiments.search.play import make_world
from experiments.search.setting import Setting
from planners import Decider, Episode, Outcome, make_decider, search_lockstep
from planners.abstaining import Abstaining
from planners.search import log_bets_after

ROBOTS = 8
"""Most robots that share the searches of a condition."""
_FALSE_ALARM, _PROMISE = 0.02, 0.95  # of the conflict test; smallest stated probability of an answer


def _unsure_scores(
    condition: str, sensor: TactileSensor, problem: SearchProblem, number: int, seed: int
) -> tuple[str, dict[str, Any]]:
    """The condition, and what robots do that may be unsure: :data:`ROBOTS` of them, or one for each of fewer searches.

    They search for all targets in random order: ``wrong`` and ``unsure``, fraction that ended with "I do not know", and
    ``right``, fraction of the confirmations, with their intervals; ``alarms``: how many robots had an alarm of their
    test, which runs on from search to search; ``searches_to_alarm`` and ``touches_to_alarm``: median number of the
    search in which, and of all touches until then.
    """
    decider: Decider = make_decider("information_gain", sensor.model.outcome_table(), sensor.model)
    seeds = [(seed, target, n) for target in range(problem.num_shapes) for n in range(number)]
    order = np.random.default_rng(seed).permutation(len(seeds)).tolist()
    shares = [[seeds[n] for n in order[first::ROBOTS]] for first in range(ROBOTS)]
    return condition, _abstention(_in_turn(sensor, problem, Abstaining(decider, _FALSE_ALARM, _PROMISE), shares))


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


def main(name: str = "coarse", episodes: str = "50", seed: int = 7) -> None:
    """Search, and print the table."""
    sensor, problem = TactileSensor.shipped(name), replace(Setting(SceneChoice(name)).problem, unsure_reward=0.0)
    scenes, _ = applicable_conditions(SCENES[name].scene)
    tasks = [
        partial(_unsure_scores, condition, replace(sensor, scene=scene), problem, int(episodes), seed)
        for condition, scene in scenes.items()
    ]
    found = dict(run_tasks(tasks, default_jobs(), "searching, unsure"))
    rows = []
    for condition in scenes:
        row = found[condition]
        right = None if row["right"] is None else interval(*row["right"])
        alarms = f"{row['alarms']}"
        if row["alarms"]:
            alarms += f", in search {row['searches_to_alarm']:g}, touch {row['touches_to_alarm']:g}"
        rows.append((condition, interval(*row["wrong"]), interval(*row["unsure"]), right, alarms))
    columns = ("condition", "wrong", "unsure", "right among confirmed", "alarms")
    print(Table(f"{name}: searches of robots that may be unsure", columns, rows).markdown())


if __name__ == "__main__":
    main(*sys.argv[1:])
