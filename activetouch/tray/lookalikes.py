"""Is an object in a tray of the shape that it is taken for, or only like it?

The places and turns of a belief stand for cells of 5 mm and 15°, within which presses differ so much that a body that
is only like the shape may feel like it. So the body is pressed in simulation as it is believed to lie, and then a
little otherwise, until heights and images fit all touches of the object as well as they can. What then remains is small
for an object of the shape and large for others; the densities of both are from simulated objects.

No simulation of physics: the images are those of :mod:`activetouch.perception.pressed_beliefs`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.perception.imaging import Floats32, Imaging, SensorState, sensor_state
from activetouch.perception.pressed_beliefs import compared, images_of
from activetouch.perception.strangers import TwoDensities
from activetouch.scene import Scene
from activetouch.solids.solid import Floats, Shape
from activetouch.tray.resting import NUM_TURNS, about_vertical, heights_above_floor
from activetouch.tray.world import rests_of
from belief.tray import Found, PlaceTouch, TrayBelief

_PRESSED = 96, 384  # ways to lie that are pressed at once: at first, and where none of these fits
_BEST = 1 / 12  # of these, that are changed a little
_NEARER = (1.0, 0.5, 0.25, 0.12, 0.06)  # by which part of a cell they are changed
_MOST = 8  # touches of an object that count, spread over all of them
_FORCES = 4  # that a touch may have had
_FITTING = 0.5  # misfit of a way to lie that fits
_HEIGHT = 0.0006  # standard deviation of a height [m]
_LARGEST = 50.0  # squared residual of a touch, whose pad may reach a neighbour
_IMAGE = 0.02  # standard deviation of a pixel beside its noise, relative to full scale
_MISFITS = TwoDensities(
    np.array([[-0.75, -0.55, -0.5, -0.5], [-2.9, -2.8, -2.7, -2.7]]),
    np.array([[0.8, 0.5, 0.2, 0.17], [1.1, 1.0, 1.0, 1.0]]),
)
"""Of the negative misfit after one to four touches: of objects of the shape, and of others that are taken for it.

