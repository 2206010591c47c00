"""Press what is believed: images of a body as it may lie, in any state of the sensor, and how odd the felt ones are.

No simulation of physics: the images are those that a reader of any object is trained with, from height maps. The body
that was named is drawn from its posterior, pressed where it was touched, and the images that were felt are compared
with the drawn ones. A discrepancy of 0 ± 1 is usual; that of a body that the sensor does not feel like this is large.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from activetouch.distributions import Bodies
from activetouch.perception.imaging import Floats32, Imaging, SensorState, regridded
from activetouch.poses import slightly_turned, to_matrices, turned
from activetouch.scene import Scene
from activetouch.solids.raster import heights
from belief.validation import Floats

DRAWN = 32
"""Presses that a felt image is compared with."""
_EDGE = 16  # largest number of pixels along an edge that are compared
_NEWTON, _CLOSE = 20, 1e-6  # steps, and the largest last one, relative to the deepest indentation
_BLUR_REACH = 4.0  # standard deviations
_LEAST_SPREAD = 0.02  # of a pixel, relative to full scale
_LARGEST = 6.0  # residual of a pixel
_LEAST_WIDTH = 0.12  # of log discrepancies


@dataclass(frozen=True, eq=False)
class PressedBeliefs:
    """Presses bodies of a scene as a sensor in some state would feel them.

    Attributes:
        scene: has the solids and the poses.
        imaging: of the sensor.
        bodies: hypotheses of every shape, from which those that are pressed are chosen.
        width: of the orientations that a hypothesis stands for [rad].
    """

    scene: Scene
    imaging: Imaging
    bodies: Bodies
    width: float

    def pressed(
        self,
        shape: int,
        chosen: NDArray[np.int64],
        pose: int,
        state: SensorState,
        rng: np.random.Generator,
        edge: int = _EDGE,
    ) -> Floats32:
        """Images of ``chosen (M,)`` hypotheses of a shape in a pose, ``(M, e, e)``; ``state`` has arrays ``(1, ...)``.

        Each body is turned by a small random rotation, as wide as the orientations that its hypothesis stands for.
        """
        imaging, number = self.imaging, len(chosen)
        few = self.bodies.take(chosen)
        rests = slightly_turned(few.rests, self.width, rng)
        pose_label = self.scene.pose_labels[pose]
        axes = to_matrices(turned(self.scene.rotations[pose_label], rests)) * few.sizes[:, None, None]
        places = self.scene.aim_offsets[pose] + rng.uniform(-imaging.offset, imaging.offset, (number, 2))
        window = imaging.window
        solids, members = self.scene.bodies(self.scene.shape_labels[shape], few.shares)
        maps = np.empty((number, window.num_pixels, window.num_pixels), np.float32)
        for member in np.unique(members):
            rows = members == member
            surface, pixel = solids[member].surface, window.edge / window.num_pixels
            maps[rows] = heights(surface, axes[rows], places[rows], pixel, window.num_pixels, np.float32)
        return images_of(imaging, maps, state, rng, edge)


def compared(images: NDArray[np.uint8], edge: int = _EDGE) -> Floats32:
    """Images ``(n, h, w)`` as they are compared, ``(n, e, e)`` in [0, 1], ``edge`` pixels along an edge at most."""
    return binned(images.astype(np.float32) / 255.0, min(edge, images.shape[1]))


class Residuals(NamedTuple):
    """How far the touches of an object are from presses of what is believed.

    Attributes:
        number: of touches.
        squared: sum over the touches of the mean limited squared residual, of what was felt and then of each of M
            presses, ``(1 + M,)``.
        total: sum over the touches of the residuals of every pixel, ``(1 + M, e, e)``.
    """

    number: int
    squared: Floats
    total: Floats

    @classmethod
    def of(cls, felt: Sequence[Floats32] | Floats32, drawn: Sequence[Floats32]) -> Residuals:
        """The residuals of images ``(e, e)`` by M presses in the same poses, ``(M, e, e)``; each press by the others.

        >>> rng = np.random.default_rng(0)
        >>> drawn = [rng.normal(0.5, 0.1, (32, 4, 4)).astype(np.float32) for _ in range(3)]
        >>> alike, other = ([some[0] + shift for some in drawn] for shift in (0.0, 0.3))
        >>> [round(oddness([Residuals.of(felt, drawn)])) for felt in (alike, other)]
        [-1, 12]
        """
        squared, total = np.zeros(1 + len(drawn[0])), np.zeros((1 + len(drawn[0]), *felt[0].shape))
        for image, some in zip(felt, drawn, strict=True):
            every = np.concatenate([image[None], some]).astype(np.float64)
            number, sums, squares = len(some), every[1:].sum(axis=0), np.square(every[1:]).sum(axis=0)
            others = np.r_[number, np.full(number, number - 1)][:, None, None]
            own = np.concatenate([np.zeros((1, *image.shape)), every[1:]])  # each press is left out of its others
            mean = (sums - own) / others
            variance = np.maximum(squares - np.square(own) - others * np.square(mean), 0.0) / (others - 1)
            limited = np.clip((every - mean) / np.sqrt(variance + _LEAST_SPREAD**2), -_LARGEST, _LARGEST)
            squared += np.square(limited).mean(axis=(1, 2))
            total += limited
        return cls(len(felt), squared, total)


def oddness(objects: Sequence[Residuals]) -> float:
    """By how much felt images are odder than presses of what is believed: 0 ± 1 if objects are as believed.

    The larger of two discrepancies over all objects: residuals that are large, and residuals that are alike in all
    touches.
    """
    number = sum(one.number for one in objects)
    squared = np.log(np.sum([one.squared for one in objects], axis=0))
    alike = np.log(np.square(np.sum([one.total for one in objects], axis=0)).mean(axis=(1, 2)) / number)
    both = [(part[0] - part[1:].mean()) / max(part[1:].std(ddof=1), _LEAST_WIDTH) for part in (squared, alike)]
    return float(max(both))


def images_of(
    imaging: Imaging, reached: Floats32, state: SensorState, rng: np.random.Generator, edge: int = _EDGE
) -> Floats32:
    """As :func:`activetouch.perception.contacts.images.images` in one state, without torch, of ``edge`` pixels at most.

    ``(n, e, e)``, relative to full scale.
    """
    number, samples = len(reached), imaging.samples
    force = rng.uniform(*imaging.force, number)
    if imaging.described is not None:
        return _of_taxels(imaging, reached, force, state, rng, edge)
    seen = pressures(imaging, reached, force, state)
    rows, columns = np.round(state.shift[0] * samples).astype(int)
    if rows or columns:
        moved = np.zeros((number, 3 * samples, 3 * samples), np.float32)
        moved[:, samples + rows : 2 * samples + rows, samples + columns : 2 * samples + columns] = seen
        seen = moved[:, samples : 2 * samples, samples : 2 * samples]
    seen = blurred(seen, state)
    gain = float(state.gain[0]) * rng.uniform(1.0 - imaging.gain, 1.0 + imaging.gain, (number, 1, 1))
    seen = np.maximum(seen * gain - float(state.hysteresis[0]), 0.0)
    taxels = imaging.taxels if state.wide[0] == 0 else int(imaging.pixels / 2 ** state.wide[0])
    shown = min(taxels, samples)
    values, std = binned(seen, shown), float(state.noise[0]) * imaging.noise
    spread = np.full(values.shape, std, np.float32)
    if taxels > samples and std > 0.0:  # the mean of many taxels, whose noise is clipped at zero
        values, spread = clipped_noise(values, std, taxels // samples)
    noise = spread * rng.normal(size=values.shape) if std > 0.0 else np.float32(0.0)
    noisy = np.clip(values + noise, 0.0, 1.0)
    dead, stuck = (regridded(cells, shown)[0] for cells in (state.dead, state.stuck))
    if imaging.dead is not None:
        dead = np.minimum(dead + binned(imaging.dead[None].astype(np.float32), shown)[0], 1.0)
    return binned(noisy * (1.0 - dead) * (1.0 - stuck) + stuck, min(edge, shown)).astype(np.float32)


def _of_taxels(
    imaging: Imaging, reached: Floats32, force: Floats, state: SensorState, rng: np.random.Generator, edge: int
) -> Floats32:
    """:func:`images_of` the taxels of a described pad."""
    from activetouch.perception.described_pads import from_state, images_of_taxels  # other pads do not need it

    pad = imaging.description
    seen = pressures(imaging, reached + pad.taxels.face(imaging.samples).astype(np.float32), force, state)
    numbers = {name: np.repeat(value, len(reached)) for name, value in from_state(pad, state).items()}
    shown = images_of_taxels(pad, seen * (imaging.pad.stiffness * imaging.pad.max_depth / pad.full_scale), numbers, rng)
    return binned(shown, min(edge, pad.taxels.raster)).astype(np.float32)


def pressures(imaging: Imaging, reached: Floats32, force: Floats, state: SensorState) -> Floats32:
    """Pressure of heights that reach towards the pad ``(n, s, s)``, relative to the largest; ``force (n,)`` [N]."""
    highest = reached.max(axis=(1, 2))
    gap = np.where(np.isfinite(reached), np.where(np.isfinite(highest), highest, 0.0)[:, None, None] - reached, 1.0)
    stiffness, deepest = float(state.stiffness[0]), imaging.pad.max_depth
    load = force * float(state.force[0]) / (stiffness * imaging.pad.stiffness)
    pixel = 2 * imaging.pad.half_width / imaging.samples
    return _indentation(gap, load / pixel**2, deepest) * np.float32(stiffness / deepest)


def blurred(seen: Floats32, state: SensorState) -> Floats32:
    """Images ``(n, s, s)`` after the blur of the sensor."""
    samples = seen.shape[-1]
    if (std := float(state.blur[0]) * samples) <= 0.0:
        return seen
    distance = np.arange(samples)[:, None] - np.arange(samples)
    weight = np.exp(-0.5 * (distance / std) ** 2) * (np.abs(distance) <= _BLUR_REACH * std + 0.5)
    offsets = np.arange(-2 * samples, 2 * samples + 1)
    weight /= (np.exp(-0.5 * (offsets / std) ** 2) * (np.abs(offsets) <= _BLUR_REACH * std + 0.5)).sum()
    return np.asarray(weight @ seen @ weight)


def clipped_noise(values: Floats32, std: float, taxels: int = 1) -> tuple[Floats32, Floats32]:
    """Mean of taxels whose noise is clipped at zero, ``taxels`` along an edge, and the deviation of this mean."""
    z = values / std
    density, below = np.exp(-z * z / 2.0) / math.sqrt(2.0 * math.pi), ndtr(z)
    mean = values * below + std * density
    variance = (values * values + std * std) * below + values * std * density - mean * mean
    return mean.astype(np.float32), (np.sqrt(np.maximum(variance, 1e-8)) / taxels).astype(np.float32)


def _indentation(gap: Floats32, load: Floats, deepest: float) -> Floats32:
    """Indentation of every point whose sum is ``load``, unless the layer bottoms out, by Newton's method."""
    depth = np.full(len(gap), deepest, np.float32)
    for _ in range(_NEWTON):  # the sum is convex in the depth, so that the steps go down to the root
        indented = np.maximum(depth[:, None, None] - gap, 0.0)
        excess, touching = indented.sum(axis=(1, 2)) - load, np.count_nonzero(indented, axis=(1, 2))
        step = np.maximum(excess / np.maximum(touching, 1), 0.0).astype(np.float32)
        depth -= step
        if (step <= _CLOSE * deepest).all():
            break
    return np.maximum(depth[:, None, None] - gap, 0.0)


def binned(maps: Floats32, edge: int) -> Floats32:
    """Images of ``edge`` pixels along an edge: means of square blocks, or of parts of pixels where these do not fit."""
    n, rest = divmod(maps.shape[-1], edge)
    if rest:
        return regridded(maps, edge)
    return maps if n == 1 else maps.reshape(-1, edge, n, edge, n).mean(axis=(2, 4))
