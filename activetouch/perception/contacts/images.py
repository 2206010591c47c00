"""Images of a pressure sensor from surfaces that are pressed against it, for many touches at once, on any device."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from activetouch.perception.described_pads import from_state, images_of_taxels
from activetouch.perception.imaging import Imaging, SensorState, regridded

_BISECTIONS = 18
_REACH = 4.0  # standard deviations at which a blur ends


def images(
    imaging: Imaging, reached: Tensor, states: SensorState, world: np.ndarray, random: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Images in [0, 1] of bodies that meet the pad, ``(B, pixels, pixels)``, and whether they hit it, ``(B,)``.

    ``reached (B, n, n)`` are height maps over ``imaging.window`` [m], ``-inf`` beside a body, and ``world (B,)`` in
    0 … W − 1 is the state of each touch. ``random`` draws forces, gains and noise, on the device of the maps.
    """
    if imaging.described is not None:
        return _of_taxels(imaging, reached, states, world, random)
    touches = _Touches(imaging, states, world, random)
    highest = reached.amax(dim=(1, 2))
    hit = torch.isfinite(highest)
    gap = torch.where(torch.isfinite(reached), torch.where(hit, highest, 0.0)[:, None, None] - reached, 1.0)
    stiffness = touches.of(states.stiffness)
    load = touches.uniform(*imaging.force) * touches.of(states.force) / (stiffness * imaging.pad.stiffness)
    area = (2 * imaging.pad.half_width / imaging.samples) ** 2
    seen = _indentation(gap, load / area, imaging.pad.max_depth) * (stiffness / imaging.pad.max_depth)[:, None, None]
    seen = touches.blurred(touches.shifted(seen))
    gain = touches.of(states.gain) * touches.uniform(1 - imaging.gain, 1 + imaging.gain)
    seen = (seen * gain[:, None, None] - touches.of(states.hysteresis)[:, None, None]).clamp_min(0.0)
    return touches.read(seen), hit


def _of_taxels(
    imaging: Imaging, reached: Tensor, states: SensorState, world: np.ndarray, random: torch.Generator
) -> tuple[Tensor, Tensor]:
    """:func:`images` of the taxels of a described pad."""
    pad, touches = imaging.description, _Touches(imaging, states, world, random)
    face = torch.from_numpy(pad.taxels.face(imaging.samples).astype(np.float32)).to(reached.device)
    reached = reached + face
    highest = reached.amax(dim=(1, 2))
    hit = torch.isfinite(highest)
    gap = torch.where(torch.isfinite(reached), torch.where(hit, highest, 0.0)[:, None, None] - reached, 1.0)
    stiffness = touches.of(states.stiffness) * imaging.pad.stiffness
    area = (2 * imaging.pad.half_width / imaging.samples) ** 2
    load = touches.uniform(*imaging.force) * touches.of(states.force) / (stiffness * area)
    pressure = _indentation(gap, load, imaging.pad.max_depth) * (stiffness / pad.full_scale)[:, None, None]
    rng = np.random.default_rng(int(torch.randint(1 << 62, (1,), generator=random, device=random.device)))
    numbers = {name: values[world] for name, values in from_state(pad, states).items()}
    seen = images_of_taxels(pad, pressure.cpu().numpy(), numbers, rng)
    shown = regridded(seen.astype(np.float32), imaging.pixels)
    return torch.from_numpy(shown).to(reached.device), hit


