"""Counting stars by touch: the belief agrees with an enumeration, and goes where nothing was touched."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.starstruck import AXIS, MOST, REACH, SIZE, apart, arrangements, draws, felt, inform, squares, window


def few(rng, number=9):
    weights = np.zeros(len(squares()[0]))
    weights[rng.choice(len(weights), number, replace=False)] = rng.exponential(size=number)
    return weights


def test_arrangements_are_those_of_an_enumeration_and_draws_come_from_them():
    rng = np.random.default_rng(0)
    weights = few(rng)
    chosen, near = np.flatnonzero(weights), apart()
    sums, pairs = arrangements(weights)
    by_number = []
    for stars in range(1, MOST + 1):
        sets = itertools.combinations(chosen, stars)
        free = [s for s in sets if all(near[pair] for pair in itertools.combinations(s, 2))]
        by_number.append({s: weights[list(s)].prod() for s in free})
    assert sums == pytest.approx([sum(found.values()) for found in by_number], rel=1e-6)
    for found, drawn in zip(by_number, draws(weights, pairs, 4_000, rng), strict=True):
        counts = dict.fromkeys(found, 0)
        for squares_of_one in np.sort(drawn, axis=1).tolist():
            counts[tuple(squares_of_one)] += 1  # a KeyError if two stars overlap
        share = np.array(list(found.values())) / sum(found.values())
        assert np.array(list(counts.values())) / 4_000 == pytest.approx(share, abs=0.03)


def test_it_goes_to_the_half_that_was_not_touched():
    area = squares()[1]
    weights = area[area > 0] * np.where(squares()[0][:, 0] < 0, 1e-6, 1.0)  # no star on the left
    touched = np.zeros((2, SIZE, SIZE), np.float32)
    touched[0, :, AXIS < 0] = 1.0
    player = SimpleNamespace(map=touched, weights=weights, pairs=arrangements(weights)[1], probs=np.full(3, 1 / 3))
    player.place, player.touches, player.aim, player.rng = np.array([-30.0, 0.0]), 8, None, np.random.default_rng(0)
    assert inform(player)[0] >= 0


def test_an_image_lands_in_the_pixels_of_its_place_and_the_plate_is_no_object():
    place = np.array([10.3, -20.7])
    image = np.ones((64, 64, 1), np.float32)
    image[:32, 32:] = 0.0  # an object above and to the right
    seen = {"sensor_pos": np.append(place / REACH, -0.2875).astype(np.float32), "sensor_img": image}
    found, solid = felt(seen)
    rows, columns = window(place)
    assert found == pytest.approx(place, abs=1e-4)
    assert (solid == ((AXIS[rows][:, None] > place[1]) & (AXIS[columns] > place[0]))).all()
    assert not felt(seen | {"sensor_pos": np.append(place / REACH, -0.7875)})[1].any()
