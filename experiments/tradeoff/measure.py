"""Measurement of configurations, Pareto fronts of time and success, and recommendations.

Measured are the results of searches, and processor time of presses, readings and decisions.

Processor time does not depend on other programs; on an idle core it equals the elapsed time.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from activetouch import TactileSensor, TouchWorld
from activetouch.sensor_files import POLICIES
from activetouch.world import touch_many
from belief.files import require_regular_file, write_text
from belief.problem import Touch
from belief.statistics import pareto_front, wilson_interval
from experiments.search.play import episode_seed, make_world
from experiments.tradeoff.configuration import Configuration
from planners import Episode, make_decider, search_lockstep
from planners.search import TouchRequest

_PRESSES, _READINGS = 200, 100
_TOGETHER = 25  # episodes in lockstep


@dataclass(frozen=True)
class Measured:
    """Results of the searches of a configuration; lists have one entry per episode, target after target.

    Attributes:
        configuration: the configuration.
        successes: 1 for a success, 0 otherwise.
        touches: number of touches.
        decisions: number of decisions, including those to touch.
        rewards: return.
        ms_per_decision: mean time of a belief update and decision [ms]; plans are made before.
        ms_per_press: time of a press and its image [ms].
        ms_per_reading: time to read one image [ms].
    """

    configuration: Configuration
    successes: list[int]
    touches: list[int]
    decisions: list[int]
    rewards: list[float]
    ms_per_decision: float
    ms_per_press: float
    ms_per_reading: float

    @property
    def num_searches(self) -> int:
        """Number of searches."""
        return len(self.successes)

    @property
    def success(self) -> float:
        """Fraction of searches that succeeded."""
        return sum(self.successes) / self.num_searches

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the success rate."""
        return wilson_interval(sum(self.successes), self.num_searches)

    @property
    def mean_touches(self) -> float:
        """Mean number of touches per search."""
        return float(np.mean(self.touches))

    @property
    def reward(self) -> float:
        """Mean return."""
        return float(np.mean(self.rewards))

    @cached_property
    def ms_of_searches(self) -> NDArray[np.float64]:
        """Time of every search [ms]: presses, readings and decisions."""
        per_touch = self.ms_per_press + self.ms_per_reading
        return np.array(self.touches) * per_touch + np.array(self.decisions) * self.ms_per_decision

    @property
    def ms_per_search(self) -> float:
        """Mean time of a search [ms]."""
        return float(self.ms_of_searches.mean())

    @property
    def ms_per_touch(self) -> float:
        """Time from one touch to the next [ms]: a press, a reading and one decision."""
        return self.ms_per_press + self.ms_per_reading + self.ms_per_decision


def measured(configuration: Configuration, folder: Path) -> Measured:
    """Result of a configuration, read from its file, or measured and written if there is none."""
    path = folder / "results" / f"{configuration.key}.json"
    if not path.exists():
        write_text(path, json.dumps(asdict(measure(configuration))) + "\n")
    return Measured(**{**json.loads(require_regular_file(path).read_text()), "configuration": configuration})


def measure(configuration: Configuration) -> Measured:
    """Play the searches of a configuration and time its parts."""
    setting = configuration.setting
    problem = setting.problem
    sensor = TactileSensor.load(configuration.folder, setting.scene, anyway=True)
    decider = make_decider(
        configuration.decider, sensor.model.outcome_table(), sensor.model, configuration.folder / POLICIES
    )
    touching = 0.0

    def touch_and_time(requests: Sequence[TouchRequest[TouchWorld]]) -> Sequence[Touch]:
        nonlocal touching
        started = time.thread_time()
        touches = touch_many(sensor, requests)[0]
        touching += time.thread_time() - started
        return touches

    def play(seeds: Sequence[tuple[int, ...]]) -> tuple[list[Episode], float]:
        """Play episodes; return them and the seconds of belief updates and decisions."""
        episodes: list[Episode] = []
        thinking = 0.0
        for first in range(0, len(seeds), _TOGETHER):
            batch = seeds[first : first + _TOGETHER]
            worlds, targets = [make_world(problem, sensor, seed) for seed in batch], [seed[1] for seed in batch]
            started = time.thread_time() - touching
            episodes += search_lockstep(worlds, decider, problem, targets, sensor.model, batch, touch_and_time)
            thinking += time.thread_time() - touching - started
        return episodes, thinking

    targets = range(problem.num_shapes)
    seeds = [episode_seed(configuration.seed, t, number) for t in targets for number in range(configuration.episodes)]
    play(seeds[:: configuration.episodes])  # one episode per target, in which plans are made
    episodes, thinking = play(seeds)
    decisions = [len(episode.steps) for episode in episodes]
    return Measured(
        configuration,
        [int(bool(episode.success)) for episode in episodes],
        [episode.num_touches for episode in episodes],
        decisions,
        [episode.reward(problem) for episode in episodes],
        1e3 * thinking / sum(decisions),
        *touch_times(sensor),
    )


