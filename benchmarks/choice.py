"""Processor time of one choice of the next touch in ``keyed``, by number of places, hypotheses and outcomes.

python -m benchmarks.choice
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from activetouch import Scene, TactileSensor, TouchWorld
from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.poses import Quaternion, facing
from belief import Probe, SceneBelief, SearchProblem
from belief.observation_model.rigid_body import RigidBodyModel
from planners import InformationState
from planners.probing import ShapeInformationGain

OBJECTS, TOUCHES = 5, 8


def spread(number: int) -> dict[str, Quaternion]:
    """So many directions, evenly spread: a Fibonacci lattice."""
    z = 1.0 - 2.0 * (np.arange(number) + 0.5) / number
    angle, radius = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(number), np.sqrt(1.0 - z * z)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    return {f"direction {n}": facing(tuple(d)) for n, d in enumerate(directions)}


def with_places(sensor: TactileSensor, scene: Scene) -> TactileSensor:
    """The sensor of a scene in the same scene with other directions: as it is not calibrated for them, by its own."""
    model, table, number = sensor.model, HypothesisTable(sensor.reader, scene), len(scene.poses)
    assert isinstance(model, RigidBodyModel)
    if table.groups:
        return TactileSensor(scene, sensor.reader, replace(model, groups=table.groups).with_hypotheses(table))
    own = {name: np.repeat(getattr(model, name)[:1], number, axis=0) for name in ("references", "reference_logits")}
    return TactileSensor(scene, sensor.reader, replace(model, groups=(), **own).with_hypotheses(table))


def milliseconds(sensor: TactileSensor, hypotheses: int, outcomes: int) -> list[float]:
    """Processor time of every choice but the first of an object, which is the same for all objects."""
    scene, model = sensor.scene, sensor.model
    problem = SearchProblem(scene.shape_labels, scene.pose_labels, 4)
    selector = ShapeInformationGain(model.outcome_table(), hypotheses=hypotheses, outcomes=outcomes)
    found = []
    for number in range(OBJECTS):
        rng = np.random.default_rng(number)
        world, belief = TouchWorld.sample(sensor, (number % 8,), rng), SceneBelief(problem, model)
        for touch in range(TOUCHES):
            info = InformationState.of(problem, 0, belief, 0)
            started = time.process_time()
            action = selector.choose(info, rng).action
            if touch:
                found.append(1e3 * (time.process_time() - started))
            assert isinstance(action, Probe)
            belief.update(0, [world.touch(action.pose, rng)])
    return found


def main() -> None:
    """Print the table."""
    print("places  hypotheses  outcomes  median [ms]  90 % below [ms]")
    keyed = TactileSensor.shipped("keyed")
    for places in (26, 200):
        scene = keyed.scene if places == len(keyed.scene.poses) else replace(keyed.scene, poses=spread(places))
        sensor = with_places(keyed, scene)
        for hypotheses, outcomes in ((64, 128), (128, 256), (256, 512)):
            times = milliseconds(sensor, hypotheses, outcomes)
            median, high = np.quantile(times, [0.5, 0.9])
            print(f"{places:6d}  {hypotheses:10d}  {outcomes:8d}  {median:11.1f}  {high:15.1f}")


if __name__ == "__main__":
    main()
