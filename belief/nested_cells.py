"""Cells of several levels: each cell of a level is divided into equally many cells of the next."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from belief.validation import Floats

Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class NestedCells:
    """Cells of several levels, from coarse to fine.

    Attributes:
        shares: prior probability of each cell of each level, ``(N_l,)``. The parts of a cell share its probability.
    """

    shares: tuple[Floats, ...]

    def __post_init__(self) -> None:
        for coarse, fine in pairwise(self.shares):
            if len(coarse) == 0 or len(fine) % len(coarse):
                raise ValueError(f"{len(fine)} cells are no division of {len(coarse)} cells")
            if not np.allclose(fine.reshape(len(coarse), -1).sum(axis=1), coarse, atol=1e-9):
                raise ValueError("the parts of a cell must share its probability")
        if not self.shares or not np.isclose(self.shares[0].sum(), 1.0) or min(map(np.min, self.shares)) <= 0.0:
            raise ValueError("the cells of a level must have positive probabilities that sum to 1")

    @cached_property
    def log_shares(self) -> tuple[Floats, ...]:
        """Logarithms of the shares."""
        return tuple(np.log(each) for each in self.shares)

    def parts(self, level: int, parents: Ints) -> Ints:
        """The parts of cells of level - 1, ``(m, F)``."""
        number = len(self.shares[level]) // len(self.shares[level - 1])
        return parents[:, None] * number + np.arange(number)
