"""Nearest touches vote on the shape, in whatever order they come."""

import numpy as np

from benchmarks.neighbours import neighbour_guesses


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
