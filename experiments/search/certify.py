"""``activetouch certify``: bound the error of confirmed objects at every number of touches, by calibration searches."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from activetouch import TactileSensor
from activetouch.scene_description import scene_fields
from belief.problem import SearchProblem
from belief.seeding import keyed_rng
from belief.statistics.stop_thresholds import CandidateStops
from experiments.command_line.arguments import Within
from experiments.parallel import Shared, run_tasks
from experiments.search.fingerprint import digest_of, fingerprint
from experiments.search.play import EPISODES_PER_BATCH, Searches, play_episodes, sensor_digest
from planners import Decider, Episode
from planners.certified import NEVER, WANTED, Certified

FILE = "certificate-{decider}-{risk}.json"
"""Name of a certificate beside the sensor."""
_SEEDS = 0xCE47 << 32  # added to the seed: no comparison plays the searches of a certificate
Risk = Annotated[float, Within(0.0, 1.0, open_low=True, open_high=True)]


@dataclass(frozen=True, eq=False)
class Calibration:
    """Searches that confirm nothing, from which those with any certificate can be read.

    Attributes:
        candidates: moments at which an object could have been confirmed, M of N searches.
        spent: touches of the whole search before each, ``(M,)``.
        num_touches: of each whole search, ``(N,)``.
    """

    candidates: CandidateStops
    spent: NDArray[np.int64]
    num_touches: NDArray[np.int64]

    def touches_with(self, thresholds: Sequence[float]) -> NDArray[np.int64]:
        """Touches of each search that stops by these thresholds, ``(N,)``; ``[0.0]`` is the decider alone."""
        stops, touches = self.candidates.stops(thresholds), self.num_touches.copy()
        touches[self.candidates.searches[stops]] = self.spent[stops]
        return touches


@dataclass(frozen=True)
class _Task:
    shared: Shared[tuple[Searches, Decider]]
    target: int
    numbers: range

    def __call__(self) -> tuple[int, range, list[tuple[list[tuple[int, float, bool, int]], int]]]:
        searches, decider = self.shared.value
        episodes, _ = play_episodes(searches, decider, self.target, self.numbers)
        return self.target, self.numbers, [_candidates(episode) for episode in episodes]


def _candidates(episode: Episode) -> tuple[list[tuple[int, float, bool, int]], int]:
    """Touches of the object, stated probability, error and touches of the search at each candidate; of the search."""
    found, spent, on_object = [], 0, dict[int, int]()
    for step in episode.steps:
        index, scores = step.object_index, step.decision.scores
        if WANTED in scores:
            wrong = episode.arrangement[index] != episode.target
            found.append((on_object.get(index, 0), scores[WANTED], wrong, spent))
        spent += step.touch is not None
        on_object[index] = on_object.get(index, 0) + (step.touch is not None)
    return found, spent


def play_calibration(
    searches: Searches,
    decider: Decider,
    num_searches: int,
    targets: Sequence[str],
    max_touches: int,
    jobs: int | None = None,
) -> Calibration:
    """Play searches that confirm nothing, each with a target drawn uniformly, so that they are independent and alike.

    Args:
        searches: what determines them; the problem has the answer Unsure.
        decider: whose confirmations are listed.
        num_searches: N.
        targets: labels of the shapes that are sought.
        max_touches: of one object, after which the search ends.
        jobs: number of processes; all cores by default.
    """
    labels = list(searches.problem.shape_labels)
    searches = replace(searches, seed=searches.seed + _SEEDS)
    drawn = keyed_rng([searches.seed]).choice([labels.index(target) for target in targets], num_searches)
    shared, tasks = Shared((searches, Certified(decider, NEVER, max_touches))), list[_Task]()
    for target in np.unique(drawn).tolist():
        number = int(np.count_nonzero(drawn == target))
        for first in range(0, number, EPISODES_PER_BATCH):
            tasks.append(_Task(shared, target, range(first, min(first + EPISODES_PER_BATCH, number))))
    rows: list[tuple[list[tuple[int, float, bool, int]], int]] = [([], 0)] * num_searches
    for target, numbers, found in run_tasks(tasks, jobs, "calibrating"):
        for number, row in zip(np.flatnonzero(drawn == target)[numbers], found, strict=True):
            rows[number] = row
    flat = [(number, *one) for number, row in enumerate(rows) for one in row[0]]
    columns = [np.array([row[column] for row in flat]) for column in range(5)] if flat else [np.zeros(0)] * 5
    candidates = CandidateStops(columns[0], columns[1], columns[2], columns[3], num_searches)
    return Calibration(candidates, columns[4].astype(int), np.array([row[1] for row in rows], int))


def made_for(
    sensor: TactileSensor,
    problem: SearchProblem,
    targets: Sequence[str],
    name: str,
    decider: Decider,
    known: Mapping[str, object],
) -> dict[str, Any]:
    """What a certificate holds for, as JSON types.

    Args:
        sensor: with the scene.
        problem: rules of the search, with the answer Unsure.
        targets: labels of the shapes that are sought.
        name: of the decider.
        decider: the decider itself, with the conflict test if it has one.
        known: objects that deciders hold and that the sensor determines, by name.
    """
    deciders = [fingerprint(decider, target, known) for target in targets]
    world = {
        "scene": scene_fields(sensor.scene),
        "objects and rules": repr(problem),
        "targets": list(targets),
        "decider": name,
        "settings, code or policies of the decider": digest_of(deciders),
        "sensor (SHA-256)": sensor_digest(sensor),
    }
    return json.loads(json.dumps(world))


def with_unsure(problem: SearchProblem) -> SearchProblem:
    """The rules of a search that stops by a certificate."""
    return problem if problem.unsure_reward is not None else replace(problem, unsure_reward=0.0)
