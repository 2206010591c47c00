"""Extremes of deciders and of the search loop."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from belief import Composition, Counts, ImpossibleObservation, Probe, SearchProblem
from belief.calibration import TemperatureScaling
from belief.observation_model import ConfusionModel
from belief.seeding import keyed_rng
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import DECIDERS, Decision, Outcome, make_decider, search
from planners.registry import NEED_FILES

_LABELS = ("cube", "cone", "sphere")
_POSES = ("front", "side")


def _table(probs):
    """An observation model of three shapes whose outcome is the predicted shape, the same in both poses."""
    return ConfusionModel(_LABELS, np.array([probs] * len(_POSES)), TemperatureScaling(1.0, "ok"))


_PERFECT, _USELESS = _table(np.eye(3)), _table(np.full((3, 3), 1 / 3))
_NOISY = _table(0.1 + 0.7 * np.eye(3))
_PROBLEM = SearchProblem(_LABELS, _POSES, 3, touch_cost=0.02, touch_limit=20)


@cache
def _decider(name, model):
    return make_decider(name, model.outcome_table(), model, Path("no-such-folder-of-policies"), simulations=20)


def _search(decider, problem, model, number):
    world = SyntheticWorld(model, sample_arrangement(problem, keyed_rng([number, 7])))
    return search(world, decider, problem, 0, model, (number,))


RARE = Counts({"cube": 1, "cone": 10**4})
SETTINGS = {
    "λ = 0": ({"touch_cost": 0.0}, _NOISY),
    "λ = 100": ({"touch_cost": 100.0}, _NOISY),
    "useless poses, λ = 0": ({"touch_cost": 0.0}, _USELESS),
    "perfect poses": ({}, _PERFECT),
    "one touch allowed": ({"touch_limit": 1}, _NOISY),
    "one object": ({"num_objects": 1}, _NOISY),
    "objects of any shape, the target perhaps absent": ({"composition": Composition.INDEPENDENT}, _NOISY),
    "a target one in ten thousand": ({"num_objects": 2, "composition": RARE}, _NOISY),
}


@pytest.mark.parametrize("given", SETTINGS)
@pytest.mark.parametrize("name", [name for name in DECIDERS if name not in NEED_FILES])
def test_a_search_ends_within_the_touch_limit_with_finite_scores_and_the_same_again(name, given):
    changes, model = SETTINGS[given]
    problem = replace(_PROBLEM, **changes)
    for number in range(2):
        first, again = (_search(_decider(name, model), problem, model, number) for _ in range(2))
        assert first.num_touches <= problem.touch_limit
        assert first.to_dict() == again.to_dict()
        assert all(np.isfinite(list(step.decision.scores.values())).all() for step in first.steps)


class _AlwaysTouches:
    """A decider that never stops."""

    def decide(self, info, rng):
        return Decision(Probe(0))


class _Liar(SyntheticWorld):
    """A world whose touches of one object are those of any shape."""

    def touch(self, pose, rng):
        return _PERFECT.sample(int(rng.integers(3)), [pose], rng)[0]


def test_a_decider_that_never_stops_is_cut_off():
    assert _search(_AlwaysTouches(), _PROBLEM, _NOISY, 0).outcome is Outcome.TRUNCATED


def test_a_world_that_contradicts_its_model_is_refused():
    with pytest.raises(ImpossibleObservation, match="zero likelihood"):
        search(_Liar(_PERFECT, (0, 1, 2)), _AlwaysTouches(), _PROBLEM, 0, _PERFECT, (0,))


def test_twenty_objects_of_twenty_shapes_are_searched():
    model = random_model(np.random.default_rng(0), 20, 2)
    problem = SearchProblem(model.shape_labels, _POSES, 20, touch_limit=3)
    assert _search(_decider("threshold", model), problem, model, 0).num_touches <= 3
