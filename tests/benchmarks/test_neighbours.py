"""Nearest touches vote on the shape, in whatever order they come."""

import numpy as np

from benchmarks.neighbours import neighbour_guesses


def test_all_that_bottomed_out_vote_in_whatever_order_they_come():
    # Nine touches of one depth, five of them of shape 1, and three neighbours to ask: an excerpt could be all zeros.
    known, shapes = np.full((9, 1), 3e-3), np.array([0, 0, 0, 0, 1, 1, 1, 1, 1])
    for order in (slice(None), slice(None, None, -1)):
        assert neighbour_guesses(known, shapes[order], np.full((2, 1), 3e-3), num_neighbours=3).tolist() == [1, 1]
