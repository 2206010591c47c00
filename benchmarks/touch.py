"""Measure the time of the parts of a touch: press, rendering, network, belief. One process, one thread.

Run: python benchmarks/touch.py

Times are medians of interleaved rounds. Ratios to the quasistatic touch are taken within a round, so they hardly depend
on other load.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from rounds import time_in_rounds

from activetouch import Dynamic, Quasistatic, Scene, TactileSensor, TouchWorld
from activetouch.placement import Placement
from activetouch.pressing.contact import surface_gap
from belief import SceneBelief, SearchProblem
from belief.arrangement import arrangement_marginals
from planners import InformationState, make_decider

ROUNDS, PER_ROUND = 7, 60


def cases() -> dict[str, Callable[[int], object]]:
    """Functions to time, which take a running number."""
    sensor = TactileSensor.shipped("gel")
    rng = np.random.default_rng(0)
    scenes = {"dynamic": Scene(press_model=Dynamic()), "quasistatic": Scene(press_model=Quasistatic())}
    things = [sensor.scene.sample_object(i % 4, rng) for i in range(PER_ROUND)]
    placements = [
        Placement(list(sensor.scene.shapes.values())[thing.shape_index], thing.scale, thing.orientation)
        for thing in things
    ]
    images = np.stack([scenes["quasistatic"].press(thing, 0, rng)[1] for thing in things])
    touches = sensor.read(images, [0] * len(images))
    problem = SearchProblem(sensor.scene.shape_labels, sensor.scene.pose_labels, num_objects=4)
    decider = make_decider("information_gain", sensor.model.outcome_table())
    weights = {n: rng.normal(size=(n, n)) for n in (4, 12)}
    world = TouchWorld(sensor, things[:4])
    return {
        "quasistatic touch: height map, force balance, noise": lambda i: scenes["quasistatic"].press(
            things[i], i % 6, rng
        ),
        "dynamic touch: the same, and stepped MuJoCo": lambda i: scenes["dynamic"].press(things[i], i % 6, rng),
        "height map alone, 128 × 128 rays": lambda i: surface_gap(sensor.scene.pad, placements[i]),
        "network, one image at a time": lambda i: sensor.reader.read(images[i : i + 1]),
        "network, per image of a batch of 60": lambda i: sensor.reader.read(images) if i == 0 else None,
        "touch and read, one at a time": lambda i: world.touch(i % 6, rng),
        "belief of four distinct objects, updated": lambda i: SceneBelief(problem, sensor.model).update(
            0, [touches[i]]
        ),
        "decision of the information-gain decider": lambda i: decider.decide(
            InformationState(problem, 0, SceneBelief(problem, sensor.model).belief(0)), rng
        ),
        "exact marginals, 4 distinct objects": lambda i: arrangement_marginals(weights[4]),
        "exact marginals, 12 distinct objects": lambda i: arrangement_marginals(weights[12]),
    }


def main() -> None:
    milliseconds = time_in_rounds(cases(), ROUNDS, PER_ROUND)
    base = next(iter(milliseconds.values()))
    print(f"{'median of ' + str(ROUNDS) + ' rounds':<54}{'ms':>9}{'per s':>9}{'ratio':>8}")
    for name, times in milliseconds.items():
        median, ratio = np.median(times), np.median(times / base)
        print(f"{name:<54}{median:9.3f}{1e3 / median:9.0f}{ratio:8.2f}")


if __name__ == "__main__":
    main()
