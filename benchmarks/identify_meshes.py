"""Which of many mesh files is it? Identification by touch, with nothing trained for these bodies.

    python benchmarks/identify_meshes.py build/pybullet_data/random_urdfs --meshes 100 --searches 200

Bodies are scaled to 24 mm, pressed by the pad of `gel` from 26 directions, and vary by 3 % in size. The belief is
compared, on touches in random directions, with render-and-compare (the body with the nearest predicted images), with
the nearest neighbours among 26 recorded touches of each body, and with chance.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from mesh_files import RADIUS, read

from activetouch import TactileSensor, TouchWorld
from activetouch.errors import BadMesh
from activetouch.perception.contacts.close_look import CloseContacts, CloseLook
from activetouch.perception.contacts.images import images
from activetouch.perception.contacts.views import ViewPlan
from activetouch.perception.imaging import SensorState
from activetouch.perception.many_bodies import NestedPlan
from activetouch.pressing.height_maps import predicted_contacts
from activetouch.rotation_cells import views
from activetouch.solids.mesh import Mesh
from activetouch.solids.mesh_file import ENDINGS
from belief import SceneBelief, SearchProblem
from belief.coarse_to_fine import Effort
from belief.observation_model.nested_bodies import NestedEvidence
from belief.statistics import wilson_interval
from experiments.meshes.setting import sensor_of
from experiments.parallel import Shared, run_tasks
from planners import InformationState
from planners.decider import ProbeSelector
from planners.probing import GivenOrder, RandomOrder, ShapeInformationGain
from planners.search import Identification, identify

EDGE = 16  # of images that are compared
COUNTS = (1, 2, 4, 6, 8, 12, 16)
THRESHOLDS = (0.9, 0.95)
RULES = ("information gain", "random", "fixed")
AVERAGED = 16  # objects that the fixed order is best for


class Touched(NamedTuple):
    """How an object was named, seconds per touch for decisions, updates and looks, and the unresolved share."""

    naming: Identification
    seconds: np.ndarray
    unresolved: float


SPENT = {"decision": 0.0, "update": 0.0, "looks": 0.0}  # seconds of this process


def time_into(name: str, owner: type, method: str) -> None:
    """Add up the seconds that a method of a class takes."""
    plain = getattr(owner, method)

    def timed(*arguments: Any, **others: Any) -> Any:
        started = time.perf_counter()
        found = plain(*arguments, **others)
        SPENT[name] += time.perf_counter() - started
        return found

    setattr(owner, method, timed)


def start_clocks() -> None:
    """Begin to add up seconds, once in each process."""
    if NestedEvidence.update.__name__ != "timed":
        time_into("decision", ShapeInformationGain, "choose")
        time_into("update", NestedEvidence, "update")
        time_into("looks", CloseContacts, "looked")


def best_order(sensor: TactileSensor) -> tuple[str, ...]:
    """A fixed order of poses, greedy by the expected information, averaged over simulated objects."""
    rng, order = np.random.default_rng(0x0BD), list[int]()
    shapes = rng.integers(len(sensor.shape_labels), size=AVERAGED).tolist()
    worlds = [TouchWorld.sample(sensor, [shape], rng) for shape in shapes]
    problem = SearchProblem(sensor.shape_labels, sensor.pose_labels, 1, "independent")
    scenes, selector = (
        [SceneBelief(problem, sensor.model) for _ in worlds],
        ShapeInformationGain(sensor.model.outcome_table()),
    )
    while len(order) < len(sensor.pose_labels):
        told = [selector.choose(InformationState.of(problem, 0, scene, 0), rng).scores for scene in scenes]
        gains = np.array([sum(one.get(f"gain_{pose}", 0.0) for one in told) for pose in sensor.pose_labels])
        gains[order] = -np.inf
        order.append(int(gains.argmax()))
        for scene, world in zip(scenes, worlds, strict=True):
            scene.update(0, [world.touch(order[-1], rng)])
    return tuple(sensor.pose_labels[pose] for pose in order)


def touches_to(naming: Identification, threshold: float) -> int | None:
    """Touches until a body is as probable as the threshold; None if that was not reached."""
    reached = np.flatnonzero(naming.log_probs.max(axis=1) >= np.log(threshold))
    return int(reached[0]) + 1 if len(reached) else None


def bodies(folder: Path, number: int, jobs: int = 1) -> dict[str, Mesh]:
    """Bodies of a folder, evenly chosen and scaled to one size."""
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in ENDINGS)
    chosen = [files[i] for i in np.unique(np.linspace(0, len(files) - 1, number).round().astype(int))]
    tasks = [partial(body, path, str(path.relative_to(folder).with_suffix(""))) for path in chosen]
    found = list(run_tasks(tasks, jobs, "bodies"))
    return {mesh.name: mesh for mesh in found if mesh is not None}


def body(path: Path, name: str) -> Mesh | None:
    """The body of a file, scaled; None if it cannot be read."""
    try:
        mesh, _ = read(path)
    except BadMesh:
        return None
    factor = RADIUS / mesh.bounding_radius
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return Mesh(name, mesh.vertices * factor, mesh.faces)


class Pictures(NamedTuple):
    """Images of every body, ``(K, V, n * n)`` each: predicted in many views, and of recorded touches."""

    predicted: np.ndarray
    recorded: np.ndarray


def pictures(sensor: TactileSensor, views: np.ndarray, recorded: int) -> Pictures:
    """Images without noise in some views, and of simulated touches in random orientations and poses."""
    imaging, rng = sensor.reader.hypotheses.imaging, np.random.default_rng(11)
    noiseless, random = replace(imaging, noise=1e-6), torch.Generator().manual_seed(11)
    made: list[list[np.ndarray]] = [[], []]
    for body, solid in enumerate(sensor.scene.solids.values()):
        maps = predicted_contacts(solid, views, (0.0, 0.0), imaging.window, 1.0, np.float32)
        world = np.zeros(len(maps), int)
        shown, _ = images(noiseless, torch.from_numpy(maps), SensorState.nominal(1), world, random)
        made[0].append(small(shown.numpy()))
        objects = [sensor.scene.sample_object(body, rng) for _ in range(recorded)]
        made[1].append(small(np.stack([sensor.scene.press(obj, 0, rng).image / 255 for obj in objects])))
    return Pictures(*(np.stack(each).astype(np.float32) for each in made))


def small(images: np.ndarray) -> np.ndarray:
    """Images averaged to 16 × 16 pixels, ``(n, 256)``."""
    edge = images.shape[-1] // EDGE
    return images.reshape(len(images), EDGE, edge, EDGE, edge).mean(axis=(2, 4)).reshape(len(images), -1)


def compared(shared: Shared[tuple[TactileSensor, Pictures]], number: int, truth: int, poses: Sequence[int]) -> list:
    """Ranks of the true body by the sum of smallest distances of the touches so far, for both kinds of image."""
    sensor, known = shared.value
    obj = sensor.scene.sample_object(truth, np.random.default_rng([7, number]))
    rngs = [np.random.default_rng([7, number, 2, pose]) for pose in poses]
    felt = small(np.stack([sensor.scene.press(obj, p, rng).image / 255 for p, rng in zip(poses, rngs, strict=True)]))
    ranks = []
    for bank in known:
        squares = (bank**2).sum(axis=2)
        total, found = np.zeros(len(bank)), []
        for image in felt:
            total += (squares - 2 * bank @ image.astype(np.float32)).min(axis=1)
            found.append(int((total < total[truth]).sum()))
        ranks.append(found)
    return ranks


def searched(
    shared: Shared[tuple[TactileSensor, dict[str, ProbeSelector]]], number: int, truth: int, touches: int
) -> list[Touched]:
    """One object, touched by every rule."""
    start_clocks()
    (sensor, rules), made = shared.value, []
    for rule in rules.values():
        world = TouchWorld.sample(sensor, [truth], np.random.default_rng([7, number]))
        SPENT.update(dict.fromkeys(SPENT, 0.0))
        naming = identify(world, rule, sensor.model, sensor.pose_labels, [7, number], None, touches)
        spent = np.array(list(SPENT.values())) - [0.0, SPENT["looks"], 0.0]
        evidence = sensor.model.start()
        for touch in naming.touches:
            evidence = evidence.update(touch)
        made.append(Touched(naming, spent / len(naming.poses), evidence.belief.unresolved))
    return made


def report(rule: str, touched: list[Touched]) -> None:
    """Print accuracy by touches, stops, and times."""
    found = [one.naming for one in touched]
    truths = np.array([one.truth for one in found])
    logs = np.stack([one.log_probs for one in found])
    print(f"\n{rule}: {len(found)} objects")
    for count in COUNTS:
        if count > logs.shape[1]:
            break
        now = logs[:, count - 1]
        right = now.argmax(axis=1) == truths
        five = (np.argsort(-now, axis=1)[:, :5] == truths[:, None]).any(axis=1)
        low, high = wilson_interval(int(right.sum()), len(right))
        stated, nll = np.exp(now.max(axis=1)).mean(), -now[np.arange(len(now)), truths].mean()
        print(
            f"  after {count:2d} touches: right {right.mean():.3f} [{low:.3f}, {high:.3f}], "
            f"among five {five.mean():.3f}, stated {stated:.3f}, NLL {nll:.3f}"
        )
    for threshold in THRESHOLDS:
        stops = [touches_to(one, threshold) for one in found]
        done = [(n, one) for n, one in zip(stops, found, strict=True) if n is not None]
        if done:
            right = [bool(one.log_probs[n - 1].argmax() == one.truth) for n, one in done]
            said = np.mean([np.exp(one.log_probs[n - 1].max()) for n, one in done])
            low, high = wilson_interval(sum(right), len(right))
            spent = np.array([n if n is not None else logs.shape[1] for n in stops])
            half = 1.96 * spent.std(ddof=1) / np.sqrt(len(spent))
            print(
                f"  stops at {threshold}: {len(done)} of {len(found)} reach it, right {np.mean(right):.3f} "
                f"[{low:.3f}, {high:.3f}], stated {said:.3f}; touches {spent.mean():.2f} ± {half:.2f} "
                f"(those that never reach it count as {logs.shape[1]})"
            )
    deciding, updating, looking = np.mean([one.seconds for one in touched], axis=0) * 1e3
    rest = np.mean([one.unresolved for one in touched])
    print(
        f"  decision {deciding:.1f} ms, update {updating:.1f} ms, closer looks {looking:.0f} ms, means of a touch, "
        f"unresolved in the end {rest:.3f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--meshes", type=int, default=20)
    parser.add_argument("--searches", type=int, default=50)
    parser.add_argument("--touches", type=int, default=16)
    parser.add_argument("--directions", type=int, default=88)
    parser.add_argument("--rolls", type=int, default=12)
    parser.add_argument("--width", type=float, default=0.25)
    parser.add_argument("--levels", type=int, nargs="+")
    parser.add_argument("--splits", type=int, default=1024)
    parser.add_argument("--looked", type=int, default=CloseLook().bodies, help="bodies looked at closely; 0 for none")
    parser.add_argument("--rules", nargs="+", default=RULES, choices=RULES)
    parser.add_argument("--compared", type=int, default=0, help="searches that images are compared in")
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    started = time.perf_counter()
    solids = bodies(args.folder, args.meshes, args.jobs)
    print(f"{len(solids)} bodies read in {time.perf_counter() - started:.0f} s")
    started, plan = time.perf_counter(), ViewPlan(args.directions, args.rolls, args.width)
    effort, look = Effort(splits=args.splits, kept=4 * args.splits), CloseLook(args.looked)
    sensor = sensor_of(solids, plan=NestedPlan(plan, args.levels and tuple(args.levels), effort, look), jobs=args.jobs)
    sensor, model = replace(sensor, with_logits=False), sensor.model
    print(
        f"embedded and fitted in {time.perf_counter() - started:.0f} s: {model.bodies.table.nbytes / 1e6:.0f} MB in "
        f"memory, cells of levels {model.bodies.levels}, temperature {1 / model.scale:.2f}, drift {model.drift:.3f}"
    )
    truths = np.random.default_rng(3).permutation(np.arange(args.searches) % len(solids))
    rules: dict[str, ProbeSelector] = {}
    for rule in args.rules:
        started = time.perf_counter()
        if rule == "fixed":
            rules[rule] = GivenOrder(best_order(sensor))
            print(f"best fixed order {rules[rule].order[:8]} in {time.perf_counter() - started:.0f} s")
        else:
            rules[rule] = RandomOrder() if rule == "random" else ShapeInformationGain(model.outcome_table())
    shared = Shared((sensor, rules))
    tasks = [partial(searched, shared, n, int(truth), args.touches) for n, truth in enumerate(truths)]
    found = list(run_tasks(tasks, args.jobs, "searches"))
    for place, rule in enumerate(rules):
        report(rule, [one[place] for one in found])
    if args.compared:
        started = time.perf_counter()
        known = pictures(sensor, views(44, 8), 26)
        print(f"\nimages of {len(solids)} bodies in {time.perf_counter() - started:.0f} s")
        both, poses = Shared((sensor, known)), np.random.default_rng(5)
        tasks = [
            partial(compared, both, n, int(truth), poses.permutation(26)[: args.touches].tolist())
            for n, truth in enumerate(truths[: args.compared])
        ]
        ranks = np.array(list(run_tasks(tasks, args.jobs, "comparisons")))
        names = f"render and compare, {known.predicted.shape[1]} views", "nearest of 26 recorded touches of each body"
        for place, name in enumerate(names):
            right = [
                f"{count}: {(ranks[:, place, count - 1] == 0).mean():.3f}" for count in COUNTS if count <= args.touches
            ]
            print(f"{name}: {len(ranks)} objects, right after {', '.join(right)}")
    print(f"\nchance {1 / len(solids):.4f}")


if __name__ == "__main__":
    main()
