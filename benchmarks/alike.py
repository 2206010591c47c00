"""Which objects feel alike to a pad: the error of telling two shapes apart, by simulated contacts.

    touches of random objects of one shape  →  the presses of the other shape that look most like them  →  error

Nothing is trained. Two images at a distance d, in units of the noise, are confused with probability Φ(-d / 2). The
distance from the other shape is the smallest over its orientation and size, which the touches of an object share, and
over the offset of each touch (:mod:`benchmarks.contact_fit`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.hypotheses import quaternions
from activetouch.poses import POSE_SETS, hamilton_product, random_orientation, to_matrices, turn, turned
from activetouch.pressing.height_maps import Window, predicted_contacts
from activetouch.scene import Scene
from activetouch.shapes import Shape
from belief.errors import InvalidArgument
from belief.statistics import wilson_interval
from belief.validation import require_count
from benchmarks.contact_fit import ContactFit, Floats
from experiments.parallel import run_tasks

SHOWN = 0.05
"""A difference shows if two shapes are confused with less than this probability."""
_ORIENTATIONS, _ROLLS = 1000, 4  # of the bank
_TOUCHES = 6
_STARTS, _STEPS, _FIRST = 2, 5, 6
_ALIGNMENTS, _ALIGNED = 2, 4  # rounds, and objects that tell how the frames of two shapes lie to each other
_SAME, _NEAR = 0.25, 400.0  # squared distances: of images that are one, and of those worth more steps
_HOPELESS = 1.5  # times the distance at which the bank finds 95 % of the touches of its own shape
_VIEWS, _SEEN_PIXELS = 50, 48  # height maps of a whole shape, and their pixels along an edge
_MOST_COMPARED = 2  # pairs whose touches from 26 directions are compared


@dataclass(frozen=True)
class Likeness:
    """How alike two shapes feel. Errors are in [0, 0.5], with 95 % intervals over simulated touches.

    Attributes:
        shapes: their labels.
        one: error after one touch, of a reader that is told where to look.
        one_interval: its interval.
        one_compared: the same of a reader that compares images with those of 4 000 orientations of each shape.
        all: as ``one``, after all touches.
        all_interval: its interval.
        all_compared: as ``one_compared``, after all touches.
        shown: share of objects in whose touches a difference shows, for the one of the two where it is larger.
        shown_from_26: the same with the poses of ``directions26``; None where it was not computed.
    """

    shapes: tuple[str, str]
    one: float
    one_interval: tuple[float, float]
    one_compared: float
    all: float
    all_interval: tuple[float, float]
    all_compared: float
    shown: float
    shown_from_26: float | None = None


@dataclass(frozen=True)
class Alike:
    """Result of :func:`alike`.

    Attributes:
        pairs: of shapes, most alike first.
        reach: by label, the share of the surface seen from outside that some touch of a tumbled object meets, and the
            mean share that all touches of one object meet.
        num_touches: of each object.
    """

    pairs: tuple[Likeness, ...]
    reach: dict[str, tuple[float, float]]
    num_touches: int


def alike(scene: Scene, *, num_objects: int = 20, seed: int = 0, jobs: int = 1) -> Alike:
    """How alike the shapes of a scene feel to its pad, and what the poses reach of them.

    Objects are tumbled, and pressed on the approach axis, beside it by the scene's offset, with the middle of its
    forces. At most six poses are used, drawn if there are more. Images are pressures on at most 12 × 12 taxels with the
    scene's noise, and with 1 % of full scale below which no difference counts. Gain, broken taxels and what a
    renderer adds or hides are left out.

    The errors are estimates. A reader may lie between the two: the error of a reader that is told where to look is too
    small where the search misses the press that looks most alike; a reader that compares images does not know of small
    differences.

    Args:
        scene: shapes, poses, pad, sizes, offsets and noise.
        num_objects: simulated of each shape, at least 2.
        seed: of the objects.
        jobs: number of processes; the result does not depend on it.

    Raises:
        InvalidArgument: there are fewer than two shapes or two objects, or a shape is a family.
    """
    require_count("num_objects", num_objects)
    if min(len(scene.shapes), num_objects) < 2:
        raise InvalidArgument(f"needs two shapes and two objects of each, got {len(scene.shapes)} and {num_objects}")
    if scene.families:
        raise InvalidArgument(f"compares solids, but the proportions of {', '.join(scene.families)} vary")
    study = _Study(scene, num_objects, np.random.default_rng(seed))
    tasks = [partial(study.compare, label) for label in scene.shape_labels]
    return study.result({part.label: part for part in run_tasks(tasks, jobs, "comparing shapes")})


@dataclass(frozen=True)
class _Compared:
    """What one shape is compared with: distances by touched shape and number of touches.

    Attributes:
        label: of the shape.
        reach: of its touches.
        informed: distances, where the search also starts at the true orientation.
        nearest: distances from the nearest images in the bank.
        found: presses of this shape that look most like all touches, by touched shape.
        frames: rotations from the frame of this shape to that of the touched one.
    """

    label: str
    reach: tuple[float, float]
    informed: dict[tuple[str, int], Floats] = field(default_factory=dict)
    nearest: dict[tuple[str, int], Floats] = field(default_factory=dict)
    found: dict[str, Floats] = field(default_factory=dict)
    frames: dict[str, Floats] = field(default_factory=dict)


class _Study:
    """The objects and their touches, and the orientations that they are compared with."""

    def __init__(self, scene: Scene, num_objects: int, rng: np.random.Generator) -> None:
        self.fit, self.solids, self.num_objects = ContactFit.of(scene), scene.solids, num_objects
        self.size = float(np.mean(self.fit.sizes))
        every = np.array(list(scene.rotations.values()))
        self.poses = every[np.sort(rng.permutation(len(every))[:_TOUCHES])]
        base = quaternions(_ORIENTATIONS)
        self.bank = np.concatenate([turned(turn("x", -roll * np.pi / 2), base) for roll in range(_ROLLS)])
        tree = scipy.spatial.cKDTree(np.vstack([self.bank, -self.bank]))
        self.shown = [tree.query(turned(pose, self.bank))[1] % len(self.bank) for pose in self.poses]
        vary = scene.variation
        self.truth: dict[str, Floats] = {}
        self.heights: dict[str, Floats] = {}
        self.images: dict[str, Floats] = {}
        for label, solid in self.solids.items():
            rows = np.zeros((num_objects, 5 + 3 * len(self.poses)))
            for row in rows:
                row[:4], row[4] = random_orientation(rng), vary.size.sample(rng)
                row[5::3], row[6::3] = ([vary.offset.sample(rng) for _ in self.poses] for _ in "yz")
            self.truth[label] = rows
            self.heights[label] = self.fit.heights(solid, self.truth[label], self.poses)
            self.images[label] = self._by_object(self.heights[label])

    def _by_object(self, heights: Floats) -> Floats:
        images = self.fit.images(heights)
        return images.reshape(self.num_objects, -1, *images.shape[1:])

    def compare(self, label: str) -> _Compared:
        """Compare the touches of all objects with one shape."""
        bank, heights = self._bank(self.solids[label])
        part = _Compared(label, self._reach(label, heights))
        coarse = {other: _distances(images, bank) for other, images in self.images.items()}
        for num_touches in sorted({1, len(self.poses)}, reverse=True):
            totals = {
                other: np.sum([found[:, pose][:, self.shown[pose]] for pose in range(num_touches)], axis=0)
                for other, found in coarse.items()
            }
            own = coarse[label].min(axis=2) if num_touches == 1 else totals[label].min(axis=1)
            hopeless = _HOPELESS * float(np.sqrt(np.quantile(own, 0.95)))
            for other, total in totals.items():
                self._search(part, other, num_touches, total, hopeless)
        return part

    def _bank(self, solid: Shape) -> tuple[Floats, Floats]:
        """Images of a shape in all orientations at four offsets, ``(4·n, 4, e·e)``, and height maps ``(n, N, N)``."""
        window = self.fit.window
        pixel, num = window.edge / window.num_pixels, window.num_pixels
        shift = round(max(map(abs, self.fit.offsets)) / 2 / pixel)
        wide = Window((num + 2 * shift) * pixel, num + 2 * shift)
        heights = predicted_contacts(solid, self.bank[:_ORIENTATIONS], (0.0, 0.0), wide, self.size).astype(float)
        places = [(row, column) for row in (0, 2 * shift) for column in (0, 2 * shift)]
        images = np.stack([self.fit.images(heights[:, r : r + num, c : c + num]) for r, c in places], axis=1)
        rolled = np.concatenate([np.rot90(images, roll, axes=(2, 3)) for roll in range(_ROLLS)])
        return rolled.reshape(*rolled.shape[:2], -1), heights[:, shift : shift + num, shift : shift + num]

    def _search(self, part: _Compared, touched: str, num_touches: int, total: Floats, hopeless: float) -> None:
        """Distances of the objects of one shape from the presses of the other that look most like them."""
        truth, least = self.truth[touched][:, : 5 + 3 * num_touches], total.min(axis=1)
        part.nearest[touched, num_touches] = np.sqrt(least)
        if touched == part.label:
            part.informed[touched, num_touches] = np.zeros(len(truth))
            return
        better, is_all = partial(self._better, part.label, touched), num_touches == len(self.poses)
        starts = [truth]
        for start in np.argsort(total, axis=1)[:, :_STARTS].T:
            starts.append(np.column_stack([self.bank[start], np.full(len(truth), self.size), 0.0 * truth[:, 5:]]))
        first = np.where(least <= hopeless**2, least, np.inf)
        if is_all:  # if the objects that look most alike do not, no others do
            found, few = truth, np.where(np.argsort(np.argsort(least)) < _FIRST, first, np.inf)
            for start in starts[:2]:
                found, few = better(found, few, start)
            nearest = np.where(np.argsort(np.argsort(few)) < _FIRST // 3, few, np.inf)
            if better(found, nearest, found, 2 * _STEPS)[1].min() > _NEAR:
                first = np.full(len(truth), np.inf)
        found, cost = truth, first
        for start in starts:
            found, cost = better(found, cost, start)
        for _ in range(_ALIGNMENTS if is_all else 1):
            if (
                is_all and np.isfinite(cost).any()
            ):  # the frames of the shapes lie to each other as where these look most alike
                nearest = np.where(np.argsort(np.argsort(cost)) < _ALIGNED, cost, np.inf)
                found, refined = better(found, nearest, found, 4 * _STEPS)
                best, cost = int(np.argmin(refined)), np.minimum(cost, refined)
                part.frames[touched] = np.array(hamilton_product(truth[best, :4] * (1, -1, -1, -1), found[best, :4]))
            if touched in part.frames:
                turns = np.array(hamilton_product(truth[:, :4].T, part.frames[touched][:, None])).T
                found, cost = better(found, cost, np.column_stack([turns, truth[:, 4:]]))
        found, polished = better(found, np.where(cost < _NEAR, cost, np.inf), found, 2 * _STEPS)
        cost = np.minimum(cost, polished)
        if is_all:
            part.found[touched] = found
        part.informed[touched, num_touches] = np.sqrt(np.minimum(cost, least))

    def _better(
        self, label: str, touched: str, presses: Floats, cost: Floats, start: Floats, steps: int = _STEPS
    ) -> tuple[Floats, Floats]:
        """Fits from another start where they are better; none where the cost is infinite, or next to nothing."""
        rows = np.flatnonzero(np.isfinite(cost) & (cost > _SAME))
        if rows.size == 0:
            return presses, cost
        num = (presses.shape[1] - 5) // 3
        images, solid = self.images[touched][rows, :num], self.solids[label]
        fitted, fitted_cost = self.fit.fit(solid, images, start[rows], self.poses[:num], steps)
        is_better = fitted_cost < cost[rows]
        presses, cost = presses.copy(), cost.copy()
        presses[rows[is_better]], cost[rows[is_better]] = fitted[is_better], fitted_cost[is_better]
        return presses, cost

    def result(self, parts: dict[str, _Compared]) -> Alike:
        """The pairs, most alike first."""
        solids = self.solids
        pairs = [
            _of_one_body(one, other) if solids[one] == solids[other] else self._likeness(parts[one], parts[other])
            for one, other in combinations(solids, 2)
        ]
        pairs.sort(key=lambda pair: (-pair.all, -pair.one))
        for place, pair in enumerate(pairs[:_MOST_COMPARED]):
            if pair.all > SHOWN and pair.shown_from_26 is None:
                shown = [self._shown_from_26(parts[a], b) for a, b in (pair.shapes, pair.shapes[::-1])]
                pairs[place] = replace(pair, shown_from_26=max(shown))
        return Alike(tuple(pairs), {label: parts[label].reach for label in self.solids}, len(self.poses))

    def _likeness(self, one: _Compared, other: _Compared) -> Likeness:
        ways = ((one.label, other), (other.label, one))  # the touched shape, and what was compared with it

        def errors(num_touches: int) -> tuple[float, tuple[float, float], float]:
            informed = [_confused(part.informed[label, num_touches]) for label, part in ways]
            least = min(informed, key=np.mean)  # a reader that takes doubtful touches for the other shape
            own = [part.nearest[part.label, num_touches] for part in (one, other)]
            wrong = [part.nearest[label, num_touches] < o for (label, part), o in zip(ways, own, strict=True)]
            error = float(least.mean())
            return error, _interval(least), min(max(float(np.mean(wrong)), error), 0.5)

        num = len(self.poses)
        shown = max(float((_confused(part.informed[label, num]) < SHOWN).mean()) for label, part in ways)
        return Likeness((one.label, other.label), *errors(1), *errors(num), shown)

    def _shown_from_26(self, part: _Compared, touched: str) -> float:
        """See :class:`Likeness`: fits of the touches in all 26 poses, from those of the touches in the scene's."""
        poses = np.array(list(POSE_SETS["directions26"].values()))
        truth, start = (
            np.hstack([presses[:, :5], np.zeros((self.num_objects, 3 * len(poses)))])
            for presses in (self.truth[touched], part.found[touched])
        )
        images = self._by_object(self.fit.heights(self.solids[touched], truth, poses))
        cost = self.fit.fit(self.solids[part.label], images, start, poses, 2 * _STEPS)[1]
        return float((_confused(np.sqrt(cost)) < SHOWN).mean())

    def _reach(self, label: str, heights: Floats) -> tuple[float, float]:
        """See :class:`Alike`; surfaces are counted in cubes whose edge is a quarter of the shape's radius."""
        solid, truth, depth = self.solids[label], self.truth[label], self.fit.pad.max_depth
        turns = self.bank[:_ORIENTATIONS]
        views = turns[:: _ORIENTATIONS // _VIEWS]
        whole = Window(2 * solid.bounding_radius * self.size, _SEEN_PIXELS)

        def cubes(maps: Floats, window: Window, shown: Floats, rows: Floats, deepest: float) -> list[NDArray[np.int64]]:
            """Numbers of the cubes with a point at most so far behind the first; rows of size and offset."""
            found = []
            for map_, matrix, (size, y, z) in zip(maps, to_matrices(shown), rows, strict=True):
                row, column = np.nonzero(map_ > map_.max() - deepest)
                points = np.array([-map_[row, column], window.centres[column] - y, window.centres[row] - z])
                places = np.floor(matrix.T @ points / (size * solid.bounding_radius / 4)).astype(np.int64)
                found.append(np.unique((places + 64).T @ (1, 128, 128**2)))
            return found

        def share(parts: list[NDArray[np.int64]]) -> float:
            return len(np.intersect1d(np.concatenate(parts), seen)) / len(seen)

        middle = np.tile([self.size, 0.0, 0.0], (len(turns), 1))
        far = predicted_contacts(solid, views, (0.0, 0.0), whole, self.size).astype(float)
        seen = np.unique(np.concatenate(cubes(far, whole, views, middle[: len(views)], np.inf)))
        ever = share(cubes(heights, self.fit.window, turns, middle, depth))
        shown = np.stack([turned(pose, truth[:, :4]) for pose in self.poses], axis=1).reshape(-1, 4)
        num = len(self.poses)
        rows = np.column_stack([np.repeat(truth[:, 4], num), truth[:, 5:].reshape(-1, 3)[:, :2]])
        touched = cubes(self.heights[label], self.fit.window, shown, rows, depth)
        return ever, float(np.mean([share(touched[n : n + num]) for n in range(0, len(touched), num)]))


def _of_one_body(one: str, other: str) -> Likeness:
    """Of two labels for the same body: no touch tells them apart."""
    chance, interval = 0.5, (0.5, 0.5)
    return Likeness((one, other), chance, interval, chance, chance, interval, chance, 0.0, 0.0)


def _distances(images: Floats, bank: Floats) -> Floats:
    """Squared distances of images ``(m, P, e, e)`` from the nearest offset in the bank, ``(m, P, 4·n)``."""
    flat, known = (a.reshape(-1, bank.shape[-1]).astype(np.float32) for a in (images, bank))
    products = (flat @ known.T).reshape(len(flat), *bank.shape[:2])
    nearest = (np.square(known).sum(axis=1).reshape(bank.shape[:2]) - 2.0 * products).min(axis=2)
    return np.maximum(nearest + np.square(flat).sum(axis=1)[:, None], 0.0).reshape(*images.shape[:2], -1)


def _confused(distances: Floats) -> Floats:
    """Probability of confusing two images at a distance in units of the noise."""
    return np.asarray(scipy.special.ndtr(-distances / 2))


def _interval(errors: Floats) -> tuple[float, float]:
    """Interval of the mean of errors in [0, 0.5]: that of a proportion, as they have no larger variance."""
    low, high = wilson_interval(round(2.0 * float(errors.sum())), len(errors))
    return low / 2.0, high / 2.0
