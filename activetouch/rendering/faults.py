"""Imperfections of a real sensor, applied to the ideal image one after the other.

    scene = Scene(faults=(Gain(0.1), Noise(0.02), DeadTaxels(0.05), Quantisation(bits=4)))

Every part takes an image in [0, 1], in grey or in colour, and a generator, and gives an image back. What comes out of
the last one is saturated and converted to 8 bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import UnknownLikelihood

Image = NDArray[np.floating]


class Fault(Protocol):
    """One imperfection of a sensor.

    Attributes:
        isotropic: whether it treats a turned or mirrored image as it treats the original.
    """

    isotropic: ClassVar[bool]

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """The image as this sensor gives it, of the same shape; values may leave [0, 1]."""


@dataclass(frozen=True)
class Gain:
    """An uncertain amplification, drawn anew for every touch: at most ``half_range`` off, relative."""

    isotropic: ClassVar[bool] = True

    half_range: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.half_range <= 1.0:
            raise ValueError(f"half_range must be in [0, 1], got {self.half_range}")

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        return (1.0 + rng.uniform(-self.half_range, self.half_range)) * image


@dataclass(frozen=True)
class Noise:
    """Independent Gaussian noise on every taxel, ``std`` relative to full scale."""

    isotropic: ClassVar[bool] = True

    std: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.std < np.inf:
            raise ValueError(f"std must be finite and ≥ 0, got {self.std}")

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        return image + self.std * rng.standard_normal(image.shape, dtype=np.float32)


@dataclass(frozen=True)
class DeadTaxels:
    """Taxels that always read zero: the same ones in every touch, because they are broken.

    Attributes:
        share: of all taxels, rounded to a whole number of them.
        seed: which specimen of the sensor; decides which taxels.
    """

    isotropic: ClassVar[bool] = False

    share: float
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 <= self.share <= 1.0:
            raise ValueError(f"share must be in [0, 1], got {self.share}")

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        num_taxels = image.shape[0] * image.shape[1]
        order = np.random.default_rng(self.seed).permutation(num_taxels)
        dead = np.zeros(num_taxels, bool)
        dead[order[: round(self.share * num_taxels)]] = True
        faulty = image.copy()
        faulty[dead.reshape(image.shape[:2])] = 0.0
        return faulty


@dataclass(frozen=True)
class Quantisation:
    """A converter with ``bits`` bits; every image is converted to 8 bits afterwards in any case."""

    isotropic: ClassVar[bool] = True

    bits: int

    def __post_init__(self) -> None:
        if not 1 <= self.bits <= 16:
            raise ValueError(f"bits must be in [1, 16], got {self.bits}")

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        levels = 2**self.bits - 1
        return np.rint(levels * np.clip(image, 0.0, 1.0)) / levels


@dataclass(frozen=True)
class Hysteresis:
    """Backlash: a taxel follows a change only after it has exceeded ``width`` (relative to full scale).

    This is the play operator, started from a released pad: every press loads the taxels from zero, so what is loaded
    reads ``width`` too little and light pressure goes unnoticed (Visintin, *Differential Models of Hysteresis*, III.2).
    """

    isotropic: ClassVar[bool] = True

    width: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.width < np.inf:
            raise ValueError(f"width must be finite and ≥ 0, got {self.width}")

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        return np.maximum(image - self.width, 0.0)


def split_at_noise(faults: Sequence[Fault]) -> tuple[Sequence[Fault], Sequence[Fault]]:
    """The faults before the first :class:`Noise`, and that one with all after it; all faults and none without noise."""
    first = next((n for n, fault in enumerate(faults) if isinstance(fault, Noise)), len(faults))
    return faults[:first], faults[first:]


def gain_and_noise(faults: Sequence[Fault]) -> tuple[float, float, Sequence[Fault]]:
    """The statistics of a sensor that amplifies by at most one uncertain gain and then adds noise.

    Args:
        faults: of the sensor, in turn.

    Returns:
        Half range of the gain, 0 without one; standard deviation of the noise; and the faults after the noise.

    Raises:
        UnknownLikelihood: there is no noise, or something other than one gain before it.
    """
    before, after = split_at_noise(faults)
    match before, after[:1]:
        case [], [Noise(std=std)] if std > 0.0:
            return 0.0, std, after[1:]
        case [Gain(half_range=gain)], [Noise(std=std)] if std > 0.0:
            return gain, std, after[1:]
    raise UnknownLikelihood(f"the distribution of readings is known for a Gain at most, then Noise; got {faults}")


def live_taxels(faults: Sequence[Fault], edge: int) -> NDArray[np.bool_]:
    """Which taxels of a square image still read anything, ``(edge, edge)``.

    Args:
        faults: nothing but :class:`DeadTaxels`.
        edge: taxels along an edge.

    Raises:
        UnknownLikelihood: there are other faults.
    """
    live = np.ones((edge, edge), bool)
    for fault in faults:
        if not isinstance(fault, DeadTaxels):
            raise UnknownLikelihood(
                f"the probability of a reading is known up to DeadTaxels after the noise; got {fault}"
            )
        live &= fault(np.ones((edge, edge)), np.random.default_rng(0)) > 0.0
    return live


def rescaled_noise(faults: Sequence[Fault], factor: float) -> tuple[Fault, ...]:
    """The faults with the standard deviation of all noise multiplied by ``factor``."""
    return tuple(replace(f, std=f.std * factor) if isinstance(f, Noise) else f for f in faults)


def read_out(image: Image, faults: Sequence[Fault], rng: np.random.Generator) -> NDArray[np.uint8]:
    """The sensor's reading of an image: all faults in turn, then saturation and 8 bits."""
    for fault in faults:
        image = fault(image, rng)
    image = np.clip(image, 0.0, 1.0)
    if np.isnan(image.min()):
        raise ValueError(
            f"an image of NaN cannot be read out; taxels {np.argwhere(np.isnan(image))[0].tolist()} and on"
        )
    image *= 255.0
    return np.rint(image, out=image).astype(np.uint8)
