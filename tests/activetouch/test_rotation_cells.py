"""Cells cover all orientations once, their parts lie in them, and views show a body from all sides."""

import numpy as np
import pytest

from activetouch.poses import random_orientation
from activetouch.rotation_cells import LEVELS, centres, nearest, nested, views
from belief.errors import InvalidArgument

RNG = np.random.default_rng(0)
ORIENTATIONS = np.array([random_orientation(RNG) for _ in range(4000)])


def edge(level):
    """Mean edge of the cells of a level [rad]."""
    return (8 * np.pi**2 / len(centres(level))) ** (1 / 3)


def angles(left, right):
    return 2 * np.arccos(np.minimum(1.0, np.abs((left * right).sum(axis=1))))


@pytest.mark.parametrize("level", range(LEVELS - 1))
def test_cells_cover_all_orientations_in_proportion_to_their_shares(level):
    found = nearest(ORIENTATIONS, centres(level))
    assert angles(ORIENTATIONS, centres(level)[found]).max() < 1.1 * edge(level)
    shares = nested((level,)).shares[0]
    first = nested((0, level)).shares[0] if level else shares
    part = len(shares) // len(first)
    counts = np.bincount(found // part, minlength=len(first)) / len(ORIENTATIONS)
    assert np.abs(counts - first).sum() < 0.35


@pytest.mark.parametrize("level", range(LEVELS - 1))
def test_the_parts_of_a_cell_lie_about_its_centre(level):
    parents = np.repeat(centres(level), 8, axis=0)
    assert angles(parents, centres(level + 1)).max() < 0.8 * edge(level)


def test_views_are_evenly_spread_and_come_in_quarter_turns():
    found = views(88, 12)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    assert angles(ORIENTATIONS, found[nearest(ORIENTATIONS, found)]).mean() < np.deg2rad(13)
    np.testing.assert_allclose(angles(found[0:1], found[3:4]), np.pi / 2)


def test_numbers_that_make_no_views_are_refused():
    for wrong in ((0, 4), (4, 0), (4, 6)):
        with pytest.raises(InvalidArgument):
            views(*wrong)
    with pytest.raises(ValueError, match="level"):
        centres(LEVELS)
