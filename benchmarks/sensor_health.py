"""A sensor in worlds that nobody described to it: its own reader, and one that infers the sensor's state.

    python -m benchmarks.sensor_health coarse --jobs 2
    python -m benchmarks.sensor_health many "noise × 3" "noise × 1.5 + stiffness × 0.7" --sensor gel --sessions 50

A session touches twelve objects one after the other, each in different poses, at most six times, until a shape is
stated with 0.95. Worlds are conditions of ``robustness``, several joined by +, or what changes from touch to touch
("slip, random"); all that apply by default. Three sensors feel the same touches: ``own``, the shipped one; ``as
described``, its reader of any object in the state that the scene describes; ``unknown``, the same with its state
inferred over the session.

Two ways to withhold stops are compared. ``conflict``: where the e-value of the conflict test, which the last sensor
does not have, is 3.5 or more. ``alarm``: after an alarm of :func:`belief.statistics.exchangeability.log_e_values` at
20, calibrated on objects of other sessions in the sensor's own world.

Prints for each sensor: its stops, what they state, the share that is right with its 95 % Wilson interval, touches of an
object; sessions with an alarm, and the median number of objects until then; the share of withheld stops, and how many
of the others are right; and the state that the last sensor holds most probable in the end.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from activetouch import SCENES, Scene, TactileSensor
from activetouch.distributions import Uniform
from activetouch.perception.contacts.hypotheses import num_hypotheses
from activetouch.perception.imaging import sensor_state
from activetouch.perception.reader import HypothesisTable, TactileReader
from activetouch.perception.sensor_worlds import EmbeddedWorlds, changed_worlds
from activetouch.poses import WorldObject
from activetouch.rendering import Noise
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS
from belief import SceneBelief, SearchProblem
from belief.statistics import wilson_interval
from belief.statistics.exchangeability import log_e_values
from belief.touch_fit import touch_fit
from experiments.parallel import Shared, run_tasks
from experiments.robustness.conditions import CONDITIONS, DoesNotApply
from planners.certified import FALSE_ALARM

STATED, SUSPICION = 0.95, np.log(3.5)
OBJECTS, TOUCHES = 12, 6
USUAL = "usual"
_OTHERS = "press dynamic", "press quasistatic", "objects ", "all "  # conditions that are not about the sensor
_PAIRS = (
    "noise × 1.5 + stiffness × 0.7",
    "noise × 2 + 6 % stuck at full scale",
    "noise × 2 + shifted by 3 % of the edge",
    "stiffness × 0.4 + force 0.5 to 1.5 N",
    "hysteresis 5 % + 5 % more dead",
)
REPEATED, FALLING, WALK, STEADY = "noise that repeats", "gain falls 5 % a touch", "slip, random", "slip, steady"
_IN_SESSION = REPEATED, FALLING, WALK, STEADY
"""Changes from touch to touch of an object, or of all touches of a session."""


class Stop(NamedTuple):
    """How the touches of an object ended; ``stated`` is 0 for no stop, ``fit`` is to the sensor's likeliest world."""

    stated: float
    is_right: bool
    touches: int
    is_conflict: bool
    fit: tuple[float, float]


class Session(NamedTuple):
    """The stops of a session's objects, by sensor, and the state that ``unknown`` holds most probable in the end."""

    world: str
    stops: Mapping[str, list[Stop]]
    likeliest: str


def played(shared: Shared[Mapping[str, TactileSensor]], world: str, scene: Scene, seed: Sequence[int]) -> Session:
    sensors, rng = shared.value, np.random.default_rng(seed)
    problem = SearchProblem(scene.shape_labels, scene.pose_labels, num_objects=1, composition="independent")
    bets: dict[str, np.ndarray | float] = dict.fromkeys(sensors, 0.0)
    stops: dict[str, list[Stop]] = {name: [] for name in sensors}
    likeliest = ""
    for _ in range(OBJECTS):
        shape = int(rng.integers(len(scene.shapes)))
        obj, poses = scene.sample_object(shape, rng), rng.permutation(len(scene.poses))[:TOUCHES]
        images = felt(scene, obj, poses, world, rng, seed)
        for name, sensor in sensors.items():
            belief = SceneBelief(problem, sensor.model, log_bets=bets[name])
            for touch in sensor.read(images, poses.tolist()):
                probs = belief.update(0, [touch]).probs
                if probs.max() >= STATED:
                    break
            view, bets[name], component = belief.view(), belief.log_bets, 0
            if (health := view.sensor_health) is not None:
                component, likeliest = int(health.probs[:-1].argmax()), health.labels[int(health.probs.argmax())]
            stated = float(probs.max()) if probs.max() >= STATED else 0.0
            is_right, is_conflict = int(probs.argmax()) == shape, health is None and view.log_conflict >= SUSPICION
            fit = touch_fit(sensor.model, [view.touches(0)], component)
            stops[name].append(Stop(stated, is_right, len(view.touches(0)), bool(is_conflict), fit))
    return Session(world, stops, likeliest)


