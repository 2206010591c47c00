"""Faults: imperfections of a real sensor, applied to the ideal image one after the other.

    scene = Scene(faults=(Gain(0.1), Noise(0.02), DeadTaxels(0.05), Quantisation(bits=4)))

A fault maps an image in [0, 1], in grey or in colour, to an image. The last image is clipped and converted to 8 bits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from numbers import Integral
from typing import Annotated, ClassVar, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from belief.constraints import Checked, NotNegative, Probability, Within
from belief.errors import InvalidArgument

Image = NDArray[np.floating]


class Fault(Protocol):
    """One imperfection of a sensor.

    Attributes:
        isotropic: whether it commutes with quarter turns and mirroring of the image.
    """

    isotropic: ClassVar[bool]

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """The image after this fault, of the same shape; values may leave [0, 1]."""


AnyFault = TypeVar("AnyFault", bound=Fault)


@dataclass(frozen=True)
class Gain(Checked):
    """An amplification drawn for every touch, uniform in 1 ± ``half_range``."""

    isotropic: ClassVar[bool] = True

    half_range: Probability

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        return (1.0 + rng.uniform(-self.half_range, self.half_range)) * image


@dataclass(frozen=True)
class Noise(Checked):
    """Independent Gaussian noise on every taxel; ``std`` is relative to full scale."""

    isotropic: ClassVar[bool] = True

    std: NotNegative

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        return image + self.std * rng.standard_normal(image.shape, dtype=np.float32)


@dataclass(frozen=True)
class DeadTaxels(Checked):
    """Broken taxels, which read zero in every touch.

    Attributes:
        share: fraction of all taxels, rounded to a whole number of taxels.
        seed: determines which taxels are broken.
    """

    isotropic: ClassVar[bool] = False

    share: Probability
    seed: int = 0

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        return _stuck(image, self.share, 0.0, self.seed)


@dataclass(frozen=True)
class StuckTaxels(Checked):
    """Broken taxels, which read the same value in every touch.

    Attributes:
        share: fraction of all taxels, rounded to a whole number of taxels.
        level: what they read, in [0, 1]; 1 is full scale.
        seed: determines which taxels are broken.
    """

    isotropic: ClassVar[bool] = False

    share: Probability
    level: Probability = 1.0
    seed: int = 0

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        return _stuck(image, self.share, self.level, self.seed)


def _stuck(image: Image, share: float, level: float, seed: int) -> Image:
    """The image with a share of its taxels at a level."""
    faulty = image.copy()
    faulty[_broken(share, seed, image.shape[:2])] = level
    return faulty


@lru_cache(maxsize=64)
def _broken(share: float, seed: int, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Whether a taxel of an image of this shape is broken."""
    num_taxels = shape[0] * shape[1]
    broken = np.zeros(num_taxels, bool)
    broken[np.random.default_rng(seed).permutation(num_taxels)[: round(share * num_taxels)]] = True
    return broken.reshape(shape)


@dataclass(frozen=True)
class Quantisation(Checked):
    """An analogue-to-digital converter with ``bits`` bits; every image is converted to 8 bits afterwards."""

    isotropic: ClassVar[bool] = True

    bits: Annotated[int, Within(1, 16)]

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        levels = 2**self.bits - 1
        return np.rint(levels * np.clip(image, 0.0, 1.0)) / levels


@dataclass(frozen=True)
class Hysteresis(Checked):
    """The play operator: a taxel follows a change only beyond ``width``, relative to full scale.

    Every press loads the taxels from zero, so readings are ``width`` too low (Visintin, *Differential Models of
    Hysteresis*, III.2).
    """

    isotropic: ClassVar[bool] = True

    width: NotNegative

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        return np.maximum(image - self.width, 0.0)


@dataclass(frozen=True)
class Shift:
    """A sensor that is mounted beside its place: the image is displaced, and reads zero where it shows nothing.

    Attributes:
        rows, columns: displacement [taxels], towards higher indices; taxels that leave the image are lost.
    """

    isotropic: ClassVar[bool] = False

    rows: int = 0
    columns: int = 0

    def __post_init__(self) -> None:
        for name in ("rows", "columns"):
            if not isinstance(getattr(self, name), Integral):
                raise ValueError(f"{name} must be a whole number of taxels, got {getattr(self, name)!r}")

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        shifted = np.zeros_like(image)
        (to_row, from_row), (to_column, from_column) = map(_displaced, (self.rows, self.columns), image.shape[:2])
        shifted[to_row, to_column] = image[from_row, from_column]
        return shifted


def _displaced(by: int, size: int) -> tuple[slice, slice]:
    """Where the indices of an axis are after a displacement, and where they were."""
    by = max(-size, min(by, size))
    return slice(max(by, 0), size + min(by, 0)), slice(max(-by, 0), size - max(by, 0))


@dataclass(frozen=True)
class Blur(Checked):
    """A soft skin that spreads the pressure over neighbouring taxels, as a Gaussian filter.

    Attributes:
        std: of the filter [taxels].
    """

    isotropic: ClassVar[bool] = True

    std: NotNegative

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        from scipy.ndimage import gaussian_filter

        return np.asarray(gaussian_filter(image, self.std, mode="constant", axes=(0, 1)))


def require_faults(faults: object) -> None:
    """Check that something is a sequence of faults."""
    if not isinstance(faults, Sequence):
        raise InvalidArgument(f"faults must be a tuple such as (Gain(0.1), Noise(0.02)), got {faults!r}")
    for fault in faults:
        if isinstance(fault, type) or not callable(fault) or not isinstance(getattr(fault, "isotropic", None), bool):
            raise InvalidArgument(
                f"{fault!r} is no fault: a fault is an object that is called with an image and a generator, and has "
                "the attribute isotropic: whether it commutes with quarter turns and mirroring"
            )


def faults_of(kind: type[AnyFault], faults: Sequence[Fault]) -> list[AnyFault]:
    """The faults of one kind."""
    return [fault for fault in faults if isinstance(fault, kind)]


def change_faults(
    kind: type[AnyFault], faults: Sequence[Fault], change: Callable[[AnyFault], Fault]
) -> tuple[Fault, ...]:
    """All faults, those of one kind changed."""
    return tuple(change(fault) if isinstance(fault, kind) else fault for fault in faults)


def read_out(image: Image, faults: Sequence[Fault], rng: np.random.Generator) -> NDArray[np.uint8]:
    """The sensor's reading of an image: all faults in turn, then clipping to [0, 1] and 8 bits.

    The image itself stays as it is.

    Raises:
        InvalidArgument: a fault gives an image of another shape.
        ValueError: the image contains NaN.
    """
    ideal = image
    image = image.copy() if faults else image  # a user's fault may write into it
    for fault in faults:
        image = fault(image, rng)
        if np.shape(image) != ideal.shape:
            raise InvalidArgument(f"{fault!r} gave an image of shape {np.shape(image)} from one of shape {ideal.shape}")
    image = np.clip(image, 0.0, 1.0)
    if np.isnan(image.min()):
        raise ValueError(
            f"cannot read out an image with NaN, first in taxel {np.argwhere(np.isnan(image))[0].tolist()}"
        )
    image *= 255.0
    return np.rint(image, out=image).astype(np.uint8)
