"""Is an object in a tray of the shape that it is taken for, or only like it?

The places and turns of a belief stand for cells of 5 mm and 15°, within which presses differ so much that a body that
is only like the shape may feel like it. So the body is pressed in simulation as it is believed to lie, and then a
little otherwise, until heights and images fit all touches of the object as well as they can. What then remains is small
for an object of the shape and large for others; the densities of both are from simulated objects.

No simulation of physics: the images are those of :mod:`activetouch.perception.pressed_beliefs`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.perception.imaging import Floats32, Imaging, SensorState, sensor_state
from activetouch.perception.pressed_beliefs import clipped_noise, compared, images_of
from activetouch.perception.strangers import TwoDensities
from activetouch.scene import Scene
from activetouch.solids.solid import Floats, Shape
from activetouch.tray.resting import NUM_TURNS, about_vertical, heights_above_floor
from activetouch.tray.world import rests_of
from belief.tray import Found, PlaceTouch, TrayBelief

_DRAWS = (96, 1.0, 1.0), (192, 1.0, 1.0), (384, 0.25, 2.0)
"""Ways to lie that are drawn from the belief: how many, the power of its probabilities, and the width in cells.

The next draw is made only where none of the last one fits.
"""
_KEPT = 8  # ways of a draw that are changed until they fit best
_STEPS = 8  # of changes
_ASIDE = np.array([0.02, 0.0003, 0.0003, 0.01])  # by which turn [rad], place [m] and size are changed at first
_DAMPED = 1e-2, 10.0  # damping at first, and by which factor it rises and falls
_FARTHEST = 10.0  # change in one step, in these
_MOST = 8  # touches of an object that count, spread over all of them
_FITTING = 0.4  # misfit of a way to lie that fits
_HEIGHT = 0.0006  # standard deviation of a height [m]
_LARGEST = 10.0  # squared residual of a touch
_COUNTED = 0.75  # share of the touches, as some may be of a neighbour
_IMAGE = 0.02  # standard deviation of a pixel beside its noise, relative to full scale
_MISFITS = TwoDensities(
    np.array([[-0.13, -0.3, -0.37, -0.32], [-1.4, -1.1, -1.4, -1.45]]),
    np.array([[0.15, 0.28, 0.22, 0.18], [0.85, 0.45, 0.5, 0.45]]),
)
"""Of the negative misfit after one to four touches: of objects of the shape, and of others that are taken for it.

