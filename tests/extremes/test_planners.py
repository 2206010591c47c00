"""Extremes of deciders and of the search loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from belief import Composition, Counts, ImpossibleObservation, Probe, SearchProblem, Touch
from belief.calibration import TemperatureScaling
from belief.observation_model import ConfusionModel
from belief.seeding import keyed_rng
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import DECIDERS, Decider, Decision, Episode, InformationState, Outcome, make_decider, search
from planners.registry import NEED_FILES
from tests.extremes.cases import Case, Verdict, answers, judge, refuses, such_that

_LABELS = ("cube", "cone", "sphere")
_POSES = ("front", "side")
_UNTRAINED = Path("no-such-folder-of-policies")


def _table(probs: Sequence[Sequence[float]]) -> ConfusionModel:
    """An observation model of three shapes whose outcome is the predicted shape, the same in both poses."""
    return ConfusionModel(_LABELS, np.array([probs] * len(_POSES), float), TemperatureScaling(1.0, "ok"))


_PERFECT, _USELESS = _table(np.eye(3).tolist()), _table(np.full((3, 3), 1 / 3).tolist())
_NOISY = _table((0.3 * np.full((3, 3), 1 / 3) + 0.7 * np.eye(3)).tolist())
_PROBLEM = SearchProblem(_LABELS, _POSES, 3, touch_cost=0.02, touch_limit=20)


@cache
def _decider(name: str, model: ConfusionModel) -> Decider:
    return make_decider(name, model.outcome_table(), model, _UNTRAINED, simulations=20)


_MODEL_BASED = tuple(name for name in DECIDERS if name not in NEED_FILES)


def _search(decider: Decider, problem: SearchProblem, model: ConfusionModel, number: int, target: int = 0) -> Episode:
    rng = keyed_rng([number, 7])
    world = SyntheticWorld(model, sample_arrangement(problem, rng))
    return search(world, decider, problem, target, model, (number,))


def _ends(name: str, problem: SearchProblem, model: ConfusionModel, episodes: int = 2) -> bool:
    """Whether every search ends within the touch limit, by a decision or by the limit, and is the same again."""
    for number in range(episodes):
        first, again = (_search(_decider(name, model), problem, model, number) for _ in range(2))
        if first.num_touches > problem.touch_limit or first.to_dict() != again.to_dict():
            return False
        if not all(np.isfinite(list(step.decision.scores.values())).all() for step in first.steps):
            return False
    return True


_ENDS = such_that("ends within the touch limit, with finite scores, the same again", bool)


def _of_every_decider() -> list[Case]:
    rare = SearchProblem(_LABELS, _POSES, 2, Counts({"cube": 1, "cone": 10**4}), touch_limit=20)
    settings = {
        "λ = 0": (replace(_PROBLEM, touch_cost=0.0), _NOISY),
        "λ = 100": (replace(_PROBLEM, touch_cost=100.0), _NOISY),
        "useless poses, λ = 0": (replace(_PROBLEM, touch_cost=0.0), _USELESS),
        "perfect poses": (_PROBLEM, _PERFECT),
        "one touch allowed": (replace(_PROBLEM, touch_limit=1), _NOISY),
        "one object": (replace(_PROBLEM, num_objects=1), _NOISY),
        "objects of any shape, the target perhaps absent": (
            replace(_PROBLEM, composition=Composition.INDEPENDENT),
            _NOISY,
        ),
        "a target one in ten thousand": (rare, _NOISY),
    }
    return [
        answers(f"DECIDERS[{name!r}]", given, lambda name=name, s=setting: _ends(name, *s), _ENDS)
        for name in _MODEL_BASED
        for given, setting in settings.items()
    ]


class _AlwaysTouches:
    """A decider that never stops."""

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """Touch in the first pose."""
        return Decision(Probe(0))


class _Liar(SyntheticWorld):
    """A world that says something else at every touch of the same object."""

    def touch(self, pose: int, rng: np.random.Generator) -> Touch:
        """What any shape might give."""
        return _PERFECT.sample(int(rng.integers(3)), [pose], rng)[0]


_rng = np.random.default_rng

CASES: tuple[Case, ...] = (
    *_of_every_decider(),
    answers(
        "search",
        "a decider that never stops",
        lambda: _search(_AlwaysTouches(), _PROBLEM, _NOISY, 0).outcome,
        such_that("truncated at 20 touches", lambda o: o is Outcome.TRUNCATED),
    ),
    refuses(
        "search",
        "a world that contradicts its model",
        lambda: [search(_Liar(_PERFECT, (0, 1, 2)), _AlwaysTouches(), _PROBLEM, 0, _PERFECT, (n,)) for n in range(9)],
        ImpossibleObservation,
        "zero likelihood",
    ),
    answers(
        "search",
        "a problem of 20 objects of 20 shapes",
        lambda: (
            _search(
                _decider("threshold", (m := random_model(_rng(0), 20, 2))),
                SearchProblem(m.shape_labels, _POSES, 20, touch_limit=3),
                m,
                0,
            ).num_touches
        ),
        such_that("at most three touches", lambda n: n <= 3),
    ),
)
"""Of :mod:`planners`; every decider of the table meets the same extremes."""


@pytest.mark.parametrize("case", CASES, ids=str)
def test_an_extreme_is_answered_rightly_or_refused_with_a_reason(case):
    finding = judge(case)
    assert finding.verdict is not Verdict.FAILED, f"expected {case.expected.words}; {finding.happened}"