def felt(
    scene: Scene, obj: WorldObject, poses: np.ndarray, world: str, rng: np.random.Generator, seed: Sequence[int]
) -> np.ndarray:
    """The images of an object's touches, ``(n, ...)``, also where something changes from touch to touch."""
    pressed, slip = [], np.zeros(len(poses))
    if world == WALK:
        slip = rng.normal(0.0, 0.001, len(poses)).cumsum()
    elif world == STEADY:
        slip = 0.0005 * np.arange(len(poses))
    for pose, moved in zip(poses, slip, strict=True):
        there = scene
        if moved:
            low, high = scene.variation.offset.support
            there = replace(scene, variation=replace(scene.variation, offset=Uniform(low + moved, high + moved)))
        pressed.append(there.press(obj, int(pose), rng).image)
    images = np.stack(pressed)
    if world == FALLING:
        return (images * (0.95 ** np.arange(len(images)))[:, None, None]).round().astype(images.dtype)
    if world == REPEATED:
        noise = next(fault.std for fault in scene.faults if isinstance(fault, Noise)) * 255
        pattern = np.random.default_rng(seed).normal(0.0, noise, images.shape[1:])
        return np.clip(images + pattern, 0, 255).round().astype(images.dtype)
    return images


def embed(folder: Path, scene: Scene, pose: int) -> None:
    """Put what sensors need in one pose into the cache."""
    reader = TactileReader.load(folder / ANY_OBJECT_FILE).bound_to(scene)
    HypothesisTable(reader, scene).in_pose(num_hypotheses(scene), pose)
    imaging = reader.hypotheses.imaging
    _, states = changed_worlds(imaging, sensor_state(imaging, scene))
    EmbeddedWorlds(reader.hypotheses, scene, states).in_pose(pose)


def changed(name: str, world: str) -> Scene:
    """A scene in a world, whose parts are joined by +; raises DoesNotApply."""
    scene = SCENES[name].scene
    for part in () if world in (USUAL, *_IN_SESSION) else world.split(" + "):
        scene = CONDITIONS[part](scene)
    return scene


def line(sessions: list[list[Stop]], usual: list[Stop]) -> str:
    """The figures of a sensor in some sessions, whose alarm is calibrated on the ``usual`` objects of its own world."""
    every = [stop for stops in sessions for stop in stops]
    named = [stop for stop in every if stop.stated]
    if not named:
        return f"no stop of {len(every)}"
    alarms = [alarm(stops, usual, seed) for seed, stops in enumerate(sessions)]
    heard = [number for number in alarms if number < OBJECTS]
    kept = [stop for stops, end in zip(sessions, alarms, strict=True) for stop in stops[:end] if stop.stated]
    median = f" after {np.median(heard):g} objects" if heard else ""
    return (
        f"{len(named):4} stops of {len(every)}, stated {np.mean([stop.stated for stop in named]):.3f}, "
        f"right {share(named)}, {np.mean([stop.touches for stop in every]):.2f} touches; "
        f"conflict {withheld(named, [stop for stop in named if not stop.is_conflict])}; "
        f"{len(heard)} of {len(sessions)} alarms{median}, {withheld(named, kept)}"
    )


def alarm(stops: list[Stop], usual: list[Stop], seed: int) -> int:
    """Number of objects of a session after which no more are named; all if there is no alarm."""
    known, since = np.array([stop.fit for stop in usual]), np.array([stop.fit for stop in stops])
    found = log_e_values(known, np.zeros(len(known)), since, np.zeros(len(since)), seed) >= -np.log(FALSE_ALARM)
    return 1 + int(found.argmax()) if found.any() else len(stops)


def withheld(named: list[Stop], kept: list[Stop]) -> str:
    """The share of stops that are not kept, and the share of the kept ones that is right."""
    return f"withheld {1 - len(kept) / len(named):.3f}, " + (f"kept {share(kept)}" if kept else "none kept")


def share(stops: list[Stop]) -> str:
    """The share of stops that is right, with an interval."""
    right = sum(stop.is_right for stop in stops)
    low, high = wilson_interval(right, len(stops))
    return f"{right / len(stops):.3f} [{low:.3f}, {high:.3f}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("worlds", nargs="*")
    parser.add_argument("--sensor", default=None, help="a shipped one with a reader of any object")
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--calibration", type=int, default=60, help="sessions that the alarm knows")
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
    every = [
        *(world for world in CONDITIONS if not world.startswith(_OTHERS)),
        REPEATED,
        FALLING,
        WALK,
        STEADY,
        *_PAIRS,
    ]
    for world in [USUAL, *(given.worlds or every)]:
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
    usual = [partial(played, shared, "", described, [given.seed, 1, n]) for n in range(given.calibration)]
    found = list(run_tasks([*usual, *tasks], given.jobs, "sessions"))
    print(
        f"scene {given.scene}, {given.sessions} sessions of {OBJECTS} objects in each world, alarms from "
        f"{given.calibration} others, seed {given.seed}"
    )
    known = {name: [stop for one in found if not one.world for stop in one.stops[name]] for name in sensors}
    for world in scenes:
        here = [session for session in found if session.world == world]
        likeliest = Counter(session.likeliest for session in here).most_common(3)
        print(f"{world}: {', '.join(f'{label} ({number})' for label, number in likeliest)}")
        for name in sensors:
            print(f"  {name:12} {line([session.stops[name] for session in here], known[name])}")


if __name__ == "__main__":
    main()
