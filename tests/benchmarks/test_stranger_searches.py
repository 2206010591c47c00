"""Searches among strangers."""

import numpy as np
import pytest

from activetouch import TactileSensor
from activetouch.named_scenes import SCENES
from benchmarks.stranger_searches import IGNORES, KNOWS, stranger_searches, table

GIVEN = {"sensor": TactileSensor.shipped("coarse"), "named": SCENES["coarse"], "episodes": 5, "seed": 0, "jobs": 1}


@pytest.fixture(scope="module")
def found():
    return stranger_searches(**GIVEN)


def test_a_belief_that_knows_of_strangers_takes_fewer_of_them(found):
    assert set(found) == {KNOWS, IGNORES}
    assert found[KNOWS]["number"] == found[IGNORES]["number"] == 20
    assert found[KNOWS]["taken"] < found[IGNORES]["taken"]
    assert found[KNOWS]["success"] > found[IGNORES]["success"]


def test_the_numbers_of_a_search_fit_together(found):
    for numbers in found.values():
        assert numbers["wrong"][1] <= numbers["wrong"][0] <= numbers["wrong"][2]
        assert numbers["taken"] <= numbers["wrong"][0] <= 1.0 - numbers["success"]
        assert numbers["no_touch"] == 0.5
        assert np.isfinite(numbers["touches"])
    assert "20 live searches" in table("coarse", found).title