class _Touches:
    """Touches in worlds; arrays over the worlds become tensors over the touches."""

    def __init__(self, imaging: Imaging, states: SensorState, world: np.ndarray, random: torch.Generator) -> None:
        self.imaging, self.states, self.world, self.random = imaging, states, world, random

    def of(self, values: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values[self.world], np.float32)).to(self.random.device)

    def uniform(self, low: float, high: float) -> Tensor:
        drawn = torch.rand(len(self.world), generator=self.random, device=self.random.device)
        return low + (high - low) * drawn

    def shifted(self, seen: Tensor) -> Tensor:
        """Images displaced by whole points, with zeros where nothing is shown."""
        edge = seen.shape[-1]
        by = torch.round(self.of(self.states.shift) * edge).long()
        source = torch.arange(edge, device=seen.device) - by[:, :, None]  # rows and columns, (B, 2, n)
        inside = (source >= 0) & (source < edge)
        rows, columns = source.clamp(0, edge - 1).unbind(1)
        seen = seen.gather(1, rows[:, :, None].expand_as(seen)).gather(2, columns[:, None].expand_as(seen))
        return seen * (inside[:, 0, :, None] & inside[:, 1, None])

    def blurred(self, seen: Tensor) -> Tensor:
        edge = seen.shape[-1]
        std = self.of(self.states.blur)[:, None, None] * edge
        distance = torch.arange(edge, device=seen.device)[:, None] - torch.arange(edge, device=seen.device)
        weight = torch.exp(-0.5 * (distance / std.clamp_min(1e-3)) ** 2) * (distance.abs() <= _REACH * std + 0.5)
        offsets = torch.arange(-2 * edge, 2 * edge + 1, device=seen.device)
        whole = torch.exp(-0.5 * (offsets / std.clamp_min(1e-3)) ** 2) * (offsets.abs() <= _REACH * std + 0.5)
        weight = weight / whole.sum(dim=2, keepdim=True)
        return weight @ seen @ weight

    def read(self, seen: Tensor) -> Tensor:
        """The mean reading of all taxels of a pixel: their noise is clipped at zero, which moves the mean."""
        imaging, wide = self.imaging, self.states.wide[self.world]
        found = seen.new_empty(len(seen), imaging.pixels, imaging.pixels)
        for width in np.unique(wide):
            rows = np.flatnonzero(wide == width)
            taxels = imaging.taxels if width == 0 else int(imaging.pixels / 2**width)
            some = torch.from_numpy(rows).to(seen.device)
            found[some] = _Touches(imaging, self.states, self.world[rows], self.random).felt(seen[some], taxels)
        return found

    def felt(self, seen: Tensor, taxels: int) -> Tensor:
        imaging, states = self.imaging, self.states
        shown = min(taxels, imaging.samples)
        values = binned(seen, shown)
        std = self.of(states.noise)[:, None, None] * imaging.noise
        noise = torch.randn(values.shape, generator=self.random, device=values.device)
        if taxels > imaging.samples:  # a sample is many taxels wide
            values, variance = _clipped_moments(values, std.clamp_min(1e-9))
            std = torch.sqrt(variance * (imaging.samples / taxels) ** 2)
        noisy = (values + std * noise).clamp(0.0, 1.0)
        dead, stuck = (self.of(regridded(cells, shown)) for cells in (states.dead, states.stuck))
        if imaging.dead is not None:
            always = binned(torch.from_numpy(imaging.dead[None].astype(np.float32)), shown)
            dead = (dead + always.to(dead.device)).clamp_max(1.0)
        noisy = noisy * (1 - dead) * (1 - stuck) + stuck
        if shown >= imaging.pixels:
            return binned(noisy, imaging.pixels)
        times = imaging.pixels // shown
        return noisy.repeat_interleave(times, dim=1).repeat_interleave(times, dim=2)


def encoded(reached: Tensor, inner: int, face: np.ndarray | None = None) -> Tensor:
    """As :func:`activetouch.perception.imaging.encoded`, on any device."""
    margin = (reached.shape[-1] - inner) // 2
    middle = slice(margin, margin + inner)
    met = reached
    if face is not None:
        over, felt = torch.from_numpy(face).to(reached.device)
        met = reached + over
        reached = reached + torch.where(torch.isfinite(over), over, over[torch.isfinite(over)].min())
    first = met[:, middle, middle].amax(dim=(1, 2))
    first = torch.where(torch.isfinite(first), first, reached.amax(dim=(1, 2)))
    first = torch.where(torch.isfinite(first), first, 0.0)[:, None, None]
    gap = torch.where(torch.isfinite(reached), first - reached, 0.02).clamp(-0.006, 0.008)
    maps = [gap / 0.004, torch.exp(-gap.clamp_min(-0.001) / 0.0006) / 2]
    if face is not None:
        maps.append(felt.expand_as(gap))
    return torch.stack(maps, dim=1)


def _indentation(gap: Tensor, load: Tensor, deepest: float) -> Tensor:
    """Indentation of every point whose sum over the points is ``load``, unless the layer bottoms out, by bisection."""
    low, high = torch.zeros_like(load), torch.full_like(load, deepest)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        short = (middle[:, None, None] - gap).clamp_min(0.0).sum(dim=(1, 2)) < load
        low, high = torch.where(short, middle, low), torch.where(short, high, middle)
    return (low[:, None, None] - gap).clamp_min(0.0)


def binned(maps: Tensor, edge: int) -> Tensor:
    """Means of square blocks of maps ``(n, m, m)``: ``edge`` pixels along an edge."""
    n = maps.shape[-1] // edge
    return maps if n == 1 else maps.reshape(-1, edge, n, edge, n).mean(dim=(2, 4))


def _clipped_moments(values: Tensor, std: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and variance of a normal variable that is clipped at zero."""
    z = values / std
    density = torch.exp(-z * z / 2) / math.sqrt(2 * math.pi)
    below = torch.special.ndtr(z)
    mean = values * below + std * density
    variance = (values * values + std * std) * below + values * std * density - mean * mean
    return mean, variance.clamp_min(1e-8)
