"""Processor time of one update of the evidence about an object, of the scene's belief, and of one decision.

    python -m benchmarks.one_decision

One thread, live touches, the sensors' own number of hypotheses, information gain with its default settings. Decisions
before the first touch of an object are left out, because they are the same for all objects, and so are those to stop.
Other programs on the machine make the median larger; a tenth of the times is below the second number.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from activetouch import SCENES, TactileSensor, TouchWorld
from belief import Probe, SceneBelief
from experiments.scene_choice import SceneChoice
from experiments.search.setting import Setting
from planners import InformationState, make_decider

OBJECTS, TOUCHES = 24, 4


def milliseconds(scene: str) -> tuple[list[float], list[float], list[float]]:
    """Processor time of updates of the evidence, of the scene's belief, and of decisions."""
    setting, sensor = Setting(SceneChoice(scene)), TactileSensor.shipped(scene)
    problem, model = setting.problem, sensor.model
    decider = make_decider("information_gain", model.outcome_table(), model)
    evidences: list[float] = []
    beliefs: list[float] = []
    decisions: list[float] = []
    for number in range(OBJECTS):
        rng, target = np.random.default_rng(number), number % problem.num_shapes
        world = TouchWorld.sample(sensor, (target,) * problem.num_objects, rng)
        belief, evidence = SceneBelief(problem, model), model.start()
        for touch in range(TOUCHES):
            info = InformationState.of(problem, target, belief, 0)
            started = time.process_time()
            action = decider.decide(info, rng).action
            if touch and isinstance(action, Probe):
                decisions.append(1e3 * (time.process_time() - started))
            felt = world.touch(action.pose if isinstance(action, Probe) else touch % problem.num_poses, rng)
            started = time.process_time()
            evidence = evidence.update(felt)
            _ = evidence.log_likelihood
            evidences.append(1e3 * (time.process_time() - started))
            started = time.process_time()
            belief.update(0, [felt])
            beliefs.append(1e3 * (time.process_time() - started))
    return evidences, beliefs, decisions


def main() -> None:
    """Print the table."""

    def cell(times: Sequence[float]) -> str:
        return "{:8.2f}{:6.2f}".format(*np.quantile(times, [0.5, 0.1])) if times else "       –     –"

    print(f"scene   shapes  hypotheses{'evidence':>14s}{'belief':>14s}{'decision':>14s}   [ms: median, a tenth below]")
    for scene in SCENES:
        model = TactileSensor.shipped(scene).model
        cells = "".join(map(cell, milliseconds(scene)))
        print(f"{scene:7s} {len(model.shape_labels):6d} {getattr(model, 'num_hypotheses', 0):11d}{cells}", flush=True)


if __name__ == "__main__":
    main()
