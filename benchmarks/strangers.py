"""Objects of none of the shapes, named by a robot's session: with and without a prior for them, and with doubts.

    python -m benchmarks.strangers gel --objects 50 --seeds 1 2

Each object is touched until something has the probability 0.95, at most 16 times. Half of the objects have a listed
shape, the others are random bodies that no training used. Sensors: as described, and with doubts about its state and
the proportions of objects, as ``activetouch live`` has them. Worlds: conditions of ``robustness``.

Prints for objects of each kind: how many are named rightly, wrongly, "none of these" or not at all, with the 95 %
Wilson interval of those that are wrong, and the mean number of touches.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

import numpy as np

from activetouch import TactileSensor, TouchWorld
from belief import Probe
from belief.naming import NONE_OF_THESE, UNLISTED
from belief.statistics import wilson_interval
from belief.table import Table
from experiments.parallel import run_tasks
from experiments.robustness.conditions import AS_TRAINED, applicable_conditions

PRIORS, ENDS = (0.0, 0.05, 0.15), ("right", "wrong", NONE_OF_THESE, "unsure")
SENSORS = {"as described": {}, "doubted": {"doubting": True}}


def named(scene: str, sensor: str, world: str, prior: float, is_listed: bool, objects: int, seed: int) -> list[float]:
    """How many objects end in each of ENDS, and the mean number of touches."""
    knows = TactileSensor.shipped(scene, **SENSORS[sensor])
    scenes, _ = applicable_conditions(knows.scene, [world] if world else [])
    there = replace(knows, scene=scenes[world or AS_TRAINED])
    ends, touches = dict.fromkeys(ENDS, 0), 0
    for number in range(objects):
        rng, shape = np.random.default_rng([seed, number]), number % len(knows.shape_labels)
        robot = TouchWorld.sample(there, [shape if is_listed else UNLISTED], rng)
        session = knows.naming(seed=[seed, number], unlisted=prior, least_area=None)
        while isinstance(action := session.ask(), Probe):
            session.tell(robot.touch(action.pose, rng))
            touches += 1
        session.tell()
        answer = session.answer
        end = "unsure" if answer is None else NONE_OF_THESE if answer == NONE_OF_THESE else "wrong"
        ends["right" if is_listed and answer == knows.shape_labels[shape] else end] += 1
    return [*ends.values(), touches / objects]


def main() -> None:
    """Play and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--world", default="", help="a condition of robustness; as trained by default")
    parser.add_argument("--objects", type=int, default=50, help="of each kind, for each seed")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    rows = [(sensor, prior, listed) for sensor in SENSORS for prior in PRIORS for listed in (True, False)]
    tasks = [
        partial(named, given.scene, sensor, given.world, prior, listed, given.objects, seed)
        for sensor, prior, listed in rows
        for seed in given.seeds
    ]
    found = np.array(list(run_tasks(tasks, given.jobs, "settings"))).reshape(len(rows), len(given.seeds), -1)
    table, number = [], given.objects * len(given.seeds)
    for (sensor, prior, listed), ends in zip(rows, found, strict=True):
        right, wrong, none, unsure = ends[:, :-1].sum(axis=0).astype(int).tolist()
        low, high = wilson_interval(wrong, number)
        kind = "listed" if listed else "strange"
        table.append((sensor, prior, kind, right, wrong, f"{low:.2f}–{high:.2f}", none, unsure, ends[:, -1].mean()))
    columns = ["sensor", ("prior", ".2f"), "objects", ("right", "d"), ("wrong", "d"), "wrong, 95 %"]
    columns += [(NONE_OF_THESE, "d"), ("unsure", "d"), ("touches", ".2f")]
    title = f"{given.scene}, {given.world or AS_TRAINED}: {number} objects a row"
    print(Table(title, columns, table))


if __name__ == "__main__":
    main()