They are from 30 objects of 32 meshes and 40 random bodies, alone in a tray of ``gel``; the others' are nearer and wider
than those of random bodies, 3.0 ± 0.6, as other meshes are more like a mesh, which searches with seed 21 showed.
"""


class _Lying(NamedTuple):
    """N ways in which a body may lie: face, turn [rad], place [m] and size factor; ``(N,)``, of places ``(N, 2)``."""

    face: NDArray[np.int64]
    turn: Floats
    places: Floats
    size: Floats

    def take(self, chosen: NDArray[np.int64]) -> _Lying:
        """Those with these numbers."""
        return _Lying(self.face[chosen], self.turn[chosen], self.places[chosen], self.size[chosen])


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
        """See :class:`belief.tray.Lookalikes`."""
        asked, known = one.kept.get(shape, (0, 0.0))
        if not asked or one.touches >= asked + max(1, asked // 4):  # what it takes grows with their number
            known = _MISFITS.log_ratio(one.touches, -self.misfit(belief, one, shape))
            one.kept[shape] = one.touches, known
        return known

    def misfit(self, belief: TrayBelief, one: Found, shape: int) -> float:
        """Mean over an object's touches of log(1 + squared residual), as a shape lies that fits them best.

        The generator follows from the touches: the same touches give the same number.
        """
        solid = list(self.scene.solids.values())[shape]
        rng = np.random.default_rng([0x100C, shape, *np.ravel(one.cells).tolist()])
        met = [one.met[place] for place in np.unique(np.linspace(0, one.touches - 1, _MOST).astype(int)).tolist()]
        places = [belief.centre(touch.cell) if touch.place is None else touch.place for touch in met]
        found = np.inf
        for number in _PRESSED:
            lying, kept = self._believed(belief, one, shape, number, rng), round(number * _BEST)
            for part in _NEARER:
                lying = self._near(lying, part, belief.table.pitch, 0 if part == 1.0 else kept, rng)
                misfits = self._misfits(solid, lying, met, places)
                best = np.argsort(misfits, kind="stable")[:kept]
                lying = lying.take(np.tile(best, number // kept))
                found = min(found, float(misfits[best[0]]))
            if found <= _FITTING:
                break
        return found

    def _believed(self, belief: TrayBelief, one: Found, shape: int, number: int, rng: np.random.Generator) -> _Lying:
        """So many ways to lie, drawn from the belief about an object of a shape."""
        rows, resting = belief.table.shape_of == shape, rests_of(list(self.scene.solids.values())[shape])
        faces = np.repeat(np.arange(len(resting.turns)), resting.turns)
        turns = np.concatenate([np.arange(number) for number in resting.turns])
        assert rows.sum() == len(faces), "one row for each face and turn"
        probs = one.probs(np.where(np.arange(one.num_shapes) == shape, 0.0, -np.inf))
        chosen = rng.choice(len(probs), number, p=probs)
        row = one.row[chosen] - int(rows.argmax())
        centres = np.array([belief.centre((x, y)) for x, y in zip(one.x[chosen], one.y[chosen], strict=True)])
        return _Lying(faces[row], turns[row] * (2.0 * np.pi / NUM_TURNS), centres, np.ones(number))

    def _near(self, lying: _Lying, part: float, pitch: float, kept: int, rng: np.random.Generator) -> _Lying:
        """Ways to lie beside these, within a part of their cells; the first ones are kept as they are."""
        aside = rng.uniform(-part, part, (len(lying.face), 4))
        aside[:kept] = 0.0
        least, most = self.sizes
        size = np.clip(lying.size + aside[:, 3] * (most - least) / 2.0, least, most)
        turn = lying.turn + aside[:, 0] * np.pi / NUM_TURNS
        return _Lying(lying.face, turn, lying.places + aside[:, 1:3] * pitch / 2.0, size)

    def _misfits(self, solid: Shape, lying: _Lying, met: list[PlaceTouch], places: list[tuple[float, float]]) -> Floats:
        """:meth:`misfit` of each way to lie."""
        resting, window = rests_of(solid), self.imaging.window
        turns = lying.size[:, None, None] * (about_vertical(lying.turn) @ resting.rotations[lying.face])
        lifts, pixel = lying.size * resting.lifts[lying.face], window.edge / window.num_pixels
        found = np.zeros(len(turns))
        for touch, place in zip(met, places, strict=True):
            assert touch.image is not None, "of a touch that met something"
            maps = heights_above_floor(solid, turns, lifts, lying.places - place, pixel, window.num_pixels, np.float32)
            maps = np.maximum(maps, np.float32(0.0))  # the floor
            height = (maps.max(axis=(1, 2)) - touch.height) / _HEIGHT
            squared = height**2 + self._of_images(compared(touch.image[None])[0], maps) / self._variance
            found += np.log1p(np.minimum(squared, _LARGEST))
        return found / len(met)

    def _of_images(self, felt: Floats32, maps: Floats32) -> Floats:
        """Mean squared difference of an image and those of height maps, with the force and gain that fit best."""
        found = np.full(len(maps), np.inf)
        gain = self.imaging.gain
        for force in np.linspace(*self.imaging.force, 2 * _FORCES + 1)[1::2].tolist():
            plain = replace(self.imaging, force=(force, force), gain=0.0, noise=0.0)
            drawn = images_of(plain, maps, self._state, np.random.default_rng(0))
            factor = (drawn * felt).sum(axis=(1, 2)) / np.maximum((drawn**2).sum(axis=(1, 2)), 1e-9)
            drawn = drawn * np.clip(factor, 1.0 - gain, 1.0 + gain)[:, None, None]
            found = np.minimum(found, np.square(drawn - felt).mean(axis=(1, 2)))
        return found

    @cached_property
    def _state(self) -> SensorState:
        return sensor_state(self.imaging, self.scene)

    @cached_property
    def _variance(self) -> float:
        """Of a pixel that is compared."""
        shown = compared(np.zeros((1, *self.scene.image_shape[:2]), np.uint8)).shape[1]
        noise = float(self._state.noise[0]) * self.imaging.noise * shown / self.imaging.taxels
        return noise**2 + _IMAGE**2