They are from 150 searches in trays of ``gel``, of 40 meshes and 20 strangers; the target was there in 0.4 of them.
"""
_LOST = 0.1, 0.05, 0.02, 0.002
"""Probability that the best way to lie is not found, after one to four touches."""


class _Felt(NamedTuple):
    """A touch that is compared: its place and height [m], its image ``(e, e)``, and the force that this tells [N]."""

    place: tuple[float, float]
    height: float
    image: Floats32
    force: float


class _Lying(NamedTuple):
    """N ways in which a body may lie: the face, and turn [rad], place along x and y [m] and size factor ``(N, 4)``."""

    face: NDArray[np.int64]
    pose: Floats


@dataclass(frozen=True, eq=False)
class TrayLookalikes:
    """See :class:`belief.tray.Lookalikes`.

    Attributes:
        scene: has the shapes and the sensor.
        imaging: of the sensor.
        sizes: smallest and largest factor of an object's size.
    """

    scene: Scene
    imaging: Imaging
    sizes: tuple[float, float]

    def log_factor(self, belief: TrayBelief, one: Found, shape: int) -> float:
        """See :class:`belief.tray.Lookalikes`; minus infinity where touches have no images to compare."""
        if any(touch.image is None for touch in one.met):
            return -math.inf
        ratio = _MISFITS.log_ratio(one.touches, -self.misfit(belief, one, shape))
        lost = _LOST[min(one.touches, len(_LOST)) - 1]
        return -float(np.logaddexp(math.log1p(-lost) - ratio, math.log(lost)))

    def misfit(self, belief: TrayBelief, one: Found, shape: int) -> float:
        """Mean of log(1 + squared residual) over most touches of an object, as a body of a shape fits them best.

        The generator follows from the touches: the same touches give the same number.
        """
        rng = np.random.default_rng([0x100C, shape, *np.ravel(one.cells).tolist()])
        met = [one.met[number] for number in np.unique(np.linspace(0, one.touches - 1, _MOST).astype(int)).tolist()]
        felt = [self._felt(touch, belief.centre(touch.cell)) for touch in met]
        solid, least = list(self.scene.solids.values())[shape], np.full(len(felt), np.inf)
        for draw in _DRAWS:
            lying = self._believed(belief, one, shape, draw, rng)
            best = np.argsort(_misfit(_squared(self._residuals(solid, lying, felt))), kind="stable")[:_KEPT]
            found = self._least(solid, _Lying(lying.face[best], lying.pose[best]), felt)
            least = min(least, found, key=_misfit)
            if _misfit(least) <= _FITTING:
                break
        return float(_misfit(least))

    def _believed(
        self, belief: TrayBelief, one: Found, shape: int, draw: tuple[int, float, float], rng: np.random.Generator
    ) -> _Lying:
        """Ways to lie of an object of a shape, drawn from the belief as one of ``_DRAWS`` says."""
        number, power, width = draw
        rows, resting = belief.table.shape_of == shape, rests_of(list(self.scene.solids.values())[shape])
        faces = np.repeat(np.arange(len(resting.turns)), resting.turns)
        turns = np.concatenate([np.arange(number) for number in resting.turns])
        assert rows.sum() == len(faces), "one row for each face and turn"
        probs = one.probs(np.where(np.arange(one.num_shapes) == shape, 0.0, -np.inf))
        probs = probs**power / (probs**power).sum()
        chosen = rng.choice(len(probs), number, p=probs)
        row = one.row[chosen] - int(rows.argmax())
        centres = np.array([belief.centre((x, y)) for x, y in zip(one.x[chosen], one.y[chosen], strict=True)])
        cells = np.array([2.0 * np.pi / NUM_TURNS, belief.table.pitch, belief.table.pitch, np.ptp(self.sizes)])
        periods = resting.turns[faces[row]]  # views that differ by one are alike, but not the same
        turn = turns[row] + periods * rng.integers(0, NUM_TURNS // periods)
        middle = np.column_stack([turn * cells[0], centres, np.full(number, np.mean(self.sizes))])
        return _Lying(faces[row], middle + cells * width * rng.uniform(-0.5, 0.5, middle.shape))

    def _least(self, solid: Shape, lying: _Lying, felt: Sequence[_Felt]) -> Floats:
        """Squared residual of each touch, as the body fits best near some ways to lie, by damped Gauss-Newton steps."""
        number, (damping, factor) = len(lying.face), _DAMPED
        trial, kept, damped = lying.pose, lying.pose.copy(), np.full(number, damping)
        least, slope, curved = np.full((number, len(felt)), np.inf), np.zeros((number, 4)), np.zeros((number, 4, 4))
        aside = np.concatenate([np.zeros((1, 4)), np.diag(_ASIDE)])[:, None]
        for _ in range(_STEPS):
            near = _Lying(np.tile(lying.face, len(aside)), (trial + aside).reshape(-1, 4))
            every = self._residuals(solid, near, felt).reshape(len(aside), number, len(felt), -1)
            squared = _squared(every[0])
            better = _misfit(squared) < _misfit(least)
            every /= np.sqrt(1.0 + squared)[..., None]  # by the slope of the logarithm
            every = every.reshape(len(aside), number, -1)[:, better]
            changes = every[1:] - every[0]
            least[better], kept[better] = squared[better], trial[better]
            slope[better] = np.einsum("anr,nr->na", changes, every[0])
            curved[better] = np.einsum("anr,bnr->nab", changes, changes)
            damped *= np.where(better, 1.0 / factor, factor)
            steep = curved + damped[:, None, None] * np.eye(4) * (1.0 + np.einsum("naa->na", curved)[:, None])
            steps = np.linalg.solve(steep, -slope[..., None])[..., 0]
            trial = kept + np.clip(steps, -_FARTHEST, _FARTHEST) * _ASIDE
        return np.asarray(least[_misfit(least).argmin()])

    def _felt(self, touch: PlaceTouch, cell: tuple[float, float]) -> _Felt:
        """A touch as it is compared."""
        assert touch.image is not None, "asked in log_factor"
        image, pad = compared(touch.image[None])[0], self.imaging.pad
        full = pad.stiffness * pad.max_depth * (2.0 * pad.half_width) ** 2  # force of an image at full scale everywhere
        force = full * float(np.where(image > 2.0 * self._noise, image, 0.0).mean() / self._state.force[0])
        return _Felt(touch.place or cell, touch.height, image, float(np.clip(force, *self.imaging.force)))

    def _residuals(self, solid: Shape, lying: _Lying, felt: Sequence[_Felt]) -> Floats:
        """Of heights and of pixels for each way to lie and touch, in standard deviations, ``(N, T, 1 + e * e)``.

        The squares of the pixels count as their mean.
        """
        resting, window = rests_of(solid), self.imaging.window
        turn, places, size = lying.pose[:, 0], lying.pose[:, 1:3], np.clip(lying.pose[:, 3], *self.sizes)
        turns = size[:, None, None] * (about_vertical(turn) @ resting.rotations[lying.face])
        lifts, pixel = size * resting.lifts[lying.face], window.edge / window.num_pixels
        found = []
        for touch in felt:
            aside = places - touch.place
            maps = heights_above_floor(solid, turns, lifts, aside, pixel, window.num_pixels, np.float32)
            maps = np.maximum(maps, np.float32(0.0))  # the floor
            images = self._of_images(touch, maps).reshape(len(maps), -1)
            height = (maps.max(axis=(1, 2)) - touch.height) / _HEIGHT
            found.append(np.column_stack([height, images / np.sqrt(self._variance * images.shape[1])]))
        return np.stack(found, axis=1)

    def _of_images(self, felt: _Felt, maps: Floats32) -> Floats32:
        """Images of height maps with the gain that fits best, less the one that was felt, ``(N, e, e)``."""
        gain = self.imaging.gain
        plain = replace(self.imaging, force=(felt.force, felt.force), gain=0.0, noise=0.0)
        drawn = images_of(plain, maps, self._state, np.random.default_rng(0))
        if self._noise > 0.0:
            drawn = clipped_noise(drawn, self._noise)[0]
        factor = (drawn * felt.image).sum(axis=(1, 2)) / np.maximum((drawn**2).sum(axis=(1, 2)), 1e-9)
        return np.asarray(drawn * np.clip(factor, 1.0 - gain, 1.0 + gain)[:, None, None] - felt.image)

    @cached_property
    def _state(self) -> SensorState:
        return sensor_state(self.imaging, self.scene)

    @cached_property
    def _noise(self) -> float:
        """Standard deviation of a taxel, relative to full scale."""
        return float(self._state.noise[0]) * self.imaging.noise

    @cached_property
    def _variance(self) -> float:
        """Of a pixel that is compared."""
        shown = compared(np.zeros((1, *self.scene.image_shape[:2]), np.uint8)).shape[1]
        return (self._noise * shown / self.imaging.taxels) ** 2 + _IMAGE**2


def _squared(residuals: Floats) -> Floats:
    """Squared residuals of touches, of residuals ``(..., T, r)``."""
    return np.square(residuals).sum(axis=-1)


def _misfit(squared: Floats) -> Floats:
    """Mean of log(1 + squared residual) over the touches that fit best, ``(..., T)``."""
    logs = np.sort(np.log1p(np.minimum(squared, _LARGEST)), axis=-1)
    return np.asarray(logs[..., : math.ceil(_COUNTED * logs.shape[-1])].mean(axis=-1))
