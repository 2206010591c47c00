"""Where the taxels of a pad are: places, normals and the area of each.

>>> hand = Taxels.grid(14, 6, 0.0034)
>>> len(hand.centres), round(hand.half_width, 4), hand.raster
(84, 0.0238, 14)
>>> len(Taxels.grid(3, 3, 0.004, mask=["#.#", "###", "#.#"]).centres)
7
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import ceil
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from activetouch.solids.triangles import Floats, Ints, grid_centres
from belief.constraints import Positive, check
from belief.errors import InvalidArgument
from belief.files import array_digest
from belief.frozen import FrozenArrays
from belief.validation import are_finite

MOST_TAXELS = 16_384
"""Largest number of taxels of a pad."""
_REACH = 0.58  # of the pitch, from a taxel along y and z: half the diagonal of a hexagon
_STEEPEST = 0.25  # least part of a normal along the approach axis
_FEWEST, _USUAL, _FINEST = 12, 32, 256  # pixels along the edge of a raster
_SIGNS = ".#"  # of a mask: no taxel, and a taxel
_FINE = 2  # pixels for a pitch, where taxels lie on no grid of pixels


@dataclass(frozen=True, eq=False)
class Taxels(FrozenArrays):
    """The layout of a pad, in its frame: x points to the object, rows run along z, columns along y.

    The pad is covered by an elastic layer, which ends a little more than half a pitch beside the last taxels.

    Attributes:
        centres: of the N taxels, ``(N, 3)`` [m]; the foremost should have x = 0.
        normals: directions in which they feel, ``(N, 3)``, of any length; along x where the pad is flat.
        area: of each [m²].

    Raises:
        InvalidArgument: shapes that do not fit, a number out of range, two taxels in one place, or a normal that is
            turned by more than 75° from the approach axis.
    """

    centres: Floats
    normals: Floats
    area: Positive

    def __post_init__(self) -> None:
        check(self)
        try:
            self.to_floats("centres", "normals")
        except ValueError as error:
            raise InvalidArgument(f"taxels: {error}") from error
        number = len(self.centres)
        if not 1 <= number <= MOST_TAXELS or {self.centres.shape, self.normals.shape} != {(number, 3)}:
            raise InvalidArgument(
                f"centres and normals must have the shape (N, 3), with 1 to {MOST_TAXELS} taxels, got "
                f"{self.centres.shape} and {self.normals.shape}"
            )
        lengths = np.linalg.norm(self.normals, axis=1, keepdims=True)
        if not (self.normals[:, :1] >= _STEEPEST * np.maximum(lengths, 1e-300)).all():
            raise InvalidArgument("a normal must point to the object: turned by at most 75° from the approach axis, x")
        object.__setattr__(self, "normals", self.normals / lengths)
        if number > 1 and self.pitch < 1e-6:
            raise InvalidArgument("two taxels lie in one place, or behind each other")
        self.freeze()

    @classmethod
    def grid(cls, rows: int, columns: int, pitch: float, mask: Sequence[str] | ArrayLike | None = None) -> Taxels:
        """A flat grid about the approach axis.

        Args:
            rows: number of taxels along z.
            columns: number of taxels along y.
            pitch: distance of neighbours [m].
            mask: which places have a taxel, ``(rows, columns)``; or a text for each row, in which ``#`` is a taxel.
                All by default.

        Raises:
            InvalidArgument: a number is out of range, or the mask has another shape or no taxel.

        >>> Taxels.grid(1, 2, 0.01).centres.tolist()
        [[0.0, -0.005, 0.0], [0.0, 0.005, 0.0]]
        """
        is_whole = isinstance(rows, Integral) and isinstance(columns, Integral) and are_finite(pitch)
        if not (is_whole and rows >= 1 and columns >= 1 and rows * columns <= MOST_TAXELS and pitch > 0.0):
            raise InvalidArgument(
                f"a grid has at least one row and column, at most {MOST_TAXELS} taxels and a positive pitch, got "
                f"{rows} × {columns} and {pitch}"
            )
        centres = grid_centres(rows, columns, pitch).T
        if mask is not None:
            there = _places(mask)
            if there.shape != (rows, columns) or not there.any():
                raise InvalidArgument(f"a mask must have {rows} rows of {columns} places, # or ., and at least one #")
            centres = centres[there.ravel()]
        return cls(centres, np.tile([1.0, 0.0, 0.0], (len(centres), 1)), pitch**2)

    def __len__(self) -> int:
        return len(self.centres)

    @cached_property
    def digest(self) -> str:
        """Digest of the layout, to a nanometre, as files have it."""
        centres, normals = self.centres.round(9) + 0.0, self.normals.round(6) + 0.0
        return array_digest({"centres": centres, "normals": normals, "area": np.array(float(f"{self.area:.6g}"))})

    def __eq__(self, other: object) -> bool:
        return self.digest == other.digest if isinstance(other, Taxels) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.digest)

    @cached_property
    def pitch(self) -> float:
        """Median distance of a taxel from the nearest other one, seen along x [m]."""
        if len(self) == 1:
            return float(np.sqrt(self.area))
        from scipy.spatial import cKDTree  # pads of grids that are not described do not need it

        places = self.centres[:, 1:]
        return float(np.median(cKDTree(places).query(places, k=[2])[0]))

    @property
    def half_width(self) -> float:
        """Half the edge of the smallest square about the approach axis that has the pad inside [m]."""
        return float(np.abs(self.centres[:, 1:]).max() + self.pitch / 2)

    @cached_property
    def raster(self) -> int:
        """Pixels along the edge of the square in which images show the pad; each taxel has at least one."""
        across = max(1, round(2 * self.half_width / self.pitch))
        step = across if across <= _USUAL else _USUAL
        pixels = step * ceil(max(_FEWEST, across) / step)
        while True:
            counts = np.bincount(owners(self, pixels), minlength=len(self) + 1)[: len(self)]
            if counts.min() == counts.max() or (counts.min() > 0 and pixels >= _FINE * across):
                return pixels
            pixels += step
            if pixels > _FINEST:
                raise InvalidArgument(
                    f"taxels are too close to each other for images of {_FINEST} × {_FINEST} pixels: some lie in one "
                    "pixel, or behind each other"
                )

    def shown(self, values: NDArray[np.floating], pixels: int | None = None) -> NDArray[np.floating]:
        """Values of the taxels ``(..., N)`` as images ``(..., m, m)``, 0 beside them; m = ``pixels`` or the raster."""
        pixels = self.raster if pixels is None else pixels
        padded = np.concatenate([values, np.zeros_like(values[..., :1])], axis=-1)
        return padded[..., owners(self, pixels)].reshape(*values.shape[:-1], pixels, pixels)

    def mean(self, maps: NDArray[np.floating]) -> NDArray[np.floating]:
        """Means over the part of each taxel of maps over the square, ``(..., m, m)``: ``(..., N)``."""
        owner, numbers = _parts(self, maps.shape[-1])
        flat = maps.reshape(*maps.shape[:-2], -1)[..., owner[0]]
        return np.add.reduceat(flat, owner[1], axis=-1) / numbers

    def face(self, pixels: int) -> Floats:
        """How far the layer reaches along x over the pixels of the square ``(m, m)`` [m]; ``-inf`` beside the pad."""
        return _face(self, pixels).copy()


def _places(mask: Any) -> NDArray[np.bool_]:
    """Which places of a grid have a taxel; empty for something that is no mask."""
    with suppress(TypeError, ValueError):
        if all(isinstance(line, str) for line in mask):
            mask = [[_SIGNS.index(sign) for sign in line] for line in mask]
        given = np.asarray(mask)
        if np.isin(given, (0, 1)).all():
            return given.astype(bool)
    return np.zeros(0, bool)


@lru_cache(maxsize=64)
def owners(taxels: Taxels, pixels: int) -> Ints:
    """The taxel to which each pixel of the square belongs, ``(m²,)``; N beside the pad."""
    from scipy.spatial import cKDTree

    places = grid_centres(pixels, pixels, 2 * taxels.half_width / pixels)[1:].T
    nearest = cKDTree(taxels.centres[:, 1:]).query(places)[1]
    away = np.abs(places - taxels.centres[nearest, 1:]).max(axis=1)
    found = np.where(away <= _REACH * max(taxels.pitch, np.sqrt(taxels.area)), nearest, len(taxels))
    found.flags.writeable = False
    return found


@lru_cache(maxsize=64)
def _face(taxels: Taxels, pixels: int) -> Floats:
    """See :meth:`Taxels.face`."""
    owner, places = owners(taxels, pixels), grid_centres(pixels, pixels, 2 * taxels.half_width / pixels)
    nearest = np.minimum(owner, len(taxels) - 1)
    centre, normal = taxels.centres[nearest], taxels.normals[nearest]
    slope: Floats = (normal[:, 1:] * (places[1:].T - centre[:, 1:])).sum(axis=1)
    found: Floats = centre[:, 0] - slope / normal[:, 0]
    return np.asarray(np.where(owner < len(taxels), found, -np.inf).reshape(pixels, pixels))


@lru_cache(maxsize=64)
def _parts(taxels: Taxels, pixels: int) -> tuple[tuple[Ints, Ints], Floats]:
    """The pixels of all taxels, one after another, where each begins, and how many each has."""
    owner = owners(taxels, pixels)
    numbers = np.bincount(owner, minlength=len(taxels) + 1)[: len(taxels)]
    if not numbers.all():
        raise InvalidArgument(f"some taxels have no point among {pixels} × {pixels}; take at least {taxels.raster}")
    order = np.argsort(owner, kind="stable")[: numbers.sum()]
    return (order, np.concatenate([[0], np.cumsum(numbers)[:-1]])), numbers.astype(np.float64)
