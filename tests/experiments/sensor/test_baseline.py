from dataclasses import replace

import numpy as np

from activetouch.data.dataset import TouchSet
from experiments.sensor.baseline import (
    averaged,
    depth_and_force_accuracy,
    nearest_image_guesses,
    neighbour_guesses,
)


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


def test_all_that_bottomed_out_vote_in_whatever_order_they_come():
    # Nine touches of one depth, five of them of shape 1, and three neighbours to ask: an excerpt could be all zeros.
    known, shapes = np.full((9, 1), 3e-3), np.array([0, 0, 0, 0, 1, 1, 1, 1, 1])
    for order in (slice(None), slice(None, None, -1)):
        assert neighbour_guesses(known, shapes[order], np.full((2, 1), 3e-3), num_neighbours=3).tolist() == [1, 1]


def test_nearer_touches_vote_and_farther_ones_do_not():
    known = np.array([[0.0], [0.1], [0.2], [5.0], [5.1], [5.2], [5.3]])
    guesses = neighbour_guesses(known, np.array([0, 0, 0, 1, 1, 1, 1]), np.array([[0.1], [5.1]]), num_neighbours=3)
    assert guesses.tolist() == [0, 1]


def test_the_farthest_of_those_asked_votes_too():
    known, shapes = np.array([[0.0], [0.1], [0.2], [9.0]]), np.array([0, 1, 1, 0])
    assert neighbour_guesses(known, shapes, np.array([[0.0]]), num_neighbours=3).tolist() == [1]


def test_images_are_averaged_in_blocks_and_left_alone_where_they_do_not_divide(rng):
    images = rng.integers(256, size=(3, 8, 8), dtype=np.uint8)
    small = averaged(images, 4)
    assert small.dtype == np.uint8
    assert small[1, 2, 3] == np.rint(images[1, 4:6, 6:8].mean())
    np.testing.assert_array_equal(averaged(np.stack([images] * 3, axis=-1), 4), np.stack([small] * 3, axis=-1))
    for size in (8, 16, 3):
        assert averaged(images, size) is images


def test_the_nearest_image_is_a_near_copy_where_there_is_one(rng):
    images = rng.integers(0, 255, (6, 64, 64)).astype(np.uint8)
    known = TouchSet(images, np.arange(6), np.arange(6), np.zeros(6, int), np.ones(6), np.ones(6))
    noisy = replace(
        known, images=np.clip(images.astype(int) + rng.integers(-9, 9, images.shape), 0, 255).astype(np.uint8)
    )
    assert nearest_image_guesses(known, noisy).tolist() == [0, 1, 2, 3, 4, 5]
