from dataclasses import replace

import numpy as np
import pytest

from activetouch.data.dataset import TouchSet
from experiments.sensor.baseline import (
    averaged,
    cross_fitted_guesses,
    depth_and_force_accuracy,
    nearest_image_guesses,
    neighbour_guesses,
    share_by_object,
    shares_without_image,
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


def test_objects_are_guessed_in_folds_of_equal_size(monkeypatch, rng):
    asked = []
    monkeypatch.setattr(
        "experiments.sensor.baseline.neighbour_guesses",
        lambda known, known_shapes, test, num: asked.append((len(known), len(test), num)) or test[:, 0].astype(int),
    )
    ids = np.repeat(np.arange(10), 3)
    guesses = cross_fitted_guesses(ids[:, None].astype(float), ids % 2, ids)
    assert asked == [(24, 6, 4)] * 5  # two objects of ten, by the votes of √24
    assert guesses.tolist() == ids.tolist()


def test_nobody_is_asked_about_their_own_touches(rng):
    # Each object has a number of its own, which its own touches would give away; others know nothing of its shape.
    # By Hoeffding each of five folds of 80 objects has .8 right with probability 6e-7 at most.
    shapes = np.repeat(rng.integers(2, size=400), 6)
    object_ids = np.repeat(np.arange(400), 6)
    guesses = cross_fitted_guesses(rng.permutation(400)[object_ids, None].astype(float), shapes, object_ids)
    assert np.mean(guesses == shapes) < 0.8


def test_one_object_cannot_be_guessed_from_others():
    with pytest.raises(ValueError, match="at least two objects"):
        cross_fitted_guesses(np.zeros((3, 1)), np.zeros(3, int), np.zeros(3, int))


def test_shares_are_counted_by_object():
    right = np.array([True, False, True, True, False, False])
    np.testing.assert_array_equal(share_by_object(right, np.array([7, 7, 3, 3, 3, 9])), [2 / 3, 0.5, 0.0])


def test_what_only_the_depth_tells_is_not_told_by_the_force(rng):
    # 600 objects among four: .25 plus or minus .1 holds but with probability 1e-7.
    shapes, object_ids = np.arange(600) % 4, np.arange(600)
    numbers = np.column_stack([rng.uniform(1, 3, 600), 1e-3 * shapes])
    shares = shares_without_image(numbers, shapes, object_ids)
    assert abs(shares["force"].mean() - 0.25) < 0.1
    assert shares["depth"].mean() == shares["force and depth"].mean() == 1.0


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
