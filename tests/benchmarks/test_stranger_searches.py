"""Searches among strangers."""

import numpy as np
import pytest

from activetouch import TactileSensor
from activetouch.named_scenes import SCENES
from benchmarks.stranger_searches import IGNORES, KNOWS, stranger_searches, table
from experiments.robustness.searches import played_together

GIVEN = {"sensor": TactileSensor.shipped("coarse"), "named": SCENES["coarse"], "episodes": 5, "seed": 0, "jobs": 1}


@pytest.fixture(scope="module")
def found():
    return stranger_searches(**GIVEN)


def test_a_belief_that_knows_of_strangers_takes_fewer_of_them(found):
    assert set(found) == {KNOWS, IGNORES}
    assert found[KNOWS]["number"] == found[IGNORES]["number"] == 20
    assert found[KNOWS]["taken"] < found[IGNORES]["taken"]
    assert found[KNOWS]["success"] > found[IGNORES]["success"]


def test_a_search_draws_from_a_bag_of_known_shapes_and_as_many_strangers(monkeypatch):
    asked, path = [], "benchmarks.stranger_searches.played_together"

    def play(sensor, worlds, decider, problem, targets, used, seeds):
        asked.append((worlds, problem, targets, used))
        return played_together(sensor, worlds[:1], decider, problem, targets[:1], used, seeds[:1])

    monkeypatch.setattr(path, play)
    stranger_searches(**{**GIVEN, "episodes": 50})
    for (worlds, problem, targets, used), num_shapes in zip(asked, (5, 4), strict=True):
        shapes = np.array([world.arrangement for world in worlds])
        assert shapes.shape == (200, 4)
        assert targets == [target for target in range(4) for _ in range(50)]
        assert all((shapes == k).sum(axis=1).max() == 1 for k in range(4))  # one object of each known shape
        assert len(used.shape_labels) == len(problem.shape_labels) == num_shapes
        # Four of eight objects: each known one is there in half of the searches; five standard errors.
        for k in range(4):
            assert abs((shapes == k).any(axis=1).mean() - 0.5) < 5 * 0.5 / np.sqrt(200)
        strangers = {thing.shape_index for world in worlds for thing in world._objects if thing.shape_index >= 4}
        assert len(strangers) > 1


def test_the_numbers_of_a_search_fit_together(found):
    for numbers in found.values():
        assert numbers["wrong"][1] <= numbers["wrong"][0] <= numbers["wrong"][2]
        assert numbers["taken"] <= numbers["wrong"][0] <= 1.0 - numbers["success"]
        assert numbers["no_touch"] == 0.5
        assert np.isfinite(numbers["touches"])
    assert "20 live searches" in table("coarse", found).title
