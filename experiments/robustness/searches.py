"""Live searches under changed conditions, with each observation model of a sensor on the same episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from activetouch import Scene, TactileSensor, TouchWorld
from activetouch.named_scenes import NamedScene
from activetouch.world import touch_many
from belief import SearchProblem, Touch
from belief.observation_model import ArrayModel
from belief.seeding import arrangement_rng
from belief.statistics import clopper_pearson_interval, cluster_bootstrap
from belief.synthetic import sample_arrangement
from experiments.parallel import run_tasks
from experiments.search.episode_statistics import calibration_of_confirmations
from planners import Decider, Episode, Outcome, make_decider, search_lockstep
from planners.abstaining import Abstaining
from planners.search import TouchRequest
from planners.set_up import search_in_turn

CONFIDENCE = 0.95
"""Posterior of a shape at which touching stops."""
_DECIDER = "information_gain"
_TOGETHER = 25  # searches in lockstep
SET_UPS = 8
"""Robots that share the searches of a condition, where they may answer "I do not know"."""


def confidence_at_stops(stated: ArrayLike, correct: ArrayLike, num_touches: ArrayLike) -> dict[str, Any] | None:
    """Stated confidence against accuracy at stopping; None if nothing stopped.

    Args:
        stated: confidence at each stop, ``(n,)``.
        correct: whether the answer is right, ``(n,)``.
        num_touches: at the stop, ``(n,)``.
    """
    right = np.asarray(correct, bool)
    if not len(right):
        return None
    return {
        "number": len(right),
        "touches": float(np.asarray(num_touches, np.float64).mean()),
        "stated": float(np.asarray(stated, np.float64).mean()),
        "achieved": float(right.mean()),
        "interval": clopper_pearson_interval(int(right.sum()), len(right)),
    }


def search_scores(
    sensor: TactileSensor,
    models: Mapping[str, ArrayModel],
    scenes: Mapping[str, Scene],
    named: NamedScene,
    episodes: int,
    seed: int,
    jobs: int,
    abstain: float | None = None,
) -> dict[tuple[str, str], dict[str, Any]]:
    """Success and calibration at confirmation of live searches, by condition and model.

    Args:
        sensor: reads the touches; its observation model is not used.
        models: observation models by name.
        scenes: by condition.
        named: the scene of the sensor and its search.
        episodes: for every target, the same for all models.
        seed: of the episodes.
        jobs: number of processes.
        abstain: false-alarm rate of the conflict test, with which the decider may answer "I do not know", also below a
            stated confidence of :data:`CONFIDENCE`; not by default.

    Returns:
        By condition and model: ``success`` with its ``interval``, ``touches`` a search, ``stated`` confidence and
        ``achieved`` accuracy at confirmation, ``wrong``: fraction of searches with a wrong confirmation, and with
        ``abstain`` ``unsure``: fraction that ended with "I do not know", each with its interval; ``alarms``: how many
        of :data:`SET_UPS` robots, whose test runs on from search to search, had an alarm; ``searches_to_alarm``: median
        number of the search in which.
    """
    problem = SearchProblem(
        named.scene.shape_labels,
        named.scene.pose_labels,
        num_objects=named.num_objects,
        composition=named.composition,
        touch_limit=12 * named.num_objects,
        unsure_reward=None if abstain is None else 0.0,
    )
    tasks = [
        partial(
            _search_all, (condition, name), replace(sensor, scene=scene, model=model), problem, episodes, seed, abstain
        )
        for condition, scene in scenes.items()
        if not scene.press_model.is_slow
        for name, model in models.items()
    ]
    return dict(run_tasks(tasks, jobs, "searching under every condition"))


def _search_all(
    key: tuple[str, str],
    sensor: TactileSensor,
    problem: SearchProblem,
    number: int,
    seed: int,
    abstain: float | None,
) -> tuple[tuple[str, str], dict[str, Any]]:
    decider: Decider = make_decider(_DECIDER, sensor.model.outcome_table(), sensor.model)
    decider = decider if abstain is None else Abstaining(decider, abstain, CONFIDENCE)
    seeds = [(seed, target, n) for target in range(problem.num_shapes) for n in range(number)]
    worlds, targets = [], [target for _, target, _ in seeds]
    for seed_of_episode in seeds:
        rng = arrangement_rng(seed_of_episode)
        worlds.append(TouchWorld.sample(sensor, sample_arrangement(problem, rng), rng))

    def touches(pending: Sequence[TouchRequest[TouchWorld]]) -> Sequence[Touch]:
        return touch_many(sensor, pending)[0]

    if abstain is None:
        parts = [slice(first, first + _TOGETHER) for first in range(0, len(seeds), _TOGETHER)]
        by_part = [
            search_lockstep(worlds[part], decider, problem, targets[part], sensor.model, seeds[part], touches)
            for part in parts
        ]
    else:
        parts = [slice(first, None, SET_UPS) for first in range(min(SET_UPS, len(seeds)))]
        by_part = search_in_turn(
            [worlds[part] for part in parts],
            decider,
            problem,
            [targets[part] for part in parts],
            sensor.model,
            [seeds[part] for part in parts],
            touches,
        )
    played = [episode for some in by_part for episode in some]
    won, confirmed = sum(episode.success for episode in played), calibration_of_confirmations(played)
    overall = None if confirmed is None else confirmed.overall
    wrong = [episode.outcome is Outcome.CONFIRMED and not episode.success for episode in played]
    unsure = [episode.outcome is Outcome.UNSURE for episode in played]
    if abstain is None:  # searches are independent, otherwise those of a set-up are not
        rate = partial(_rate, None)
    else:
        rate = partial(_rate, np.repeat(np.arange(len(by_part)), [len(some) for some in by_part]))
    alarms = [num for some in by_part if (num := _searches_to_alarm(some)) is not None]
    abstention = {
        "unsure": rate(unsure),
        "alarms": len(alarms),
        "searches_to_alarm": float(np.median(alarms)) if alarms else None,
    }
    return key, {
        "number": len(played),
        "success": won / len(played),
        "interval": clopper_pearson_interval(won, len(played)),
        "touches": float(np.mean([episode.num_touches for episode in played])),
        "stated": None if overall is None else overall.mean_stated,
        "achieved": None if overall is None else overall.share_right,
        "wrong": rate(wrong),
        **(abstention if abstain is not None else {}),
    }


def _searches_to_alarm(episodes: Sequence[Episode]) -> int | None:
    """Number of the search, from 1, in which the conflict test first stopped a set-up; None if it did not."""
    stopped = (n for n, episode in enumerate(episodes, 1) if "is_conflict" in episode.steps[-1].decision.scores)
    return next(stopped, None)


def _rate(set_ups: NDArray[np.int64] | None, events: Sequence[bool]) -> list[float]:
    """A frequency with its interval, which resamples set-ups if there are any."""
    if set_ups is None:
        return [float(np.mean(events)), *clopper_pearson_interval(sum(events), len(events))]
    return list(cluster_bootstrap(np.asarray(events), set_ups, np.random.default_rng(0)))
