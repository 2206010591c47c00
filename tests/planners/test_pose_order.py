"""The best fixed order: greedy, and kept in a file."""

import numpy as np
import pytest
from scipy.special import logsumexp

from belief.errors import CorruptFile
from planners.probing import ORDER_FILE, NoOrder, greedy_order, read_order, write_order


def test_the_order_takes_what_tells_most_given_the_poses_before(rng):
    # Four shapes: poses 0 and 1 show the first bit, pose 2 the second, pose 3 nothing.
    bits = np.array([[0, 0, 1, 1], [0, 0, 1, 1], [0, 1, 0, 1], [0, 0, 0, 0]])
    shapes = np.arange(40) % 4
    right = bits[:, shapes][:, :, None] == bits[:, None, :]  # (P, S, K)
    logits = np.array([2.0, 1.9, 1.5, 1.0])[:, None, None] * right

    def loss(poses):
        totals = logits[list(poses)].sum(axis=0)
        return float((logsumexp(totals, axis=1) - totals[np.arange(40), shapes]).mean())

    order, losses = greedy_order(4, 4, loss)
    assert order == (0, 2, 1, 3)
    assert (np.diff(losses) <= 1e-6).all()


def test_an_order_is_read_as_written_and_refused_if_changed_or_missing(tmp_path):
    write_order(tmp_path, ["+x", "-y+z"], np.array([0.5, 0.25]))
    assert read_order(tmp_path) == ("+x", "-y+z")
    (tmp_path / ORDER_FILE).write_text((tmp_path / ORDER_FILE).read_text().replace("+x", "-x"))
    with pytest.raises(CorruptFile, match="changed"):
        read_order(tmp_path)
    for folder in (None, tmp_path / "nowhere"):
        with pytest.raises(NoOrder, match="activetouch calibrate"):
            read_order(folder)
