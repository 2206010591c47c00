"""Live searches for a known shape where many objects have none of the known shapes.

The bag holds one object of every known shape and as many strangers, each of a random unknown shape. A search draws its
objects from it, so the target may be absent, and confirming nothing is right then. The same searches are made with a
belief that knows of strangers and with one that does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch import Scene, TactileSensor, TouchWorld
from activetouch.named_scenes import NamedScene
from activetouch.scene import WorldObject
from activetouch.scene_description import scene_fields
from activetouch.shapes import EXTENDED_SHAPES
from activetouch.world import TouchTime
from belief import Composition, Counts, SearchProblem
from belief.observation_model import ObservationModel
from belief.observation_model.strangers import StrangerModel
from belief.seeding import arrangement_rng
from belief.synthetic import sample_arrangement
from experiments.parallel import run_tasks
from experiments.robustness.kept import kept
from experiments.robustness.searches import played_together, success_scores
from experiments.search.fingerprint import fingerprint
from planners import Outcome, make_decider

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
    sensor: TactileSensor, named: NamedScene, episodes: int, seed: int, jobs: int, folder: Path | None = None
) -> dict[str, dict[str, Any]]:
    """Success of searches among strangers, for a belief that knows of them and for one that does not.

    Args:
        sensor: with a model that has a conflict test.
        named: the scene of the sensor.
        episodes: for every target.
        seed: of the episodes.
        jobs: number of processes.
        folder: of finished results, which are read and not played again; none are kept by default.

    Returns:
        By kind of belief ``number``, ``success`` with its ``interval``, ``wrong``: fraction of searches that confirmed
        a wrong object, with its interval; ``taken``: fraction that confirmed a stranger; ``touches``; and
        ``no_touch``: success of the better of confirming the first object and rejecting all.
    """
    tasks = [partial(_search_all, belief, sensor, named, episodes, seed, folder) for belief in (KNOWS, IGNORES)]
    found = dict(run_tasks(tasks, jobs, "searching among strangers"))
    return {belief: found[belief] for belief in (KNOWS, IGNORES)}


def _search_all(
    belief: str, sensor: TactileSensor, named: NamedScene, number: int, seed: int, folder: Path | None
) -> tuple[str, dict[str, Any]]:
    rules = [named.num_objects, named.touches_per_object]
    words = [belief, scene_fields(sensor.scene), fingerprint(sensor.scene), rules, number, seed]
    return belief, kept(folder, words, partial(_scores, belief == KNOWS, sensor, named, number, seed))


def _scores(knows: bool, sensor: TactileSensor, named: NamedScene, number: int, seed: int) -> dict[str, Any]:
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
    if not knows:
        used, problem = sensor.model, replace(problem, shape_labels=known, composition=Composition.INDEPENDENT)
    decider = make_decider(_DECIDER, used.outcome_table(), used)

    targets = [target for _, target, _ in seeds]
    played = played_together(sensor, worlds, decider, problem, targets, used, seeds)
    confirmed = [episode.confirmed_shape for episode in played if episode.outcome is Outcome.CONFIRMED]
    return {
        **success_scores(played),
        "taken": sum(shape == len(known) for shape in confirmed) / len(played),
        "no_touch": max(1.0 / bag.total, 1.0 - present),
    }
