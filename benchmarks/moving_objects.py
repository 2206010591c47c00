"""Objects that move between touches, poses that are missed, and presses beside the middle: what a belief says of them.

    python -m benchmarks.moving_objects coarse
    python -m benchmarks.moving_objects keyed --sensor gel --touches 26

Each object is touched by information gain until a shape is stated with 0.95, or a number of touches is reached. Every
world is felt by a sensor that was not told of it, and by one that was. Prints for each: the share of the objects that
are named, what these stops state, the share of them that is right with its 95 % Wilson interval, touches of an object,
and the median processor time of an update of the belief, from the second touch of an object on. For objects that move:
what the belief says of a move before a touch, in bins, and the share that turned by more than 5°.

In two worlds the body is free in MuJoCo and then lies as the touch leaves it (friction 0.3 to 1). "grasped": two pads
close on it. "pushed": one pad presses it, and the palm that holds its place yields to a torque. How often and how far
it turns is what the touches of 60 other objects did. In "lying anew" and "held", every touch finds the object in
another orientation.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from activetouch import SCENES, Scene, TactileSensor, TouchWorld
from activetouch.distributions import Uniform
from activetouch.errors import SceneShift
from activetouch.orientations import Held, Inexact, Moves, Resampled
from activetouch.pressing.closing import Closing
from activetouch.sensor_files import MODELS
from belief.statistics import wilson_interval
from experiments.parallel import Shared, run_tasks
from planners import make_decider
from planners.search import identify

STATED, LARGE, PILOT = 0.95, np.deg2rad(5.0), 1_000_000
BINS = (0.0, 0.02, 0.1, 0.3, 0.6, 0.9, 1.0)
GRIP = 0.01  # [N m]


def freed(scene: Scene, hand: str, law: Closing) -> Scene:
    """The scene with a body that is free to turn; how it moves is found by :func:`fitted`."""
    varied = replace(scene.variation, friction=Uniform(0.3, 1.0))
    return replace(scene.with_hand(hand, law), variation=varied, moves=Moves(shift=0.0))


def angle_between(one: Any, other: Any) -> float:
    return float(2.0 * np.arccos(min(abs(one @ other), 1.0)))


WORLDS: dict[str, Any] = {
    "as described": lambda scene: scene,
    "moves": lambda scene: replace(scene, moves=Moves()),
    "turns alone": lambda scene: replace(scene, moves=Moves(shift=0.0)),
    "pose error 20°": lambda scene: replace(scene, presentation=Inexact(np.deg2rad(20.0))),
    "grasped": lambda scene: freed(scene, "parallel", Closing()),
    "pushed": lambda scene: freed(scene, "one_finger", Closing(grip=GRIP)),
    "lying anew": lambda scene: replace(scene, presentation=Resampled()),
    "held": lambda scene: replace(scene, presentation=Held()),
    "5 mm off": lambda scene: replace(scene, variation=replace(scene.variation, offset=Uniform(-0.005, 0.005))),
}


class Named(NamedTuple):
    """How the touches of an object ended; of each but the first, the probability of a move and its angle [rad]."""

    is_certain: bool
    stated: float
    is_right: bool
    touches: int
    moves: list[tuple[float, float]]
    milliseconds: list[float]


class Watched(TouchWorld):
    """A world that remembers before which touches its object moved."""

    def press(self, pose: Any, rng: np.random.Generator) -> Any:
        """See :class:`activetouch.TouchWorld`."""
        found = super().press(pose, rng)
        self.lay = [*getattr(self, "lay", []), self.current.orientation]  # as it was felt: a grasp is felt at its end
        return found

    @property
    def turned(self) -> list[float]:
        """How far it lay from where it lay in the touch before, for each touch [rad]."""
        return [0.0, *(angle_between(one, other) for one, other in pairwise(self.lay))]


def played(shared: Shared[tuple[TactileSensor, Scene]], number: int, touches: int, seed: int) -> Named:
    sensor, scene = shared.value
    there, shape = replace(sensor, scene=scene), number % len(scene.shapes)
    world = Watched.sample(there, [shape], np.random.default_rng([seed, number, 0]))
    decider = make_decider("information_gain", sensor.model.outcome_table(), sensor.model)
    found = identify(world, decider, sensor.model, scene.pose_labels, [seed, number], STATED, touches)
    evidence, moves, spent = sensor.model.start(), [], []
    for step, touch in enumerate(found.touches):
        started = time.process_time()
        evidence = evidence.update(touch)
        if step:
            spent.append(1e3 * (time.process_time() - started))
            probs = np.exp(evidence.log_likelihood - evidence.log_likelihood.max())
            moved = getattr(evidence, "moved", np.zeros(len(probs)))
            moves.append((float(probs @ moved / probs.sum()), world.turned[step]))
    return Named(found.is_certain, found.stated, found.is_right, len(found.poses), moves, spent)


def line(found: list[Named]) -> str:
    stops = [one for one in found if one.is_certain]
    right = sum(one.is_right for one in stops)
    low, high = wilson_interval(right, len(stops))
    spent = [part for one in found for part in one.milliseconds]
    return (
        f"stops {len(stops) / len(found):.3f}, stated {np.mean([one.stated for one in stops]):.3f}, right "
        f"{right / len(stops):.3f} [{low:.3f}, {high:.3f}], {np.mean([one.touches for one in found]):.2f} touches, "
        f"update {np.median(spent) if spent else 0.0:.2f} ms"
    )


def bins(found: list[Named]) -> str:
    pairs = np.array([(said, angle > LARGE) for one in found for said, angle in one.moves])
    place = np.clip(np.searchsorted(BINS, pairs[:, 0], "right") - 1, 0, len(BINS) - 2)
    some = [pairs[place == number] for number in np.unique(place)]
    return "; ".join(f"{each[:, 0].mean():.2f} said, {each[:, 1].mean():.2f} of {len(each)}" for each in some)


def fitted(sensor: TactileSensor, scene: Scene, touches: int) -> Moves:
    """How often and how far objects turn that are touched for a belief in which nothing moves."""
    shared = Shared((sensor, scene))
    found = [played(shared, number, touches, PILOT) for number in range(60)]
    turned = np.array([angle for one in found for _, angle in one.moves])
    moved = turned[turned > LARGE]
    if not len(moved):  # as when one touch names each object
        return Moves(0.2, shift=0.0)
    return Moves(len(moved) / len(turned), float(np.sqrt((moved**2).mean() / 3.0)), shift=0.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("worlds", nargs="*", default=list(WORLDS))
    parser.add_argument("--sensor", default=None, help="another shipped one")
    parser.add_argument("--objects", type=int, default=200)
    parser.add_argument("--touches", type=int, default=12)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    warnings.simplefilter("ignore", SceneShift)
    usual = SCENES[given.scene].scene
    print(f"scene {given.scene}, sensor {given.sensor or given.scene}, {given.objects} objects, seed {given.seed}")
    for world in given.worlds:
        scene = WORLDS[world](usual)
        still = replace(scene, moves=None) if scene.hand else usual
        if scene.hand:
            sensor = TactileSensor.load(MODELS / (given.sensor or given.scene), still)
            scene = replace(scene, moves=fitted(sensor, scene, given.touches))
        told = {"not told": still, "told": scene}
        if scene == usual:
            told = {"told": usual, "fears moves": WORLDS["moves"](usual)}
        for name, believed in told.items():
            shared = Shared((TactileSensor.load(MODELS / (given.sensor or given.scene), believed), scene))
            tasks = [partial(played, shared, number, given.touches, given.seed) for number in range(given.objects)]
            found = list(run_tasks(tasks, given.jobs, "objects"))
            print(f"{world}, {name}: {line(found)}", flush=True)
            if believed.moves is not None and scene.moves is not None:
                share = np.mean([angle > LARGE for one in found for _, angle in one.moves])
                print(f"  turned {share:.3f}, expected {scene.moves.prob:.3f}; moved: {bins(found)}", flush=True)


if __name__ == "__main__":
    main()
