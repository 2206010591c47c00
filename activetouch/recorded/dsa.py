"""Files of the pressure sensors of a Schunk SDH-2 hand: bzip2 of XML, one matrix of pressures for each pad and frame.

The numbers of a frame are hexadecimal single-precision floats, in which −n stands for n zeros.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

import numpy as np

from activetouch.errors import BadRecording
from activetouch.recorded.bounded import read_bounded
from belief.files import plain_number
from belief.frozen import FrozenArrays
from belief.problem import Floats

_MOST_BYTES = 16 * 2**20
_MOST_CELLS, _MOST_FRAMES, _MOST_NUMBERS = 4096, 10_000, 5_000_000


@dataclass(frozen=True, eq=False)
class PressureFilm(FrozenArrays):
    """The pressures of all pads over time.

    Attributes:
        shapes: rows and columns of each pad.
        frames: pressures of all pads, one after the other, ``(T, cells)``.
    """

    shapes: tuple[tuple[int, int], ...]
    frames: Floats

    def pads(self, frame: Floats) -> list[Floats]:
        """A frame ``(cells,)`` as one image for each pad."""
        ends = np.cumsum([rows * columns for rows, columns in self.shapes])[:-1]
        return [part.reshape(shape) for part, shape in zip(np.split(frame, ends), self.shapes, strict=True)]


def read_dsa(path: Path) -> PressureFilm:
    """The pressures in a ``.dsa`` file. Joint angles are not read.

    Raises:
        BadRecording: the file is not such a file, declares a document type or entities, or is too large.
    """
    collected = _Collected()
    parser = expat.ParserCreate()
    parser.StartElementHandler = collected.start
    parser.EndElementHandler = collected.end
    parser.CharacterDataHandler = collected.text
    parser.StartDoctypeDeclHandler = _refuse
    parser.EntityDeclHandler = _refuse
    try:
        parser.Parse(read_bounded(path, _MOST_BYTES), True)
        return collected.film()
    except expat.ExpatError as error:
        raise BadRecording(f"{path} is not XML: {error}") from error
    except ValueError as error:
        raise BadRecording(f"{path} is not a recording of pressures: {error}") from error


def _refuse(*_: object) -> None:
    raise ValueError("it declares a document type or entities, which such files have no use for")


class _Collected:
    """What the parser met so far."""

    def __init__(self) -> None:
        self.cells: dict[str, list[int]] = {"cells_y": [], "cells_x": []}
        self.frames: list[Floats] = []
        self.parts: list[str] | None = None

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self.parts = [] if name in (*self.cells, "frame_data") else None

    def text(self, data: str) -> None:
        if self.parts is not None:
            self.parts.append(data)

    def end(self, name: str) -> None:
        if self.parts is None:
            return
        content, self.parts = "".join(self.parts), None
        if name in self.cells:
            number = plain_number(content.strip())
            if not (number.is_integer() and 0 < number <= _MOST_CELLS):
                raise ValueError(f"{name} must be a whole number from 1 to {_MOST_CELLS}, got {content[:40]!r}")
            self.cells[name].append(int(number))
        else:
            self.frames.append(_decoded(content, self.size))
            if len(self.frames) > _MOST_FRAMES or len(self.frames) * self.size > _MOST_NUMBERS:
                raise ValueError(f"more than {_MOST_FRAMES} frames or {_MOST_NUMBERS} pressures")

    @property
    def shapes(self) -> tuple[tuple[int, int], ...]:
        return tuple(zip(self.cells["cells_y"], self.cells["cells_x"], strict=True))

    @property
    def size(self) -> int:
        shapes = self.shapes
        size = sum(rows * columns for rows, columns in shapes)
        if not shapes or min(map(min, shapes)) < 1 or size > _MOST_CELLS:
            raise ValueError(f"it must have pads with 1 to {_MOST_CELLS} cells before its frames, got {shapes[:8]}")
        return size

    def film(self) -> PressureFilm:
        if not self.frames:
            raise ValueError("it has no frame")
        return PressureFilm(self.shapes, np.array(self.frames))


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
