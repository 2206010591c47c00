"""Simulated touches of random bodies, in batches: what a reader that knows the sensor, not the shapes, learns from.

One batch holds B touches of G random bodies in W worlds. Every touch has its image, the contact that its hypothesis
predicts, and the width of the cell that the hypothesis stands for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.perception.contacts.bodies import random_body
from activetouch.perception.contacts.imaging import BROKEN, LIMITS, Floats32, Imaging, SensorState, encoded
from activetouch.poses import hamilton_product, to_matrices
from activetouch.pressing.height_maps import Window
from activetouch.solids.raster import Surface, heights

_NOMINAL = 0.45  # share of nuisances that are as they should be
_CELLS = (0.035, 0.35)  # narrowest and widest cell [rad]
_FACTORS = ("stiffness", "force", "noise", "gain")
_TOGETHER = (*((name,) for name in _FACTORS), ("blur", "hysteresis"), ("shift",), ("dead", "stuck"))
"""Nuisances that are as they should be together."""


class Batch(NamedTuple):
    """B touches of G bodies, of which touches i · B / G … belong to body i, in W worlds.

    Attributes:
        images: ``(B, n, n)``.
        hit: whether the pad was hit, ``(B,)``.
        contacts: encoded, of every touch's own hypothesis, ``(B, 2, m, m)``.
        cells: width of the cells that the hypotheses stand for [rad], ``(B,)``.
        world: of every touch, ``(B,)``, in 0 … W − 1.
        codes: of the worlds, ``(W, STATE_SIZE)``.
        bodies: ``(B,)``, in 0 … G − 1.
    """

    images: Floats32
    hit: NDArray[np.bool_]
    contacts: Floats32
    cells: Floats32
    world: NDArray[np.int64]
    codes: Floats32
    bodies: NDArray[np.int64]


@dataclass(frozen=True)
class Batches:
    """An endless stream of batches; batch i follows from the seed and i alone.

    Attributes:
        imaging: of the sensor.
        bodies: numbers of the random bodies to draw from.
        groups: G.
        touches: of each body in a batch.
        worlds: W.
        seed: of the stream.
    """

    imaging: Imaging
    bodies: range
    groups: int = 16
    touches: int = 32
    worlds: int = 8
    seed: int = 0

    def __call__(self, number: int) -> Batch:
        """Batch ``number``."""
        rng = np.random.default_rng([self.seed, number, len(self.bodies)])
        imaging, total = self.imaging, self.groups * self.touches
        worlds = drawn_worlds(rng, self.worlds, _NOMINAL, imaging.coarser)
        world = np.tile(np.arange(self.worlds), -(-total // self.worlds))[:total]
        narrow, broad = np.log(_CELLS)
        cells = np.exp(rng.uniform(narrow, broad, total))
        turns = _normalised(rng.normal(size=(total, 4)))
        sizes = rng.uniform(*imaging.sizes, total)
        offsets = rng.uniform(-imaging.offset, imaging.offset, (total, 2))
        near = _near(turns, cells, rng)
        seen = np.empty((total, imaging.samples, imaging.samples), np.float32)
        predicted = np.empty((total, *[imaging.wide_window.num_pixels] * 2), np.float32)
        for group, body in enumerate(rng.choice(self.bodies, self.groups, replace=False)):
            some = slice(group * self.touches, (group + 1) * self.touches)
            surface = kept_body(int(body))
            seen[some] = _maps(surface, turns[some], sizes[some], offsets[some], imaging.window)
            nearby = sizes[some] * np.exp(rng.normal(size=self.touches) * 0.15 * cells[some])
            predicted[some] = _maps(surface, near[some], nearby, np.zeros((self.touches, 2)), imaging.wide_window)
        images, hit = imaging.images(seen, SensorState(*(part[world] for part in worlds)), rng)
        return Batch(
            images,
            hit,
            encoded(predicted, imaging.contact_pixels),
            cells.astype(np.float32),
            world,
            worlds.code(),
            np.repeat(np.arange(self.groups), self.touches),
        )


def _maps(
    surface: Surface,
    turns: NDArray[np.float64],
    sizes: NDArray[np.float64],
    places: NDArray[np.float64],
    window: Window,
) -> Floats32:
    pixel = window.edge / window.num_pixels
    return heights(surface, to_matrices(turns) * sizes[:, None, None], places, pixel, window.num_pixels, np.float32)


@lru_cache(maxsize=8192)
def kept_body(number: int) -> Surface:
    """A random body, kept for the next batch that shows it."""
    return random_body(number)


def drawn_worlds(rng: np.random.Generator, number: int, nominal: float, coarser: float = 0.0) -> SensorState:
    """Random worlds, in which each nuisance is as it should be with probability ``nominal``, and all are in the first.

    The first world of a batch is nominal, because the sensor mostly is.
    """
    broken = np.zeros((2, number, BROKEN, BROKEN), np.float32)
    for world in range(number):
        if rng.uniform() < 0.5:  # one or two cells, all of their taxels or some
            for _ in range(rng.integers(1, 3)):
                share = 1.0 if rng.uniform() < 0.6 else rng.uniform(0.05, 1.0)
                broken[rng.integers(2), world, rng.integers(BROKEN), rng.integers(BROKEN)] = share
        elif rng.uniform() < 0.4:  # single taxels everywhere
            broken[rng.integers(2), world] = rng.uniform(0.0, 0.12)
    strange = {name: rng.uniform(*LIMITS[name], number) for name in ("blur", "hysteresis")}
    for name in _FACTORS:
        low, high = np.log2(LIMITS[name])
        strange[name] = np.exp2(rng.uniform(low, high, number))
    strange |= {"shift": rng.uniform(*LIMITS["shift"], (number, 2))}
    strange |= {"dead": broken[0], "stuck": broken[1] * (broken[0] == 0.0)}
    is_strange = rng.uniform(size=(number, 7)) > nominal
    wide = rng.uniform(size=number) < coarser
    is_strange &= (~wide | (rng.uniform(size=number) < 0.5))[:, None]  # and often is as it should be otherwise
    wide[0] = is_strange[0] = False
    usual = SensorState.nominal(number)._asdict()
    for column, names in enumerate(_TOGETHER):
        for name in names:
            chosen = is_strange[:, column].reshape(number, *[1] * (usual[name].ndim - 1))
            usual[name] = np.where(chosen, strange[name], usual[name]).astype(np.float32)
    return SensorState(**usual)._replace(wide=wide.astype(np.float32))


def _normalised(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _near(turns: NDArray[np.float64], cells: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Orientations after small turns, whose standard deviation about each axis is the width of the cell."""
    small = rng.normal(size=(3, len(turns))) * (cells / 2)
    product = hamilton_product(turns.T, (np.ones(len(turns)), *small))
    return _normalised(np.stack(product, axis=1))
