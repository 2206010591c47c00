"""Simulated touches of random bodies, in batches: what a reader that knows the sensor, not the shapes, learns from.

One batch holds B touches of G random bodies in W worlds. Every touch has its image, the contact that its hypothesis
predicts, and the width of the cell that the hypothesis stands for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from joblib import Parallel, delayed
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset

from activetouch.perception.contacts.bodies import random_body
from activetouch.perception.contacts.device_heights import DeviceBodies
from activetouch.perception.contacts.images import encoded, images
from activetouch.perception.contacts.random_pads import random_pad
from activetouch.perception.described_pads import to_state
from activetouch.perception.imaging import BROKEN, Imaging, SensorState, imaging_of_pad, states_with
from activetouch.poses import normalised, slightly_turned, to_matrices
from activetouch.pressing.height_maps import Window
from activetouch.solids.raster import heights
from activetouch.solids.solid import Floats

_NOMINAL = 0.45  # share of nominal nuisances
_CELLS = (0.035, 0.35)  # narrowest and widest cell [rad]
_FACTORS = ("stiffness", "force", "noise", "gain")
_TOGETHER = (*((name,) for name in _FACTORS), ("blur", "hysteresis"), ("shift",), ("dead", "stuck"))
"""Groups of nuisances that are nominal together."""


class Batch(NamedTuple):
    """B touches of G bodies in W worlds, and H hypotheses; touches i · B / G … belong to body i.

    Attributes:
        images: ``(B, n, n)``.
        hit: whether the pad was hit, ``(B,)``.
        contacts: encoded, ``(H, 2, m, m)``: first each touch's own hypothesis, then the others, body after body.
        cells: width of the cells that the hypotheses stand for [rad], ``(H,)``.
        world: of every touch, ``(B,)``, in 0 … W − 1.
        codes: of the worlds, ``(W, STATE_SIZE)``.
        bodies: ``(B,)``, in 0 … G − 1.
        layout: :attr:`activetouch.perception.imaging.Imaging.layout` of a described pad, else None.
    """

    images: Tensor
    hit: Tensor
    contacts: Tensor
    cells: Tensor
    world: Tensor
    codes: Tensor
    bodies: Tensor
    layout: Tensor | None


@dataclass(frozen=True)
class Batches(Dataset[Batch]):
    """An endless stream of batches; batch i follows from the seed and i alone.

    From batch ``late`` on, the sensor is nominal in at least half of the worlds, instead of one, and every body has
    ``others`` hypotheses beside those of its touches, as in a table. Of the random bodies numbered ``bodies``, a batch
    has ``groups`` with ``touches`` touches each. With the device ``cuda``, the triangles of all bodies are kept there.
    Without an ``imaging``, every batch has another random pad.
    """

    imaging: Imaging | None
    bodies: range
    groups: int = 16
    touches: int = 32
    worlds: int = 8
    late: float = math.inf
    others: int = 0
    seed: int = 0
    device: str = "cpu"

    def __getitem__(self, number: int) -> Batch:
        rng = np.random.default_rng([self.seed, number, len(self.bodies)])
        imaging = self.imaging if self.imaging is not None else imaging_of_pad(random_pad(rng))
        total = self.groups * self.touches
        usual, others = (self.worlds // 2, self.others) if number >= self.late else (1, 0)
        states = drawn_worlds(rng, self.worlds, imaging, usual)
        world = np.tile(np.arange(self.worlds), -(-total // self.worlds))[:total]
        narrow, broad = np.log(_CELLS)
        cells = np.exp(rng.uniform(narrow, broad, total))
        turns = normalised(rng.normal(size=(total, 4)))
        sizes = rng.uniform(*imaging.sizes, total)
        places = rng.uniform(-imaging.offset, imaging.offset, (total, 2))
        near = slightly_turned(turns, cells, rng)
        nearby = sizes * np.exp(rng.normal(size=total) * 0.15 * cells)
        chosen = rng.choice(len(self.bodies), self.groups, replace=False)
        seen = self._maps(chosen, turns, sizes, places, imaging.window)
        predicted = self._maps(chosen, near, nearby, np.zeros_like(places), imaging.wide_window)
        random = torch.Generator(self.device).manual_seed(int(rng.integers(1 << 62)))
        read, hit = images(imaging, seen, states, world, random)
        if others:
            more = self.groups * others
            turns, sizes = normalised(rng.normal(size=(more, 4))), rng.uniform(*imaging.sizes, more)
            maps = self._maps(chosen, turns, sizes, np.zeros((more, 2)), imaging.wide_window)
            predicted = torch.cat([predicted, maps])
            cells = np.append(cells, np.exp(rng.uniform(narrow, broad, more)))
        arrays = cells.astype(np.float32), world, imaging.code(states), np.arange(self.groups).repeat(self.touches)
        width, own, codes, bodies = (torch.from_numpy(part).to(self.device) for part in arrays)
        layout = None if imaging.layout is None else torch.from_numpy(imaging.layout).to(self.device)
        contacts = encoded(predicted, imaging.contact_pixels, imaging.face)
        return Batch(read, hit, contacts, width, own, codes, bodies, layout)

    def _maps(self, chosen: NDArray[np.int64], turns: Floats, sizes: Floats, places: Floats, window: Window) -> Tensor:
        """Height maps over a window, body after body."""
        axes, pixel = to_matrices(turns) * sizes[:, None, None], window.edge / window.num_pixels
        if self.device != "cpu":
            bodies = chosen.repeat(len(turns) // len(chosen))
            return self._on_device.heights(bodies, axes, places, pixel, window.num_pixels)
        each = zip(chosen, np.split(axes, len(chosen)), np.split(places, len(chosen)), strict=True)
        maps = [
            heights(random_body(self.bodies[body]), turned, placed, pixel, window.num_pixels, np.float32)
            for body, turned, placed in each
        ]
        return torch.from_numpy(np.concatenate(maps))

    @cached_property
    def _on_device(self) -> DeviceBodies:
        return DeviceBodies(Parallel(n_jobs=-1)(delayed(random_body)(number) for number in self.bodies), self.device)


def drawn_worlds(rng: np.random.Generator, number: int, imaging: Imaging, usual: int) -> SensorState:
    """Random states of a sensor; the first ``usual`` are nominal, because a sensor mostly is (no described pad)."""
    if imaging.described is not None:
        pad = imaging.description
        return states_with(to_state(pad, pad.response.drawn(number, rng)))
    limits = imaging.limits
    broken = np.zeros((2, number, BROKEN, BROKEN), np.float32)
    for world in range(number):
        if rng.uniform() < 0.5:  # one or two cells, all of their taxels or some
            for _ in range(rng.integers(1, 3)):
                share = 1.0 if rng.uniform() < 0.6 else rng.uniform(0.05, 1.0)
                broken[rng.integers(2), world, rng.integers(BROKEN), rng.integers(BROKEN)] = share
        elif rng.uniform() < 0.4:  # single taxels everywhere
            broken[rng.integers(2), world] = rng.uniform(0.0, 0.12)
    strange = {name: rng.uniform(*limits[name], number) for name in ("blur", "hysteresis")}
    for name in _FACTORS:
        low, high = np.log2(limits[name])
        strange[name] = np.exp2(rng.uniform(low, high, number))
    strange |= {"shift": rng.uniform(*limits["shift"], (number, 2))}
    strange |= {"dead": broken[0], "stuck": broken[1] * (broken[0] == 0.0)}
    is_strange = rng.uniform(size=(number, len(_TOGETHER))) > _NOMINAL
    wide = rng.uniform(size=number) < imaging.coarser
    is_strange &= (~wide | (rng.uniform(size=number) < 0.5))[:, None]  # and is often nominal otherwise
    wide[:usual] = is_strange[:usual] = False
    drawn = SensorState.nominal(number)._asdict()
    for column, names in enumerate(_TOGETHER):
        for name in names:
            chosen = is_strange[:, column].reshape(number, *[1] * (drawn[name].ndim - 1))
            drawn[name] = np.where(chosen, strange[name], drawn[name]).astype(np.float32)
    return SensorState(**drawn)._replace(wide=wide.astype(np.float32))
