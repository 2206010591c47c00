"""Which objects feel alike to a pad: the error of telling two shapes apart, by simulated contacts.

    touches of random objects of one shape  →  the presses of the other shape that look most like them  →  error

Nothing is trained. Two images at a distance d, in units of the noise, are confused with probability Φ(-d / 2). The
distance to the other shape is the smallest over its orientation and size, which the touches of an object share, and
over the offset of each touch.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations
from typing import Any, TypeAlias

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
from experiments.parallel import run_tasks
from experiments.press.contact_fit import Feeler, Limits, Presses, fit

Floats = NDArray[np.float64]
Pair: TypeAlias = tuple[str, str]

SHOWN = 0.05
"""A difference shows if two shapes are confused with less than this probability."""
_ORIENTATIONS = 1000  # of the bank, each with four rolls
_TOUCHES = 6
_STARTS, _STEPS = 2, 5
_ALIGNMENTS, _ALIGNED = 2, 4  # rounds, and objects that tell how the frames of two shapes lie to each other
_SAME = 0.25  # squared distance of images that are one
_HOPELESS = (1.5, 1.2)  # for one touch and for all, times the distance at which the bank finds nearly all touches of the shape itself
_VIEWS, _SEEN_PIXELS = 50, 48  # height maps of a whole shape, and their pixels along an edge
_MOST_COMPARED = 3  # pairs whose touches from 26 directions are compared


@dataclass(frozen=True)
class Likeness:
    """How alike two shapes feel; errors are in [0, 0.5], with 95 % intervals of the simulated touches.

    Attributes:
        shapes: their labels.
        one: error after one touch, of a reader that is told where to look.
        one_interval: its interval.
        one_searching: the same of a reader that searches all orientations.
        all: error after all touches, of a reader that is told where to look.
        all_interval: its interval.
        all_searching: the same of a reader that searches all orientations.
        shown: share of the objects, of the shape of the two where it is larger, of which a touch shows a difference.
        shown_from_26: the same with the 26 poses of ``directions26``; None where it was not computed.
    """

    shapes: Pair
    one: float
    one_interval: tuple[float, float]
    one_searching: float
    all: float
    all_interval: tuple[float, float]
    all_searching: float
    shown: float
    shown_from_26: float | None = None


@dataclass(frozen=True)
class Reach:
    """Where touches of a shape land, as shares of its surface that is seen from outside.

    Attributes:
        ever: what some touch of some tumbled object reaches.
        in_all: mean over objects of what all touches of one object reach.
    """

    ever: float
    in_all: float


@dataclass(frozen=True)
class Alike:
    """Result of :func:`alike`: the pairs, most alike first, the reach by shape, and the number of touches of each."""

    pairs: tuple[Likeness, ...]
    reach: dict[str, Reach]
    num_touches: int


def alike(
    scene: Scene,
    *,
    num_objects: int = 20,
    seed: int = 0,
    jobs: int = 1,
) -> Alike:
    """How alike the shapes of a scene feel to its pad, and what the poses reach of them.

    Objects are tumbled, and pressed on the approach axis, beside it by the scene's offset, with the middle of its
    forces. At most six poses are used, drawn if there are more. Images are pressures on at most 12 × 12 taxels with the
    scene's noise, and with 0.5 % of full scale below which no difference counts; gain, broken taxels and what a
    renderer adds or hides are left out.

    The errors are estimates, not bounds: ``one`` and ``all`` are too small where the search misses the press of the
    other shape that looks most alike, ``…_searching`` are those of a reader that makes the same search for both shapes,
    which a better reader can undercut.

    Args:
        scene: shapes, poses, pad, sizes, offsets and noise.
        num_objects: simulated of each shape, at least 2.
        seed: of the objects.
        jobs: number of processes; the result does not depend on it.

    Returns:
        All pairs, most alike first.

    Raises:
        InvalidArgument: there are fewer than two shapes or two objects.
    """
    require_count("num_objects", num_objects)
    if min(len(scene.shapes), num_objects) < 2:
        raise InvalidArgument(f"needs two shapes and two objects of each, got {len(scene.shapes)} and {num_objects}")
    study = _Study(scene, num_objects, np.random.default_rng(seed))
    parts = run_tasks([partial(study.compare, label) for label in scene.shape_labels], jobs, "comparing shapes")
    return study.result(sorted(parts, key=lambda part: scene.shape_labels.index(part.label)))


@dataclass(frozen=True)
class _Compared:
    """What one shape is compared with: distances by touched shape and number of touches.

    Attributes:
        label: of the shape.
        reach: of its touches.
        told: distances, where the search also starts at the true orientation.
        searched: distances to the nearest image in the bank.
        found: presses of this shape that look most like all touches, by touched shape.
        relative: rotation from the frame of this shape to that of the touched one.
    """

    label: str
    reach: Reach
    told: dict[tuple[str, int], Floats] = field(default_factory=dict)
    searched: dict[tuple[str, int], Floats] = field(default_factory=dict)
    found: dict[str, Presses] = field(default_factory=dict)
    relative: dict[str, Floats] = field(default_factory=dict)


class _Study:
    """The objects and their touches, and the orientations that they are compared with."""

    def __init__(self, scene: Scene, num_objects: int, rng: np.random.Generator) -> None:
        vary = scene.variation
        self.feeler, self.solids = Feeler.of(scene), scene.solids
        self.limits = Limits(vary.size.support, vary.offset.support)
        every = np.array(list(scene.rotations.values()))
        self.poses = every[np.sort(rng.permutation(len(every))[:_TOUCHES])]
        base = quaternions(_ORIENTATIONS)
        self.bank = np.concatenate([turned(turn("x", -roll * np.pi / 2), base) for roll in range(4)])
        tree = scipy.spatial.cKDTree(np.vstack([self.bank, -self.bank]))
        self.nearest = [tree.query(turned(pose, self.bank))[1] % len(self.bank) for pose in self.poses]
        self.truth: dict[str, Presses] = {}
        self.heights: dict[str, Floats] = {}
        for number, (label, solid) in enumerate(self.solids.items()):
            sizes = np.array([scene.sample_object(number, rng).scale for _ in range(num_objects)])
            turns = np.array([random_orientation(rng) for _ in sizes])
            offsets = np.array([[vary.sample_offset(rng) for _ in self.poses] for _ in sizes])
            self.truth[label] = Presses(turns, sizes, offsets)
            self.heights[label] = self.truth[label].heights(solid, self.poses, self.feeler.window)

    def images(self, heights: Floats, num_objects: int) -> Floats:
        """Images ``(m, P, e, e)`` of height maps ``(m·P, N, N)``."""
        images = self.feeler.images(heights)
        return images.reshape(num_objects, -1, *images.shape[1:])

    def compare(self, label: str) -> _Compared:
        """Compare the touches of all objects with one shape."""
        bank, heights = self._bank(self.solids[label])
        part = _Compared(label, self._reach(label, heights))
        coarse = {
            other: _distances(self.images(self.heights[other], len(self.truth[other].sizes)), bank)
            for other in self.solids
        }
        for num_touches in (len(self.poses), 1):
            ranked = {other: self._ranked(coarse[other][:, :num_touches]) for other in self.solids}
            hopeless = _HOPELESS[num_touches > 1] ** 2 * float(np.quantile(ranked[label][1][:, 0], 0.95))
            for other in self.solids:
                self._search(part, other, num_touches, *ranked[other], hopeless)
        return part

    def _bank(self, solid: Shape) -> tuple[Floats, Floats]:
        """Images of all orientations of a shape at four offsets, ``(4·n, 4, e·e)``, and height maps ``(n, N, N)``."""
        pixel, num = self.feeler.window.edge / self.feeler.num_pixels, self.feeler.num_pixels
        shift = round(max(map(abs, self.limits.offsets)) / 2 / pixel)
        window = Window((num + 2 * shift) * pixel, num + 2 * shift)
        size = float(np.mean(self.limits.sizes))
        heights = predicted_contacts(solid, self.bank[:_ORIENTATIONS], (0.0, 0.0), window, size, np.float32)
        places = [(row, column) for row in (0, 2 * shift) for column in (0, 2 * shift)]
        images = np.stack([self.feeler.images(heights[:, r : r + num, c : c + num]) for r, c in places], axis=1)
        rolled = np.concatenate([np.rot90(images, roll, axes=(2, 3)) for roll in range(4)])
        return rolled.reshape(*rolled.shape[:2], -1), heights[:, shift : shift + num, shift : shift + num]

    def _ranked(self, coarse: Floats) -> tuple[NDArray[np.intp], Floats]:
        """The nearest orientations of each object in the bank and their squared distances, ``(m, starts)``."""
        total = np.sum([coarse[:, place][:, self.nearest[place]] for place in range(coarse.shape[1])], axis=0)
        best = np.argsort(total, axis=1)[:, :_STARTS]
        return best, np.take_along_axis(total, best, axis=1)

    def _search(
        self,
        part: _Compared,
        touched: str,
        num_touches: int,
        starts: NDArray[np.intp],
        coarse: Floats,
        hopeless: float,
    ) -> None:
        """Distances of the objects of one shape from the presses of the other that look most like them."""
        truth, middle = self.truth[touched].of(num_touches), np.full(len(coarse), np.mean(self.limits.sizes))
        part.searched[touched, num_touches] = np.sqrt(coarse[:, 0])
        if touched == part.label:
            part.told[touched, num_touches] = np.zeros(len(coarse))
            return
        better = partial(self._better, part.label, touched)
        found, cost = better(truth, np.where(coarse[:, 0] <= hopeless, coarse[:, 0], np.inf), truth)
        for column in range(_STARTS):
            start = Presses(self.bank[starts[:, column]], middle, np.zeros_like(truth.offsets))
            found, cost = better(found, cost, start)
        for _ in range(_ALIGNMENTS if num_touches > 1 and np.isfinite(cost).any() else 1):
            if num_touches > 1:  # the frames of the shapes, where these look most alike
                nearest = np.where(np.argsort(np.argsort(cost)) < _ALIGNED, cost, np.inf)
                found, refined = better(found, nearest, found, 4 * _STEPS)
                row = int(np.argmin(refined))
                relative = hamilton_product(truth.turns[row] * (1, -1, -1, -1), found.turns[row])
                cost, part.relative[touched] = np.minimum(cost, refined), np.array(relative)
            if touched in part.relative:
                aligned = np.array(hamilton_product(truth.turns.T, part.relative[touched][:, None])).T
                found, cost = better(found, cost, Presses(aligned, truth.sizes, truth.offsets))
        if num_touches > 1:
            part.found[touched] = found
        part.told[touched, num_touches] = np.sqrt(np.minimum(cost, coarse[:, 0]))

    def _better(
        self, label: str, touched: str, presses: Presses, cost: Floats, start: Presses, steps: int = _STEPS
    ) -> tuple[Presses, Floats]:
        """Fits from another start where they are better; none where the cost is infinite, or next to nothing."""
        rows = np.flatnonzero(np.isfinite(cost) & (cost > _SAME))
        if rows.size == 0:
            return presses, cost
        num = start.offsets.shape[1]
        images = self.images(self.heights[touched], len(cost))[rows, :num]
        solid, poses = self.solids[label], self.poses[:num]
        fitted, fitted_cost = fit(self.feeler, solid, images, start[rows], poses, self.limits, steps)
        every, costs = presses.put(rows, fitted), cost.copy()
        costs[rows] = fitted_cost
        return presses.or_else(every, costs < cost), np.minimum(costs, cost)

    def result(self, parts: Iterable[_Compared]) -> Alike:
        """The pairs, most alike first."""
        by_label = {part.label: part for part in parts}
        pairs = [self._likeness(by_label[one], by_label[other]) for one, other in combinations(by_label, 2)]
        pairs.sort(key=lambda pair: (-pair.all, -pair.one))
        for place, pair in enumerate(pairs[:_MOST_COMPARED]):
            if pair.all > SHOWN:
                one, other = (by_label[label] for label in pair.shapes)
                shown = max(self._shown_from_26(one, other.label), self._shown_from_26(other, one.label))
                pairs[place] = replace(pair, shown_from_26=shown)
        return Alike(tuple(pairs), {label: part.reach for label, part in by_label.items()}, len(self.poses))

    def _likeness(self, one: _Compared, other: _Compared) -> Likeness:
        ways = ((one.label, other), (other.label, one))  # the touched shape, and what was compared with it
        found: list[Any] = []
        for num_touches in (1, len(self.poses)):
            told = [_confused(part.told[label, num_touches]) for label, part in ways]
            least = min(told, key=np.mean)  # a reader that takes doubtful touches for the other shape
            own = [part.searched[part.label, num_touches] for part in (one, other)]
            further = [part.searched[label, num_touches] - o for (label, part), o in zip(ways, own, strict=True)]
            wrong = float(np.mean([(more < 0.0).mean() for more in further]))
            found += [float(least.mean()), _interval(least), min(max(wrong, float(least.mean())), 0.5)]
        shown = max(float((errors < SHOWN).mean()) for errors in told)
        return Likeness((one.label, other.label), *found, shown)

    def _shown_from_26(self, part: _Compared, touched: str) -> float:
        """See :class:`Likeness`: fits of the touches in all 26 poses, from those of the touches in the scene's."""
        poses, truth, model = np.array(list(POSE_SETS["directions26"].values())), self.truth[touched], part.found[touched]
        centred = np.zeros((len(truth.sizes), len(poses), 2))
        heights = Presses(truth.turns, truth.sizes, centred).heights(self.solids[touched], poses, self.feeler.window)
        images, start = self.images(heights, len(centred)), Presses(model.turns, model.sizes, centred)
        cost = fit(self.feeler, self.solids[part.label], images, start, poses, self.limits, _STEPS)[1]
        return float((_confused(np.sqrt(cost)) < SHOWN).mean())

    def _reach(self, label: str, heights: Floats) -> Reach:
        """What touches of a shape reach, from height maps ``(n, N, N)`` in the orientations of the bank."""
        solid, size, truth = self.solids[label], float(np.mean(self.limits.sizes)), self.truth[label]
        num, some = len(heights), slice(0, None, _ORIENTATIONS // _VIEWS)
        whole = Window(2 * solid.bounding_radius * size, _SEEN_PIXELS)
        views = predicted_contacts(solid, self.bank[:num][some], (0.0, 0.0), whole, size)
        edge = solid.bounding_radius / 4

        def cubes(
            maps: Floats, turns: Floats, window: Window, sizes: Floats, offsets: Floats, deepest: float
        ) -> list[NDArray[np.int64]]:
            """Numbers of the cubes in which the points of each map lie that are at most so far from the first."""
            found = []
            for map_, matrix, scale, (y, z) in zip(maps, to_matrices(turns), sizes, offsets, strict=True):
                row, column = np.nonzero(map_ > map_.max() - deepest)
                points = np.array([-map_[row, column], window.centres[column] - y, window.centres[row] - z])
                places = np.floor(matrix.T @ points / (scale * edge)).astype(np.int64)
                found.append(np.unique((places + 64).T @ (1, 128, 128 * 128)))
            return found

        depth = self.feeler.pad.max_depth
        middle, centred = np.full(num, size), np.zeros((num, 2))
        seen = _joined(cubes(views, self.bank[:num][some], whole, middle[some], centred[some], np.inf))
        ever = _joined(cubes(heights, self.bank[:num], self.feeler.window, middle, centred, depth))
        shown = np.stack([turned(pose, truth.turns) for pose in self.poses], axis=1).reshape(-1, 4)
        sizes = np.repeat(truth.sizes, len(self.poses))
        touched = cubes(self.heights[label], shown, self.feeler.window, sizes, truth.offsets.reshape(-1, 2), depth)
        each = [_joined(touched[first : first + len(self.poses)]) for first in range(0, len(touched), len(self.poses))]
        return Reach(_share(ever, seen), float(np.mean([_share(own, seen) for own in each])))


def _joined(parts: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    return np.unique(np.concatenate(parts))


def _share(part: NDArray[np.int64], whole: NDArray[np.int64]) -> float:
    return len(np.intersect1d(part, whole)) / len(whole)


def _distances(images: Floats, bank: Floats) -> Floats:
    """Squared distances of images ``(m, P, e, e)`` to the nearest offset in the bank, ``(m, P, 4·n)``."""
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
