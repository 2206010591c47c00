"""Counting stars: sums over their places are those of all places, and what is open is soon shown."""

import itertools

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from benchmarks.starstruck import (  # noqa: E402, as torch may be missing
    SIZE,
    STEP,
    WINDOW,
    Player,
    apart,
    arrangements,
    look_ahead,
    squares,
    window,
)


def player():
    """One whose reader has learned nothing."""
    return Player(lambda maps: torch.zeros(len(maps), 1, 24, 24), look_ahead, np.random.default_rng(0))


def nothing(place):
    rows, columns = window(np.asarray(place))
    return np.zeros((rows.stop - rows.start, columns.stop - columns.start), bool)


def test_the_sums_over_places_are_those_of_all_places():
    weights = np.zeros(len(squares()[0]))
    some = np.random.default_rng(0).choice(len(weights), 9, replace=False)
    weights[some] = np.random.default_rng(1).gamma(1.0, size=9)
    sums = []
    for number in (1, 2, 3):
        ways = (
            w
            for w in itertools.combinations(some, number)
            if all(apart()[a, b] for a, b in itertools.combinations(w, 2))
        )
        sums.append(sum(np.prod(weights[list(way)]) for way in ways))
    assert sums[2] > 0.0
    np.testing.assert_allclose(arrangements(weights)[0], sums, rtol=1e-6)


def test_the_probability_of_a_star_adds_to_the_expected_number():
    one = player()
    one.see(np.zeros(2), nothing([0, 0]))
    assert one.star_probs.sum() == pytest.approx(one.probs @ [1, 2, 3])


def test_steps_are_short_and_an_even_plate_is_soon_shown():
    one, seen = player(), np.zeros(len(squares()[0]), bool)
    place = np.array([20.0, -31.0])
    for _ in range(31):
        one.see(place, nothing(place))
        seen |= (np.abs(squares()[0] - place) <= WINDOW / 2 + 3.0).all(axis=1)
        step = one.step()
        assert 0.0 < np.linalg.norm(step) <= STEP + 1e-9
        place = place + step
        assert (np.abs(place) < SIZE / 2).all()
    assert seen.mean() > 0.9
