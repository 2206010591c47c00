"""Predicted contacts: height maps of a body in many orientations, as a pad would meet it."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from activetouch.poses import to_matrices
from activetouch.pressing.contact import Pad
from activetouch.solids.raster import heights
from activetouch.solids.solid import Floats, Shape
from belief.constraints import Within, check
from belief.errors import InvalidArgument

_VAST = 1e6  # offset [m] or scale


@dataclass(frozen=True)
class Window:
    """A square seen along the approach axis, centred on it.

    Attributes:
        edge: of the square [m].
        num_pixels: along an edge.
    """

    edge: Annotated[float, Within(1e-5, 10.0, unit=" m")]
    num_pixels: Annotated[int, Within(1, 10_000)]

    def __post_init__(self) -> None:
        check(self)

    @classmethod
    def of(cls, pad: Pad, margin: float = 0.0, num_pixels: int | None = None) -> Window:
        """The window of a pad, wider by a margin on each side, in whole pixels.

        Args:
            pad: in the middle of the window.
            margin: at least this much on each side [m], such as the largest offset of an object.
            num_pixels: along the edge of the pad; as many as it has taxels by default.

        >>> Window.of(Pad(half_width=0.015), margin=0.002, num_pixels=32)
        Window(edge=0.035625, num_pixels=38)
        """
        inside = pad.num_taxels if num_pixels is None else num_pixels
        pixel = 2 * pad.half_width / inside
        total = inside + 2 * ceil(margin / pixel - 1e-9)
        return cls(total * pixel, total)

    @property
    def centres(self) -> Floats:
        """Of the pixels along one axis [m], ``(num_pixels,)``."""
        return ((np.arange(self.num_pixels) + 0.5) / self.num_pixels - 0.5) * self.edge


def predicted_contacts(
    body: Shape,
    rotations: ArrayLike,
    offsets: ArrayLike,
    window: Window,
    scales: ArrayLike = 1.0,
    dtype: DTypeLike = np.float64,
) -> NDArray[np.floating]:
    """Height maps of a body: how far its surface reaches towards the pad, seen from the pad.

    The gap of a press, :attr:`activetouch.pressing.contact.Contact.gap`, is ``heights.max() - heights``.

    Args:
        body: a solid or a mesh.
        rotations: unit quaternions ``wxyz``, object to pad frame, ``(n, 4)``.
        offsets: of the body's centre from the window's, along y and z [m], ``(n, 2)`` or ``(2,)``.
        window: what is seen.
        scales: size factors of the body, ``(n,)`` or one number.
        dtype: of the result.

    Returns:
        Height of the surface above the body's centre [m], ``(n, num_pixels, num_pixels)``, rows along z, columns along
        y; ``-inf`` beside the body.

    Raises:
        InvalidArgument: the arrays do not fit together, a number is out of range, a rotation is no unit
            quaternion, or ``dtype`` is not of floats.

    >>> from activetouch import SHAPES
    >>> maps = predicted_contacts(SHAPES["cube"], [[1, 0, 0, 0]], [0.0, 0.0], Window(0.05, 5))
    >>> maps[0, 2]
    array([ -inf, 0.016, 0.016, 0.016,  -inf])
    """
    turns, places, sizes = _checked(rotations, offsets, scales)
    if not np.issubdtype(dtype, np.floating):
        raise InvalidArgument(f"dtype must be of floats, as heights are infinite beside the body; got {dtype!r}")
    matrices, num = to_matrices(turns), window.num_pixels
    return heights(body.surface, matrices * sizes[:, None, None], places, window.edge / num, num, dtype)


def _checked(rotations: ArrayLike, offsets: ArrayLike, scales: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Arrays ``(n, 4)``, ``(n, 2)`` and ``(n,)``; see ``predicted_contacts``."""
    try:
        turns, places, sizes = (np.asarray(given, float) for given in (rotations, offsets, scales))
    except (TypeError, ValueError) as error:
        raise InvalidArgument(f"rotations, offsets and scales must be numbers: {error}") from error
    turns = turns.reshape(0, 4) if turns.size == 0 else turns
    num = len(turns) if turns.ndim else 0
    if turns.shape != (num, 4) or places.shape not in ((num, 2), (2,)) or sizes.shape not in ((num,), ()):
        raise InvalidArgument(
            "rotations must be (n, 4), offsets (n, 2) or (2,), scales (n,) or one number; got the shapes "
            f"{turns.shape}, {places.shape} and {sizes.shape}"
        )
    if not ((np.abs(places) < _VAST).all() and ((sizes > 1 / _VAST) & (sizes < _VAST)).all()):
        raise InvalidArgument(
            f"offsets must be finite, up to {_VAST:g} m, and scales above zero, from {1 / _VAST:g} to {_VAST:g}"
        )
    if not (np.abs(np.linalg.norm(turns, axis=1) - 1.0) < 1e-3).all():
        raise InvalidArgument("every rotation must be a unit quaternion wxyz; divide each by its norm")
    return turns, np.broadcast_to(places, (num, 2)), np.broadcast_to(sizes, num)
