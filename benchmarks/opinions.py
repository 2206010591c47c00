"""What a camera's opinion about the objects of a scene saves, and what it costs if it is wrong.

    python -m benchmarks.opinions --scene coarse --episodes 150

A camera names the shape of each object and states 0.95. Right: its name is the true one in 0.95. Wrong by a factor of
20: its name is the true one in 0.49, odds of 19 / 20. Misled: it takes each shape for the next one, which it states to
be 20 times as probable as the true one. Objects, presses and targets are the same for all.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from activetouch import TactileSensor
from activetouch.world import TouchWorld
from belief import Confirm
from belief.seeding import keyed_rng
from belief.statistics import wilson_interval
from belief.table import Table
from planners import make_decider, search

STATED, WRONG_BY = 0.95, 20.0


def opinion_of(kind: str, shapes: np.ndarray, number: int, rng: np.random.Generator) -> np.ndarray | None:
    """Stated probabilities of the shapes of each object, ``(N, K)``."""
    if kind == "none":
        return None
    if kind == "misled":
        found = np.ones((len(shapes), number))
        found[np.arange(len(shapes)), (shapes + 1) % number] = WRONG_BY
        return found / found.sum(axis=1, keepdims=True)
    odds = STATED / (1.0 - STATED) / (WRONG_BY if kind == "wrong" else 1.0)
    is_right = rng.random(len(shapes)) < odds / (1.0 + odds)
    named = np.where(is_right, shapes, (shapes + rng.integers(1, number, len(shapes))) % number)
    found = np.full((len(shapes), number), (1.0 - STATED) / (number - 1))
    found[np.arange(len(shapes)), named] = STATED
    return found


def main() -> None:
    """Search with each kind of opinion, and print touches, success, and what was stated and right."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="coarse")
    parser.add_argument("--episodes", type=int, default=150)
    parser.add_argument("--decider", default="information_gain")
    given = parser.parse_args()
    sensor = TactileSensor.shipped(given.scene)
    problem, number = sensor.problem(), len(sensor.shape_labels)
    decider, rows, usual = make_decider(given.decider, sensor.model.outcome_table(), sensor.model), [], 0.0
    for kind in ("none", "right", "wrong", "misled"):
        episodes = []
        for key in ((97, episode % number, episode) for episode in range(given.episodes)):
            world = TouchWorld.of_search(sensor, problem, key, key[1])
            opinion = opinion_of(kind, np.array(world.arrangement), number, keyed_rng([*key, 5]))
            told = replace(problem, opinion=opinion)
            episodes.append(search(world, decider, told, key[1], sensor.model, key))
        touches = float(np.mean([one.num_touches for one in episodes]))
        usual = usual or touches
        stops = [one for one in episodes if isinstance(one.steps[-1].decision.action, Confirm)]
        stops = [one for one in stops if one.steps[-1].belief.probs[one.target] >= 0.95]
        right = sum(bool(one.success) for one in stops)
        stated = float(np.mean([one.steps[-1].belief.probs[one.target] for one in stops]))
        success = float(np.mean([bool(one.success) for one in episodes]))
        interval = wilson_interval(right, len(stops))
        rows.append((kind, touches, 1.0 - touches / usual, success, len(stops), stated, right / len(stops), interval))
    columns = ["opinion", ("touches", ".2f"), ("saved", ".0%"), ("success", ".3f"), ("stops ≥ 0.95", "d")]
    columns += [("stated", ".3f"), ("right", ".3f"), ("95 %", ".3f")]
    print(Table("", columns, rows, f"{given.episodes} searches of {given.scene} by {given.decider}."))


if __name__ == "__main__":
    main()
