"""Which objects feel alike to a pad: the error of telling two shapes apart, by simulated contacts.

    touches of random objects of one shape  →  the presses of the other shape that look most like them  →  error

Nothing is trained. Two images at a distance d, in units of the noise, are confused with probability Φ(-d / 2). The
distance to the other shape is the smallest over its orientation and size, which the touches of an object share, and
over the offset of each touch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.hypotheses import quaternions
from activetouch.poses import POSE_SETS, hamilton_product, turn, turned
from activetouch.pressing.height_maps import Window, predicted_contacts
from activetouch.scene import Scene
from activetouch.shapes import Shape
from belief.errors import InvalidArgument
from belief.validation import require_count
from experiments.press.contact_fit import Feeler, Limits, Presses, fit

Floats = NDArray[np.float64]
Pair: TypeAlias = tuple[str, str]

SHOWN = 0.05
"""A difference shows if two shapes are confused with less than this probability."""
_ORIENTATIONS = 1500  # of the bank, each with four rolls
_TOUCHES = 6
_STARTS, _STEPS = 3, 5
_HOPELESS = 2.0  # times the distance at which the bank finds nearly all touches of the shape itself
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
    track: Callable[[Iterable[str]], Iterable[str]] = iter,
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
        track: shows the progress over the labels of the shapes.

    Returns:
        All pairs, most alike first.

    Raises:
        InvalidArgument: there are fewer than two shapes or two objects.
    """
    if len(scene.shapes) < 2 or require_count("num_objects", num_objects) < 2:
        raise InvalidArgument(f"needs two shapes and two objects of each, got {len(scene.shapes)} and {num_objects}")
    study = _Study(scene, num_objects, np.random.default_rng(seed))
    for label in track(scene.shape_labels):
        study.compare(label)
    return study.result()


