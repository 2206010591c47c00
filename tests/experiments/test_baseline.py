import numpy as np

from activetouch.dataset import TouchSet
from experiments.baseline import depth_and_force_accuracy


def touches(forces, depths, shapes):
    n = len(shapes)
    return TouchSet(
        np.zeros((n, 1, 1), np.uint8),
        np.asarray(shapes),
        np.arange(n),
        np.zeros(n, int),
        np.asarray(forces, float),
        np.asarray(depths, float),
    )


def test_depths_that_differ_by_shape_give_it_away(rng):
    shapes = np.arange(400) % 2
    known, test = (touches(rng.uniform(1, 3, 400), 1e-3 * (1 + shapes), shapes) for _ in range(2))
    assert depth_and_force_accuracy(known, test) == 1.0


def test_depths_that_ignore_the_shape_give_nothing_away(rng):
    # 2 000 guesses among four: .25 plus or minus .05 holds but with probability 1e-6.
    shapes = np.arange(2000) % 4
    known, test = (touches(rng.uniform(1, 3, 2000), rng.uniform(0, 1e-3, 2000), shapes) for _ in range(2))
    assert abs(depth_and_force_accuracy(known, test) - 0.25) < 0.05
