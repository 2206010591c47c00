"""The imaging of a pressure sensor, and the contact that a hypothesis predicts, as its network reads it.

A :class:`SensorState` is the state of the sensor and of the press. Height maps
(:func:`activetouch.predicted_contacts`) become images in :mod:`activetouch.perception.contacts.images`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.pressing.pad import Pad

if TYPE_CHECKING:
    from activetouch.pressing.height_maps import Window

Floats32 = NDArray[np.float32]

BROKEN = 4
"""Cells along the edge of the map of broken taxels in the description of a world."""
STATE_SIZE = 9 + 2 * BROKEN**2
"""Numbers that describe a state of the sensor to the network of contacts; all are 0 in the nominal state."""
LIMITS = {
    "stiffness": (2**-1.5, 2.0),
    "force": (2**-2.4, 2.0),
    "noise": (2**-0.5, 4.0),
    "gain": (2**-0.4, 2**0.4),
    "blur": (0.0, 0.08),
    "shift": (-0.1, 0.1),
    "hysteresis": (0.0, 0.1),
}
"""Least and largest of the numbers of a :class:`SensorState` that a reader is trained with, unless its
:class:`Imaging` goes further."""
FEW_PIXELS = 8
"""Pixels along the edge of an image that needs no convolutions, and whose noise does not average away."""
SAMPLES = 32
"""Least number of points along the edge of a pad at which a surface is computed, and largest number of pixels."""


class SensorState(NamedTuple):
    """The state of the sensor and of the press, relative to the sensor's description; arrays are ``(n,)``.

    Attributes:
        stiffness, force, noise, gain: factors.
        blur: standard deviation of a Gaussian filter, in parts of the image's edge.
        shift: displacement of the image along rows and columns, in parts of its edge, ``(n, 2)``.
        hysteresis: amount by which all readings are too low, relative to full scale.
        dead, stuck: share of dead taxels, and of taxels at full scale, in each cell, ``(n, BROKEN, BROKEN)``.
        wide: 0 for the taxels of the sensor; k > 0 for taxels that are 2^k of the reader's pixels wide.
    """

    stiffness: Floats32
    force: Floats32
    noise: Floats32
    gain: Floats32
    blur: Floats32
    shift: Floats32
    hysteresis: Floats32
    dead: Floats32
    stuck: Floats32
    wide: Floats32

    @classmethod
    def nominal(cls, number: int) -> SensorState:
        """The nominal state of the sensor, ``number`` times."""
        ones, zeros = np.ones(number, np.float32), np.zeros(number, np.float32)
        cells = np.zeros((number, BROKEN, BROKEN), np.float32)
        return cls(ones, ones, ones, ones, zeros, np.zeros((number, 2), np.float32), zeros, cells, cells, zeros)

    def code(self) -> Floats32:
        """As the network of contacts reads it, ``(n, STATE_SIZE)``."""
        numbers = (np.log2(self.stiffness), np.log2(self.force), np.log2(self.noise), 4 * np.log2(self.gain))
        others = (20 * self.blur, *(10 * self.shift.T), 20 * self.hysteresis)
        cells = [cells.reshape(len(cells), -1) for cells in (self.dead, self.stuck)]
        parts = [np.stack([*numbers, *others], axis=1), *cells, self.wide[:, None]]
        return np.concatenate(parts, axis=1).astype(np.float32)


@dataclass(frozen=True)
class Imaging:
    """How a sensor makes images.

    Attributes:
        taxels, pixels: along an edge of the image, and of what the network reads; one divides the other.
        force: smallest and largest force [N].
        gain: half range of the gain of each touch.
        noise: standard deviation of each taxel, relative to full scale; ``noisier`` is the largest factor in training.
        offset: largest displacement along y and z [m].
        dead: which taxels never read anything, ``(taxels, taxels)``; None for none.
        samples: points along the edge of the pad at which the surface is computed; a multiple of ``pixels``.
        coarser: share of worlds whose sensor may have taxels two pixels wide.
        displaced: largest blur and largest shift of the image in training, in parts of the edge.
    """

    pad: Pad
    taxels: int
    pixels: int
    force: tuple[float, float] = (1.5, 3.0)
    gain: float = 0.10
    noise: float = 0.02
    offset: float = 0.002
    sizes: tuple[float, float] = (0.75, 1.25)
    dead: NDArray[np.bool_] | None = None
    samples: int = SAMPLES
    coarser: float = 0.0
    noisier: float = LIMITS["noise"][1]
    displaced: tuple[float, float] = (LIMITS["blur"][1], LIMITS["shift"][1])

    def __post_init__(self) -> None:
        edges = self.taxels, self.pixels, self.samples
        ranges = self.force, self.sizes, self.displaced
        numbers = *sum(ranges, ()), self.gain, self.noise, self.offset, self.coarser, self.noisier
        is_valid = (
            all(isinstance(edge, int | np.integer) and edge > 0 for edge in edges)
            and 0 in (self.taxels % self.pixels, self.pixels % self.taxels)
            and self.samples % self.pixels == 0
            and all(len(ends) == 2 for ends in ranges)
        )
        if not (is_valid and np.isfinite(numbers).all() and min(numbers) >= 0.0 and self.force[1] > 0.0):
            raise ValueError(f"numbers out of range, or taxels, pixels and samples that do not divide: {self}")
        if self.dead is not None and self.dead.shape != (self.taxels, self.taxels):
            raise ValueError(f"dead must have the shape {(self.taxels, self.taxels)}, got {self.dead.shape}")

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Least and largest of the numbers of a :class:`SensorState` that the reader is trained with."""
        blur, shift = self.displaced
        return LIMITS | {"noise": (LIMITS["noise"][0], self.noisier), "blur": (0.0, blur), "shift": (-shift, shift)}

    @property
    def window(self) -> Window:
        """The window of the images."""
        from activetouch.pressing.height_maps import Window

        return Window(2 * self.pad.half_width, self.samples)

    @property
    def wide_window(self) -> Window:
        """The window of the predicted contacts: the pad and, around it, the largest offset and shift of the image."""
        from activetouch.pressing.height_maps import Window

        return Window.of(self.pad, self.offset + self.displaced[1] * 2 * self.pad.half_width, self.contact_pixels)

    @property
    def contact_pixels(self) -> int:
        """Pixels along the edge of the pad in a predicted contact."""
        return max(self.pixels, 16)

    def fields(self) -> dict[str, Any]:
        """Its fields as JSON types."""
        return asdict(self) | {"dead": None if self.dead is None else self.dead.astype(int).tolist()}

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Imaging:
        """The description from :meth:`fields`."""
        ranges = {name: tuple(map(float, fields[name])) for name in ("force", "sizes", "displaced") if name in fields}
        dead = None if fields["dead"] is None else np.array(fields["dead"], bool)
        return cls(**{**fields, **ranges, "pad": Pad(**fields["pad"]), "dead": dead})