class _Study:
    """Distances of the touches of all objects to all shapes."""

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
        self.truth, self.images, self.heights = {}, {}, {}
        for number, (label, solid) in enumerate(self.solids.items()):
            things = [scene.sample_object(number, rng) for _ in range(num_objects)]
            turns = quaternions_of(rng, num_objects)
            offsets = [[vary.sample_offset(rng) for _ in self.poses] for _ in things]
            self.truth[label] = Presses(turns, np.array([thing.scale for thing in things]), np.array(offsets))
            self.heights[label] = self.truth[label].heights(solid, self.poses, self.feeler.window)
            self.images[label] = self._images(self.heights[label], num_objects)
        self.told: dict[tuple[Pair, int], Floats] = {}  # distances by (touched, compared) and number of touches
        self.searched: dict[tuple[Pair, int], Floats] = {}
        self.found: dict[Pair, Presses] = {}
        self.reach: dict[str, Reach] = {}

    def _images(self, heights: Floats, num_objects: int) -> Floats:
        images = self.feeler.images(heights)[0]
        return images.reshape(num_objects, -1, *images.shape[1:])

    def compare(self, label: str) -> None:
        """Compare the touches of all objects with one shape."""
        solid = self.solids[label]
        bank, heights = self._bank(solid)
        self.reach[label] = _reach(solid, heights, self.bank[: len(heights)], self)
        coarse = {other: self._distances(self.images[other], bank) for other in self.solids}
        for num_touches in (len(self.poses), 1):
            ranked = {other: self._ranked(coarse[other], num_touches) for other in self.solids}
            hopeless = _HOPELESS * float(np.quantile(ranked[label][1][:, 0], 0.95))
            for other in self.solids:
                self._search((other, label), num_touches, *ranked[other], hopeless)

    def _bank(self, solid: Shape) -> tuple[Floats, Floats]:
        """Images of all orientations of a shape at four offsets, ``(4·n, 4, e·e)``, and height maps ``(n, N, N)``."""
        feeler = self.feeler
        pixel = 2 * feeler.pad.half_width / feeler.num_pixels
        shift = round(max(map(abs, self.limits.offsets)) / 2 / pixel)
        num, size = feeler.num_pixels, float(np.mean(self.limits.sizes))
        window = Window((num + 2 * shift) * pixel, num + 2 * shift)
        heights = predicted_contacts(solid, self.bank[:_ORIENTATIONS], (0.0, 0.0), window, size, np.float32)
        places = [(row, column) for row in (0, 2 * shift) for column in (0, 2 * shift)]
        images = np.stack([feeler.images(heights[:, r : r + num, c : c + num])[0] for r, c in places], axis=1)
        rolled = np.concatenate([np.rot90(images, roll, axes=(2, 3)) for roll in range(4)]).astype(np.float32)
        return rolled.reshape(*rolled.shape[:2], -1), heights[:, shift : shift + num, shift : shift + num]

    def _distances(self, images: Floats, bank: Floats) -> Floats:
        """Squared distances of images ``(m, P, e, e)`` to the nearest offset in the bank, ``(m, P, 4·n)``."""
        flat = images.reshape(-1, bank.shape[-1]).astype(np.float32)
        products = (flat @ bank.reshape(-1, bank.shape[-1]).T).reshape(len(flat), *bank.shape[:2])
        nearest = (np.square(bank).sum(axis=2) - 2.0 * products).min(axis=2)
        return (nearest + np.square(flat).sum(axis=1)[:, None]).reshape(*images.shape[:2], -1)

    def _ranked(self, coarse: Floats, num_touches: int) -> tuple[NDArray[np.intp], Floats]:
        """The nearest orientations of each object in the bank and their squared distances, ``(m, starts)``."""
        total = sum(coarse[:, place][:, self.nearest[place]] for place in range(num_touches))
        best = np.argpartition(total, _STARTS, axis=1)[:, :_STARTS]
        best = np.take_along_axis(best, np.argsort(np.take_along_axis(total, best, 1), axis=1), 1)
        return best, np.take_along_axis(total, best, 1)

    def _search(
        self, pair: Pair, num_touches: int, starts: NDArray[np.intp], coarse: Floats, hopeless: float
    ) -> None:
        """Distances of the objects of the first shape to the nearest presses of the second."""
        touched, compared = pair
        truth = self.truth[touched]
        truth = Presses(truth.turns, truth.sizes, truth.offsets[:, :num_touches])
        middle = Presses(
            truth.turns, np.full(len(truth.sizes), np.mean(self.limits.sizes)), 0.0 * truth.offsets
        )
        told, searched, found = coarse[:, 0].copy(), coarse[:, 0].copy(), truth
        near = np.flatnonzero(coarse[:, 0] <= hopeless)
        if near.size:
            images = self.images[touched][:, :num_touches][near]

            def better(presses: Presses, cost: Floats, start: Presses) -> tuple[Presses, Floats]:
                new, new_cost = fit(
                    self.feeler, self.solids[compared], images, start, self.poses[:num_touches], self.limits, _STEPS
                )
                return presses.or_else(new, new_cost < cost), np.minimum(cost, new_cost)

            presses, cost = middle[near], coarse[near, 0]
            for column in range(_STARTS):
                start = Presses(self.bank[starts[near, column]], middle.sizes[near], middle.offsets[near])
                presses, cost = better(presses, cost, start)
            searched[near] = cost
            if touched == compared:
                cost = 0.0 * cost
            else:
                presses, cost = better(presses, cost, truth[near])
                if num_touches > 1:  # how the frames of the two shapes lie to each other, where they look most alike
                    best = int(np.argmin(cost))
                    relative = _product(_inverse(truth.turns[near][best]), presses.turns[best])
                    self.found[pair] = relative
                if pair in self.found:
                    aligned = _product(truth.turns[near], self.found[pair])
                    presses, cost = better(presses, cost, Presses(aligned, truth.sizes[near], truth.offsets[near]))
            told[near] = cost
            found = found.or_else(found, np.zeros(len(told), bool))
        self.told[pair, num_touches], self.searched[pair, num_touches] = np.sqrt(told), np.sqrt(searched)
