"""What no policy can beat in ``keyed``: touches to find the cut corner of a cube, or to know that there is none.

The orientation is revealed up to the symmetries of a cube, and so is the size: all but which corner is cut. Touches are
free of noise. With more knowledge and better touches no policy needs more of them, so the optimal policy of this easier
problem is a lower bound for every policy (an information relaxation). A touch shows some of the eight corners, and the
optimal policy follows by dynamic programming over the sets of corners that were not seen yet.

Places in random order need more touches. What the optimal policy saves is the most that any choice can save with any
sensor; it depends on how much of the body one touch shows, which the width of the pad changes.

    python -m benchmarks.corners --orientations 60
    python -m benchmarks.corners --orientations 20 --widths 0.5 1 2 --figure runs/corners.png
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from activetouch import SCENES, Scene
from activetouch.distributions import Constant
from activetouch.placement import Placement
from activetouch.poses import random_orientation
from activetouch.shapes import Box, Cut, Shape

_ORDERS = 500  # random orders of each orientation
_SEEN = 0.02  # difference of a pixel that counts as seen, the standard deviation of the noise


def visible(scene: Scene, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which corners each place shows of a cube of random size in a random orientation, ``(26, 8)``."""
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
        whole, *others = (scene.image(scene.press_model.press(scene.pad, one, force)) for one in placed)
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


def touches_at_random(shows: NDArray[np.bool_], rng: np.random.Generator) -> tuple[float, float]:
    """The same of places in random order, none twice: means over orders."""
    turns = np.argsort(rng.random((_ORDERS, len(shows))), axis=1)
    first = np.where(shows.any(axis=0), shows[turns].argmax(axis=1) + 1.0, np.inf)  # (orders, 8)
    return float(first.mean()), float(first.max(axis=1).mean())


def main() -> None:
    """Print both bounds, means over orientations with 95 % intervals."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--orientations", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--widths", type=float, nargs="+", default=[1.0], help="of the pad, relative to the scene's")
    parser.add_argument("--figure", type=Path, help="of the savings by width")
    arguments = parser.parse_args()
    if arguments.figure is not None:
        arguments.figure.parent.mkdir(parents=True, exist_ok=True)
    scene, points = SCENES["keyed"].scene, []
    for width in arguments.widths:
        rng, pad = np.random.default_rng(arguments.seed), scene.pad
        pad = replace(pad, half_width=width * pad.half_width, num_taxels=2 * round(width * pad.num_taxels / 2))
        wide = replace(scene, pad=pad)
        shown = [visible(wide, rng) for _ in range(arguments.orientations)]
        best = np.array([touches_needed(some) for some in shown])
        random = np.array([touches_at_random(some, rng) for some in shown])
        print(f"pad × {width:g}: a place shows {np.mean(shown):.3f} of the corners")
        saved = []
        names = "to find the cut corner", "to know that no corner is cut"
        for name, least, others in zip(names, best.T, random.T, strict=True):
            error = 1.96 * least.std(ddof=1) / np.sqrt(len(least))
            saved.append(1.0 - least.mean() / others.mean())
            print(
                f"  {name}: at least {least.mean():.2f} ± {error:.2f} touches, {least.min():.2f} to {least.max():.2f}; "
                f"in random order {others.mean():.2f}, of which a choice can save {saved[-1]:.0%}"
            )
        points.append((np.mean(shown), *saved))
    if arguments.figure is not None:
        drawn = Figure((6.0, 4.0), layout="constrained")
        axes = drawn.add_subplot(xlabel="corners that one touch shows [%]", ylabel="touches that a choice can save [%]")
        columns = 100 * np.array(sorted(points)).T
        for column, name in zip(columns[1:], names, strict=True):
            axes.plot(columns[0], column, "o-", label=name)
        axes.set_ylim(0, 100)
        axes.grid(alpha=0.3)
        axes.legend()
        drawn.savefig(arguments.figure, dpi=110)


if __name__ == "__main__":
    main()