def encoded(reached: Floats32, inner: int) -> Floats32:
    """Predicted contacts as the network reads them: gaps behind the first contact, near and far, ``(n, 2, W, W)``.

    ``reached (n, W, W)`` are height maps [m], with ``inner`` pixels along the edge of the pad in their middle.
    """
    margin = (reached.shape[-1] - inner) // 2
    middle = slice(margin, margin + inner)
    first = reached[:, middle, middle].max(axis=(1, 2))
    first = np.where(np.isfinite(first), first, reached.max(axis=(1, 2)))
    first = np.where(np.isfinite(first), first, 0.0)[:, None, None]
    gap = np.clip(np.where(np.isfinite(reached), first - reached, 0.02), -0.006, 0.008).astype(np.float32)
    return np.stack([gap / 0.004, np.exp(-np.maximum(gap, -0.001) / 0.0006) / 2], axis=1)


def regridded(shares: Floats32, edge: int) -> Floats32:
    """Shares of the cells of one grid, ``(n, m, m)``, in those of another on the same square, ``(n, edge, edge)``."""
    old = shares.shape[-1]
    first, others = np.arange(edge)[:, None] * old, np.arange(old) * edge
    overlap = np.minimum(first + old, others + edge) - np.maximum(first, others)
    part = (np.maximum(overlap, 0) / old).astype(np.float32)
    return part @ shares @ part.T
