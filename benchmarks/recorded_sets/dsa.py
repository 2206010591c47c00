"""Files of the pressure sensors of a Schunk SDH-2 hand: bzip2 of XML, one matrix of pressures for each pad and frame.

The numbers of a frame are hexadecimal single-precision floats, in which −n stands for n zeros. Only the elements with
the sizes of the pads and the frames are read, by name; joint angles are not.
"""

from __future__ import annotations

import bz2
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from activetouch.errors import BadRecording
from belief.files import require_regular_file
from belief.frozen import FrozenArrays
from belief.validation import Floats

_MOST_BYTES = 16 * 2**20
_MOST_CELLS, _MOST_FRAMES, _MOST_NUMBERS = 4096, 10_000, 5_000_000


@dataclass(frozen=True, eq=False)
class PressureFilm(FrozenArrays):
    """Pressures of all pads over time, ``frames (T, cells)``; ``shapes`` are rows and columns of the pads in turn."""

    shapes: tuple[tuple[int, int], ...]
    frames: Floats

    def pads(self, frame: Floats) -> list[Floats]:
        """A frame ``(cells,)`` as one image for each pad."""
        ends = np.cumsum([rows * columns for rows, columns in self.shapes])[:-1]
        return [part.reshape(shape) for part, shape in zip(np.split(frame, ends), self.shapes, strict=True)]


def read_dsa(path: Path) -> PressureFilm:
    """The pressures in a ``.dsa`` file; BadRecording for another or too large file, a document type or entities."""
    require_regular_file(path, BadRecording)
    try:
        with bz2.open(path) as file:
            content = file.read(_MOST_BYTES + 1)
    except (OSError, EOFError) as error:
        raise BadRecording(f"{path} cannot be read: {error}") from error
    if len(content) > _MOST_BYTES:
        raise BadRecording(f"{path} holds more than {_MOST_BYTES} bytes when decompressed; such files are not read")
    try:
        return _film(content)
    except ValueError as error:
        raise BadRecording(f"{path} is not a recording of pressures: {error}") from error


def _film(content: bytes) -> PressureFilm:
    if b"<!" in content:
        raise ValueError("it declares a document type or entities, which such files have no use for")
    rows, columns = (
        list(map(int, _elements(content, name, rb"\s{0,9}(\d{1,4})\s{0,9}"))) for name in (b"cells_y", b"cells_x")
    )
    shapes = tuple(zip(rows, columns, strict=True))
    size = sum(height * width for height, width in shapes)
    if not shapes or min(map(min, shapes)) < 1 or size > _MOST_CELLS:
        raise ValueError(f"it must have pads with 1 to {_MOST_CELLS} cells, got {shapes[:8]}")
    frames = _elements(content, b"frame_data", rb"([0-9a-fA-F\s]*)")
    if not 0 < len(frames) <= _MOST_FRAMES or len(frames) * size > _MOST_NUMBERS:
        raise ValueError(f"it must have 1 to {_MOST_FRAMES} frames with {_MOST_NUMBERS} pressures, got {len(frames)}")
    return PressureFilm(shapes, np.array([_decoded(frame.decode(), size) for frame in frames]))


def _elements(content: bytes, name: bytes, pattern: bytes) -> list[bytes]:
    """What a pattern finds in all elements with a name; each must match, in time linear in the size of the file."""
    found = re.findall(rb"<%s>%s</%s>" % (name, pattern, name), content)
    if len(found) != content.count(b"<%s" % name):
        raise ValueError(f"an element {name.decode()} is cut short, or holds something that is not a number")
    return found


def _decoded(content: str, size: int) -> Floats:
    """The pressures of a frame, ``(size,)``."""
    numbers = np.frombuffer(bytes.fromhex("".join(content.split())), ">f4").astype(np.float64)
    if not np.isfinite(numbers).all():
        raise ValueError("a frame holds a number that is not finite")
    lengths = np.where(numbers < 0.0, -numbers, 1.0)
    if (lengths % 1.0).any():
        raise ValueError("a frame holds a number of zeros that is not whole")
    if lengths.sum() != size:
        raise ValueError(f"a frame holds {lengths.sum():g} pressures, the pads have {size} cells")
    return np.repeat(np.maximum(numbers, 0.0), lengths.astype(np.int64))
