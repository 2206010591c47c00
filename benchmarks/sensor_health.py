"""A sensor in worlds that nobody told it about: its own reader, and one that finds out what is the matter.

    python -m benchmarks.sensor_health coarse --jobs 2
    python -m benchmarks.sensor_health many "noise × 3" "noise × 1.5 + stiffness × 0.7" --sensor gel --sessions 50

A session touches twelve objects one after the other, each in different poses, at most six times, until a shape is
stated with 0.95. Worlds are conditions of ``robustness``, or several joined by +; all that apply by default. Three
sensors feel the same touches: ``own``, the shipped one; ``as described``, its reader of any object in the state that
the scene describes; ``unknown``, the same with its state inferred over the session. A stop is withheld, as by an
abstaining decider, where the e-value of the conflict test is 3.5 or more.

Prints, for each: the stops, what they state, the share that is right with its 95 % Wilson interval, touches of an
object, the share withheld; and what the last holds most probable after its last object, with the number of sessions.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from activetouch import SCENES, Scene, TactileSensor
from activetouch.perception.contacts.hypotheses import num_hypotheses
from activetouch.perception.contacts.sensor_state import sensor_state
from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.perception.reader import TactileReader
from activetouch.perception.sensor_worlds import EmbeddedWorlds, changed_worlds
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS
from belief import SceneBelief, SearchProblem
from belief.statistics import wilson_interval
from experiments.parallel import Shared, run_tasks
from experiments.robustness.conditions import CONDITIONS, DoesNotApply

STATED, SUSPICION = 0.95, np.log(3.5)
OBJECTS, TOUCHES = 12, 6
USUAL = "usual"
_OTHERS = "press ", "objects ", "all "  # conditions that are not about the sensor
_PAIRS = (
    "noise × 1.5 + stiffness × 0.7",
    "noise × 2 + 6 % stuck at full scale",
    "noise × 2 + shifted by 3 % of the edge",
    "stiffness × 0.4 + force 0.5 to 1.5 N",
    "hysteresis 5 % + 5 % more dead",
)


class Stop(NamedTuple):
    """How the touches of an object ended.

    Attributes:
        stated: probability of the named shape; 0 where none reached the threshold.
        is_right: whether it is the true one.
        touches: of the object.
        is_withheld: whether an abstaining decider would not name it.
    """

    stated: float
    is_right: bool
    touches: int
    is_withheld: bool


class Session(NamedTuple):
    """The objects of a session, by sensor; and the likeliest component in the end, of the sensor that infers it."""

    world: str
    stops: Mapping[str, list[Stop]]
    likeliest: str


def played(shared: Shared[Mapping[str, TactileSensor]], world: str, scene: Scene, seed: Sequence[int]) -> Session:
    """One session."""
    sensors, rng = shared.value, np.random.default_rng(seed)
    problem = SearchProblem(scene.shape_labels, scene.pose_labels, num_objects=1, composition="independent")
    bets: dict[str, np.ndarray | float] = dict.fromkeys(sensors, 0.0)
    stops: dict[str, list[Stop]] = {name: [] for name in sensors}
    likeliest = ""
    for _ in range(OBJECTS):
        shape = int(rng.integers(len(scene.shapes)))
        obj, poses = scene.sample_object(shape, rng), rng.permutation(len(scene.poses))[:TOUCHES]
        images = np.stack([scene.press(obj, int(pose), rng).image for pose in poses])
        for name, sensor in sensors.items():
            belief = SceneBelief(problem, sensor.model, log_bets=bets[name])
            for touch in sensor.read(images, poses.tolist()):
                probs = belief.update(0, [touch]).probs
                if probs.max() >= STATED:
                    break
            view, number = belief.view(), len(belief.touches(0))
            is_stop, is_withheld = probs.max() >= STATED, view.log_conflict >= SUSPICION
            stated = float(probs.max()) if is_stop else 0.0
            stops[name].append(Stop(stated, int(probs.argmax()) == shape, number, bool(is_stop and is_withheld)))
            bets[name] = view.log_bets
            if view.sensor_health is not None:
                likeliest = view.sensor_health.labels[int(view.sensor_health.probs.argmax())]
    return Session(world, stops, likeliest)


def embed(folder: Path, scene: Scene, pose: int) -> None:
    """Put what sensors need in one pose into the cache."""
    reader = TactileReader.load(folder / ANY_OBJECT_FILE).bound_to(scene)
    HypothesisTable(reader, scene).in_pose(num_hypotheses(scene), pose)
    imaging = reader.hypotheses.imaging
    EmbeddedWorlds(reader.hypotheses, scene, changed_worlds(sensor_state(imaging, scene))).in_pose(pose)


def changed(name: str, world: str) -> Scene:
    """A scene in a world, whose parts are joined by +; raises DoesNotApply."""
    scene = SCENES[name].scene
    for part in () if world == USUAL else world.split(" + "):
        scene = CONDITIONS[part](scene)
    return scene


def line(stops: list[Stop]) -> str:
    """The figures of a sensor."""
    named = [stop for stop in stops if stop.stated]
    if not named:
        return f"no stop of {len(stops)}"
    right, low, high = share(named)
    kept = [stop for stop in named if not stop.is_withheld]
    touches = np.mean([stop.touches for stop in stops])
    sure = "none kept" if not kept else "kept {:.3f} [{:.3f}, {:.3f}]".format(*share(kept))
    return (
        f"{len(named):4} stops of {len(stops)}, stated {np.mean([stop.stated for stop in named]):.3f}, "
        f"right {right:.3f} [{low:.3f}, {high:.3f}], {touches:.2f} touches; "
        f"withheld {1 - len(kept) / len(named):.3f}, {sure}"
    )


def share(stops: list[Stop]) -> tuple[float, float, float]:
    """Right of stops, with an interval."""
    right = sum(stop.is_right for stop in stops)
    return right / len(stops), *wilson_interval(right, len(stops))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("worlds", nargs="*")
    parser.add_argument("--sensor", default=None, help="a shipped one with a reader of any object")
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    described, folder = SCENES[given.scene].scene, MODELS / (given.sensor or given.scene)
    list(run_tasks([partial(embed, folder, described, p) for p in range(len(described.poses))], given.jobs, "poses"))
    plain = TactileSensor.load(folder, described, unknown_state=True)
    sensors = {"own": TactileSensor.load(MODELS / given.scene, described), "unknown": plain}
    sensors["as described"] = TactileSensor(described, plain.reader, plain.model.nominal, with_logits=False)
    for pose in range(len(described.poses)):
        plain.model.worlds.in_pose(pose)  # from the cache, before there are other processes
    scenes: dict[str, Scene] = {}
    usual = [*(world for world in CONDITIONS if not world.startswith(_OTHERS)), *_PAIRS]
    for world in [USUAL, *(given.worlds or usual)]:
        try:
            scenes[world] = changed(given.scene, world)
        except DoesNotApply as reason:
            print(f"{world}: {reason}")
    shared = Shared(sensors)
    tasks = [
        partial(played, shared, world, scene, [given.seed, number])
        for world, scene in scenes.items()
        for number in range(given.sessions)
    ]
    found = list(run_tasks(tasks, given.jobs, "sessions"))
    print(f"scene {given.scene}, {given.sessions} sessions of {OBJECTS} objects in each world, seed {given.seed}")
    for world in scenes:
        here = [session for session in found if session.world == world]
        likeliest = Counter(session.likeliest for session in here).most_common(3)
        print(f"{world}: {', '.join(f'{label} ({number})' for label, number in likeliest)}")
        for name in sensors:
            print(f"  {name:12} {line([stop for session in here for stop in session.stops[name]])}")


if __name__ == "__main__":
    main()
