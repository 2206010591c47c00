"""Live searches for a known shape where many objects have none of the known shapes.

The bag holds one object of every known shape and as many strangers, each of a random unknown shape. A search draws its
objects from it, so the target may be absent, and confirming nothing is right then. The same searches are made with a
belief that knows of strangers and with one that does not.

Run: python -m benchmarks.stranger_searches [SCENE] [SEARCHES]      (50 for every target by default; some minutes)
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch import SCENES, Scene, TactileSensor, TouchWorld
from activetouch.named_scenes import NamedScene
from activetouch.scene import WorldObject
from activetouch.shapes import EXTENDED_SHAPES
from activetouch.world import TouchTime, touch_many
from belief import Composition, Counts, SearchProblem
from belief.observation_model import ObservationModel
from belief.seeding import arrangement_rng
from belief.statistics import clopper_pearson_interval
from belief.synthetic import sample_arrangement
from belief.table import Table, interval
from benchmarks.stranger_model import StrangerModel
from experiments.parallel import default_jobs, run_tasks
from planners import Episode, Outcome, make_decider, search_lockstep

KNOWS, IGNORES = "knows of strangers", "knows known shapes only"
_DECIDER = "information_gain"


class WorldWithStrangers(TouchWorld):
    """Objects of known and unknown shapes, read by a sensor that knows the former.

    Args:
        sensor: presses known shapes and reads all images.
        wide: the sensor's scene, with the unknown shapes after the known ones.
        objects: of that scene, in order of visit.
    """

    def __init__(self, sensor: TactileSensor, wide: Scene, objects: Sequence[WorldObject]) -> None:
        super().__init__(sensor, objects)
        self._wide, self._num_known = wide, len(sensor.scene.shapes)

    @property
    def arrangement(self) -> tuple[int, ...]:
        """True shape of every object; strangers have the index after the known shapes."""
        return tuple(min(shape, self._num_known) for shape in super().arrangement)

    def press(self, pose: int | str, rng: np.random.Generator) -> tuple[NDArray[np.uint8], TouchTime]:
        """See :meth:`activetouch.TouchWorld.press`."""
        pressed = self._wide.press(self.current, pose, rng)
        return pressed.image, TouchTime(pressed_again=pressed.num_unsettled)


def stranger_searches(
    sensor: TactileSensor, named: NamedScene, episodes: int, seed: int, jobs: int
) -> dict[str, dict[str, Any]]:
    """Success of searches among strangers, for a belief that knows of them and for one that does not.

    Args:
        sensor: with a model that has a conflict test.
        named: the scene of the sensor.
        episodes: for every target.
        seed: of the episodes.
        jobs: number of processes.

    Returns:
        By kind of belief: ``number`` of searches, ``success`` with ``interval``, ``touches`` a search, ``wrong``:
        fraction with a wrong confirmation, with its interval; ``taken``: fraction that confirmed a stranger; and
        ``no_touch``: success of the better of confirming the first object and rejecting all.
    """
    tasks = [partial(_scores, belief, sensor, named, episodes, seed) for belief in (KNOWS, IGNORES)]
    found = dict(run_tasks(tasks, jobs, "searching among strangers"))
    return {belief: found[belief] for belief in (KNOWS, IGNORES)}


def _scores(
    belief: str, sensor: TactileSensor, named: NamedScene, number: int, seed: int
) -> tuple[str, dict[str, Any]]:
    known, aware = sensor.scene.shape_labels, StrangerModel(sensor.model)
    novel = [label for label in EXTENDED_SHAPES if label not in known]
    wide = replace(sensor.scene, shapes={**sensor.scene.shapes, **{label: EXTENDED_SHAPES[label] for label in novel}})
    bag = Counts({**dict.fromkeys(known, 1), aware.label: len(known)})
    num_objects = min(named.num_objects, bag.total)
    limit = named.touches_per_object * num_objects
    problem = SearchProblem(aware.shape_labels, sensor.scene.pose_labels, num_objects, bag, touch_limit=limit)
    seeds = [(seed, target, n) for target in range(len(known)) for n in range(number)]
    worlds = []
    for seed_of_episode in seeds:
        rng = arrangement_rng(seed_of_episode)
        shapes = [k if k < len(known) else len(known) + int(rng.integers(len(novel)))
                  for k in sample_arrangement(problem, rng)]  # fmt: skip
        worlds.append(WorldWithStrangers(sensor, wide, [wide.sample_object(k, rng) for k in shapes]))
    present = problem.num_objects / bag.total
    used: ObservationModel = aware
    if belief == IGNORES:
        used, problem = sensor.model, replace(problem, shape_labels=known, composition=Composition.INDEPENDENT)
    decider = make_decider(_DECIDER, used.outcome_table(), used)
    targets = [target for _, target, _ in seeds]
    played: list[Episode] = []
    for first in range(0, len(seeds), 25):
        part = slice(first, first + 25)
        some = worlds[part], decider, problem, targets[part], used, seeds[part]
        played += search_lockstep(*some, lambda pending: touch_many(sensor, pending)[0])
    won = sum(bool(episode.success) for episode in played)
    wrong = sum(episode.outcome is Outcome.CONFIRMED and episode.success is False for episode in played)
    confirmed = [episode.confirmed_shape for episode in played if episode.outcome is Outcome.CONFIRMED]
    return belief, {
        "number": len(played),
        "success": won / len(played),
        "interval": clopper_pearson_interval(won, len(played)),
        "touches": float(np.mean([episode.num_touches for episode in played])),
        "wrong": [wrong / len(played), *clopper_pearson_interval(wrong, len(played))],
        "taken": sum(shape == len(known) for shape in confirmed) / len(played),
        "no_touch": max(1.0 / bag.total, 1.0 - present),
    }


def table(name: str, searched: dict[str, dict[str, Any]]) -> Table:
    """The results of :func:`stranger_searches` in a scene as a table."""
    rows = [
        (
            belief,
            interval(found["success"], *found["interval"]),
            interval(*found["wrong"]),
            *(found[key] for key in ("taken", "touches", "no_touch")),
        )
        for belief, found in searched.items()
    ]
    columns = ("belief", "success", "wrong", ("confirmed a stranger", ".3f"), ("touches", ".2f"), ("no touch", ".3f"))
    return Table(f"{name}: {searched[KNOWS]['number']} live searches for a known shape among strangers", columns, rows)


def main(name: str = "gel", episodes: str = "50") -> None:
    """Search, and print the table."""
    sensor = TactileSensor.shipped(name)
    print(table(name, stranger_searches(sensor, SCENES[name], int(episodes), 7, default_jobs())).markdown())


if __name__ == "__main__":
    main(*sys.argv[1:])
