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
from dataclasses import fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from mesh_files import RADIUS, read

from activetouch.errors import BadMesh
from activetouch.perception.contacts.close_look import CloseLook
from activetouch.perception.contacts.images import images
from activetouch.perception.contacts.views import ViewPlan
from activetouch.perception.imaging import SensorState
from activetouch.pressing.height_maps import predicted_contacts
from activetouch.rotation_cells import views
from activetouch.solids.mesh import Mesh
from activetouch.solids.mesh_file import ENDINGS
from belief.coarse_to_fine import CoarseToFine, Effort
from belief.statistics import wilson_interval
from experiments.meshes.identify import Naming, name_object
from experiments.meshes.setting import MeshSetting
from experiments.parallel import Shared, run_tasks

EDGE = 16  # of images that are compared
COUNTS = (1, 2, 4, 6, 8, 12, 16)
THRESHOLDS = (0.9, 0.95)
RULES = ("information gain", "random", "fixed")
AVERAGED = 16  # objects that the fixed order is best for


class Timed(MeshSetting):
    """A setting that adds up the seconds of its decisions, updates and closer looks, and keeps the beliefs."""

    @cached_property
    def seconds(self) -> np.ndarray:
        """Seconds of decisions, updates and looks, ``(3,)``."""
        return np.zeros(3)

    @cached_property
    def beliefs(self) -> list[CoarseToFine]:
        """Beliefs after each touch."""
        return []

    def information(self, belief: CoarseToFine, target: int | None = None) -> np.ndarray:
        """See :class:`MeshSetting`."""
        started = time.perf_counter()
        found = super().information(belief, target)
        self.seconds[0] += time.perf_counter() - started
        return found

    def update(self, belief: CoarseToFine, pose: int, embedding: np.ndarray) -> CoarseToFine:
        """See :class:`MeshSetting`."""
        started = time.perf_counter()
        found = super().update(belief, pose, embedding)
        self.seconds[1] += time.perf_counter() - started
        return found

    def looked(self, belief: CoarseToFine) -> CoarseToFine:
        """See :class:`MeshSetting`."""
        started = time.perf_counter()
        found = super().looked(belief)
        found.log_probs  # noqa: B018
        self.seconds[2] += time.perf_counter() - started
        self.beliefs.append(found)
        return found


class Touched(NamedTuple):
    """How an object was named, seconds per touch for decisions, updates and looks, and the unresolved share."""

    naming: Naming
    seconds: np.ndarray
    unresolved: float


def best_order(setting: MeshSetting) -> list[int]:
    """A fixed order of poses, greedy by the expected information, averaged over simulated objects."""
    rng, order = np.random.default_rng(0x0BD), list[int]()
    shapes = rng.integers(len(setting.bodies.labels), size=AVERAGED).tolist()
    objects = [setting.scene.sample_object(shape, rng) for shape in shapes]
    beliefs = [setting.bodies.start()] * len(objects)
    while len(order) < len(setting.scene.poses):
        gains = np.sum([setting.information(belief) for belief in beliefs], axis=0)
        gains[order] = -np.inf
        pose = int(gains.argmax())
        order.append(pose)
        felt = [setting.touch(obj, pose, rng) for obj in objects]
        beliefs = [setting.update(belief, pose, touch) for belief, touch in zip(beliefs, felt, strict=True)]
    return order


def touches_to(naming: Naming, threshold: float) -> int | None:
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


def pictures(setting: MeshSetting, views: np.ndarray, recorded: int) -> Pictures:
    """Images without noise in some views, and of simulated touches in random orientations and poses."""
    imaging, rng = setting.reader.hypotheses.imaging, np.random.default_rng(11)
    noiseless, random = replace(imaging, noise=1e-6), torch.Generator().manual_seed(11)
    made: list[list[np.ndarray]] = [[], []]
    for body, solid in enumerate(setting.scene.solids.values()):
        maps = predicted_contacts(solid, views, (0.0, 0.0), imaging.window, 1.0, np.float32)
        world = np.zeros(len(maps), int)
        shown, _ = images(noiseless, torch.from_numpy(maps), SensorState.nominal(1), world, random)
        made[0].append(small(shown.numpy()))
        objects = [setting.scene.sample_object(body, rng) for _ in range(recorded)]
        made[1].append(small(np.stack([setting.scene.press(obj, 0, rng).image / 255 for obj in objects])))
    return Pictures(*(np.stack(each).astype(np.float32) for each in made))


def small(images: np.ndarray) -> np.ndarray:
    """Images averaged to 16 × 16 pixels, ``(n, 256)``."""
    edge = images.shape[-1] // EDGE
    return images.reshape(len(images), EDGE, edge, EDGE, edge).mean(axis=(2, 4)).reshape(len(images), -1)


def compared(shared: Shared[tuple[MeshSetting, Pictures]], number: int, truth: int, poses: Sequence[int]) -> list:
    """Ranks of the true body by the sum of smallest distances of the touches so far, for both kinds of image."""
    setting, known = shared.value
    obj = setting.scene.sample_object(truth, np.random.default_rng([7, number]))
    rngs = [np.random.default_rng([7, number, 2, pose]) for pose in poses]
    felt = small(np.stack([setting.scene.press(obj, p, rng).image / 255 for p, rng in zip(poses, rngs, strict=True)]))
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
    shared: Shared[MeshSetting], orders: dict[str, list[int] | None], number: int, truth: int, touches: int
) -> list[Touched]:
    """One object, touched by every rule, in a given order of poses or by information gain."""
    setting, made = shared.value, []
    obj = setting.scene.sample_object(truth, np.random.default_rng([7, number]))
    for rule, order in orders.items():
        timed = Timed(**{one.name: getattr(setting, one.name) for one in fields(setting)})
        if rule == "random":
            order = np.random.default_rng([7, number, 1]).permutation(len(setting.scene.poses)).tolist()
        naming = name_object(timed, obj, [7, number], touches, order=order)
        made.append(Touched(naming, timed.seconds / len(naming.poses), timed.beliefs[-1].unresolved))
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
    effort = Effort(splits=args.splits, kept=4 * args.splits)
    look = CloseLook(args.looked)
    setting = MeshSetting.of(solids, plan=plan, levels=args.levels, effort=effort, look=look, jobs=args.jobs)
    model = setting.bodies
    print(
        f"embedded and fitted in {time.perf_counter() - started:.0f} s: {model.table.nbytes / 1e6:.0f} MB in memory, "
        f"cells of levels {model.levels}, temperature {1 / model.scale:.2f}, drift {model.drift:.3f}"
    )
    truths = np.random.default_rng(3).permutation(np.arange(args.searches) % len(solids))
    orders: dict[str, list[int] | None] = dict.fromkeys(args.rules)
    if "fixed" in orders:
        started = time.perf_counter()
        orders["fixed"] = best_order(setting)
        print(f"best fixed order {orders['fixed'][:8]} in {time.perf_counter() - started:.0f} s")
    shared = Shared(setting)
    tasks = [partial(searched, shared, orders, n, int(truth), args.touches) for n, truth in enumerate(truths)]
    found = list(run_tasks(tasks, args.jobs, "searches"))
    for place, rule in enumerate(orders):
        report(rule, [one[place] for one in found])
    if args.compared:
        started = time.perf_counter()
        known = pictures(setting, views(44, 8), 26)
        print(f"\nimages of {len(solids)} bodies in {time.perf_counter() - started:.0f} s")
        both, poses = Shared((setting, known)), np.random.default_rng(5)
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
