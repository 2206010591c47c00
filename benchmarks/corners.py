"""What no policy can beat in ``keyed``: touches to find the cut corner of a cube, or to know that there is none.

The orientation is revealed up to the symmetries of a cube, and so is the size: all but which corner is cut. Touches are
free of noise. With more knowledge and better touches no policy needs more of them, so the optimal policy of this easier
problem is a lower bound for every policy (an information relaxation). A touch shows some of the eight corners, and the
optimal policy follows by dynamic programming over the sets of corners that were not seen yet.

    python -m benchmarks.corners --orientations 100
"""

from __future__ import annotations

import argparse
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from activetouch import SCENES
from activetouch.distributions import Constant
from activetouch.placement import Placement
from activetouch.poses import random_orientation
from activetouch.shapes import Box, Cut, Shape

_SEEN = 0.02  # difference of a pixel that counts as seen, the standard deviation of the noise


def visible(rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which corners each place shows of a cube of random size in a random orientation, ``(26, 8)``."""
    scene = SCENES["keyed"].scene
    cube, cut = scene.solids["cube"], scene.solids["cube_cut"]
    assert isinstance(cube, Box)
    assert isinstance(cut, Cut)
    distance = cut.planes[0][3]
    corners = [Cut(cube, ((x, y, z, distance),)) for x, y, z in product((-1.0, 1.0), repeat=3)]
    rest, size = random_orientation(rng), scene.variation.size.sample(rng)
    found = np.zeros((len(scene.poses), len(corners)), bool)
    for number, pose in enumerate(scene.rotations.values()):
        shown = scene.presentation.shown(rest, pose, rng)
        offset, force = scene.variation.sample_offset(rng), Constant(2.25).sample(rng)

        solids: list[Shape] = [cube, *corners]
        placed = [Placement(shape, size, shown, offset) for shape in solids]
        whole, *others = (scene.image(scene.press_model.press(scene.setup, one, force)) for one in placed)
        found[number] = [np.abs(other - whole).max() > _SEEN for other in others]
    return found


def touches_needed(shows: NDArray[np.bool_]) -> tuple[float, float]:
    """Mean number of touches to find a corner that is cut, and number to know that none is, with the best policies."""
    sets = {sum(1 << int(corner) for corner in np.flatnonzero(row)) for row in shows}

    @cache
    def to_find(left: int) -> float:
        """Expected touches, each unseen corner being equally likely the cut one; infinite if one cannot be seen."""
        best = np.inf
        for some in sets:
            if some & left:
                share = (left & ~some).bit_count() / left.bit_count()
                best = min(best, 1.0 + (share * to_find(left & ~some) if share else 0.0))
        return best

    @cache
    def to_clear(left: int) -> float:
        if not left:
            return 0
        return min((1 + to_clear(left & ~some) for some in sets if some & left), default=np.inf)

    everything = (1 << shows.shape[1]) - 1
    return to_find(everything), to_clear(everything)


def main() -> None:
    """Print both bounds, means over orientations with 95 % intervals."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--orientations", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    shown = [visible(rng) for _ in range(arguments.orientations)]
    needed = np.array([touches_needed(some) for some in shown])
    print(f"a place shows {np.mean(shown):.3f} of the corners")
    for name, column in zip(("to find the cut corner", "to know that no corner is cut"), needed.T, strict=True):
        error = 1.96 * column.std(ddof=1) / np.sqrt(len(column))
        print(f"{name}: at least {column.mean():.2f} ± {error:.2f} touches, {column.min():.0f} to {column.max():.0f}")


if __name__ == "__main__":
    main()