def touch_times(sensor: TactileSensor) -> tuple[float, float]:
    """Mean time of a press with its image, and median time to read an image [ms]."""
    scene, rng = sensor.scene, np.random.default_rng(0)
    num_shapes = len(scene.shapes)
    presses, readings = [], []
    for number in range(num_shapes + _PRESSES):
        body, pose = scene.sample_object(number % num_shapes, rng), number % len(scene.poses)
        started = time.thread_time()
        image = scene.press(body, pose, rng).image
        presses.append(time.thread_time() - started)
        if number < _READINGS:
            started = time.thread_time()
            sensor.read(image[None], [pose])
            readings.append(time.thread_time() - started)
    # The first press of each shape compiles its model.
    return 1e3 * float(np.mean(presses[num_shapes:])), 1e3 * float(np.median(readings))


TASKS: Mapping[str, tuple[str, ...]] = {
    "four objects of four shapes": ("paper", "coarse", "gel"),
    "eight objects of twelve shapes, any mixture": ("hard",),
    "twelve objects of twelve shapes": ("many",),
}
"""Scenes with the same search task and different sensors, by task; each task has a Pareto front."""


@dataclass(frozen=True)
class Front:
    """Pareto front of a task.

    Attributes:
        task: key of :data:`TASKS`.
        points: all configurations, fastest first.
        on_front: whether each is on the front: no other is both faster and at least as successful.
    """

    task: str
    points: Sequence[Measured]
    on_front: NDArray[np.bool_]


def fronts(points: Sequence[Measured]) -> list[Front]:
    """Pareto front of time per search and success for every task that has configurations."""
    found = []
    for task, scenes in TASKS.items():
        of_task = sorted((p for p in points if p.configuration.scene in scenes), key=lambda p: p.ms_per_search)
        if of_task:
            on_front = pareto_front([p.ms_per_search for p in of_task], [p.success for p in of_task])
            found.append(Front(task, of_task, on_front))
    return found


@dataclass(frozen=True)
class Pick:
    """Recommended configuration for a question; None if no configuration satisfies it."""

    question: str
    point: Measured | None


def picks(front: Front, least_success: float, most_ms: float) -> list[Pick]:
    """Recommend the fastest configuration that is accurate enough, and the most accurate one that is fast enough.

    Accuracy is the lower end of the interval of the success rate. Equally accurate configurations are ranked by touches
    per search, because a touch of a real robot takes longer than the computation.

    Args:
        front: configurations of a task.
        least_success: lowest acceptable accuracy.
        most_ms: longest acceptable time per touch [ms].
    """
    good = [point for point in front.points if point.interval[0] >= least_success]
    fast = [point for point in front.points if point.ms_per_touch <= most_ms]
    return [
        Pick(f"the fastest with success ≥ {least_success:g} (lower end of its interval)", good[0] if good else None),
        Pick(
            f"the most accurate under {most_ms:g} ms per touch, with the fewest touches among equals",
            max(fast, key=lambda p: (p.interval[0], -p.mean_touches, -p.ms_per_search)) if fast else None,
        ),
    ]
