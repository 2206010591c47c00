"""Extremes of deciders and of the search loop."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from belief import Composition, Counts, ImpossibleObservation, Probe, SearchProblem, Touch
from belief.calibration import TemperatureScaling
from belief.errors import UnknownName
from belief.observation_model import ConfusionModel
from belief.references import BadReference
from belief.seeding import keyed_rng
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import DECIDERS, Decider, Decision, Episode, InformationState, Outcome, make_decider, search
from planners.ppo import MissingPolicy
from planners.probing import FixedOrder, TargetInformationGain
from planners.registry import NEED_FILES, TRAINED
from planners.stopping import PosteriorThresholds
from planners.threshold_rule import ThresholdRule
from tests.extremes.cases import Case, Verdict, answers, equal_to, judge, refusals, refuses, such_that

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
    return make_decider(name, model.outcome_table(), model, _UNTRAINED)


_MODEL_BASED = tuple(name for name in DECIDERS if name not in NEED_FILES)


def _search(decider: Decider, problem: SearchProblem, model: ConfusionModel, number: int, target: int = 0) -> Episode:
    rng = keyed_rng([number, 7])
    world = SyntheticWorld(model, sample_arrangement(problem, rng))
    return search(world, decider, problem, target, model, (number,))


def _ends(name: str, problem: SearchProblem, model: ConfusionModel, episodes: int = 4) -> bool:
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


def _information(target_prob: float, *, history: Sequence[Touch] = (), object_index: int = 0) -> InformationState:
    from belief import Belief

    rest = (1.0 - target_prob) / 2
    belief = Belief.from_probs(_LABELS, [target_prob, rest, rest])
    return InformationState(_PROBLEM, 0, belief, tuple(history), object_index)


class _AlwaysTouches:
    """A decider that never stops."""

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """Touch in the first pose."""
        return Decision(Probe(0))


class _UnknownPose:
    """A decider that asks for a pose that is not there."""

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """Touch in pose 99."""
        return Decision(Probe(99))


class _Liar(SyntheticWorld):
    """A world that says something else at every touch of the same object."""

    def touch(self, pose: int, rng: np.random.Generator) -> Touch:
        """What any shape might give."""
        return _PERFECT.sample(int(rng.integers(3)), [pose], rng)[0]


def _perfect_touches(name: str) -> int:
    """Most touches of one object, with poses that tell all."""
    most = 0
    for number in range(10):
        episode = _search(_decider(name, _PERFECT), _PROBLEM, _PERFECT, number)
        touched = [step.object_index for step in episode.steps if step.touch is not None]
        most = max([most, *np.bincount(touched).tolist()] if touched else [most])
    return most


def _read_back() -> bool:
    episode = _search(_decider("information_gain", _NOISY), _PROBLEM, _NOISY, 1)
    again = Episode.from_dict(json.loads(json.dumps(episode.to_dict())), _LABELS)
    pairs = list(zip(episode.steps, again.steps, strict=True))
    same = all(one.decision.action == other.decision.action for one, other in pairs)
    off = max(float(np.abs(one.belief.probs - other.belief.probs).max()) for one, other in pairs)
    return same and off < 1e-12 and episode.outcome is again.outcome


_rng = np.random.default_rng

CASES: tuple[Case, ...] = (
    *_of_every_decider(),
    answers(
        "DECIDERS['information_gain']",
        "perfect poses: one touch an object at most",
        lambda: _perfect_touches("information_gain"),
        equal_to(1),
    ),
    *(
        refuses(
            f"DECIDERS[{name!r}]",
            "no trained policy",
            lambda name=name: _search(_decider(name, _NOISY), _PROBLEM, _NOISY, 0),
            MissingPolicy,
            "no policy for the target",
        )
        for name in sorted(TRAINED)
    ),
    refuses(
        "make_decider",
        "a name with a slip",
        lambda: make_decider("information_gian", _NOISY.outcome_table()),
        UnknownName,
        "Did you mean 'information_gain'",
    ),
    refuses("make_decider", "no name", lambda: make_decider("", _NOISY.outcome_table()), BadReference, "not a name"),
    answers(
        "search",
        "a decider that never stops",
        lambda: _search(_AlwaysTouches(), _PROBLEM, _NOISY, 0).outcome,
        such_that("truncated at 20 touches", lambda o: o is Outcome.TRUNCATED),
    ),
    *refusals(
        "search",
        ValueError,
        {
            "a pose that is not there": (lambda: _search(_UnknownPose(), _PROBLEM, _NOISY, 0), "pose"),
            "a target that is no shape": (
                lambda: _search(_AlwaysTouches(), _PROBLEM, _NOISY, 0, target=3),
                r"\[0, 3\), got 3",
            ),
            "fewer objects than the problem says": (
                lambda: search(SyntheticWorld(_NOISY, (0,)), _AlwaysTouches(), _PROBLEM, 0, _NOISY, (0,)),
                "the world has 1 objects, the problem 3",
            ),
        },
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
    answers(
        "Episode",
        "written and read back",
        _read_back,
        such_that("the same actions and outcome, beliefs within 1e-12", bool),
    ),
    answers(
        "PosteriorThresholds",
        "a certain target, untouched",
        lambda: PosteriorThresholds().stop(_information(1.0)) is not None,
        equal_to(True),
    ),
    answers(
        "PosteriorThresholds",
        "a target ruled out, the last object",
        lambda: type(PosteriorThresholds().stop(_information(0.0, object_index=2)).action).__name__,
        such_that("Reject", lambda n: n == "Reject"),
    ),  # type: ignore[union-attr]
    *refusals(
        "PosteriorThresholds",
        ValueError,
        {
            "reject above confirm": (lambda: PosteriorThresholds(0.2, 0.8), "0.8 and 0.2"),
            "a threshold of NaN": (lambda: PosteriorThresholds(float("nan")), "nan"),
            "no touches of an object allowed": (lambda: PosteriorThresholds(max_touches=0), "max_touches must be"),
        },
    ),
    *refusals(
        "ThresholdRule",
        ValueError,
        {
            "zero frames in a row": (lambda: ThresholdRule(num_consecutive=0), "num_consecutive"),
            "low above high": (lambda: ThresholdRule(high=0.1, low=0.9), "0.9 and 0.1"),
        },
    ),
    answers(
        "ThresholdRule",
        "logits of ±1e308",
        lambda: ThresholdRule().stop(_information(0.5, history=[Touch(0, np.array([1e308, -1e308, 0]))])),
        such_that("no decision after one frame", lambda d: d is None),
    ),
    answers(
        "FixedOrder",
        "after 1000 touches",
        lambda: FixedOrder().choose(_information(0.5, history=[Touch(0, np.zeros(3))] * 1000), _rng(0)).action.pose,
        equal_to(0),
    ),  # type: ignore[union-attr]
    answers(
        "TargetInformationGain",
        "poses that all tell nothing: the lowest",
        lambda: TargetInformationGain(_USELESS.outcome_table()).choose(_information(0.5), _rng(0)).action.pose,
        equal_to(0),
    ),  # type: ignore[union-attr]
    answers(
        "TargetInformationGain",
        "a certain belief",
        lambda: TargetInformationGain(_NOISY.outcome_table()).choose(_information(1.0), _rng(0)).action.pose,
        equal_to(0),
    ),  # type: ignore[union-attr]
)
"""Of :mod:`planners`; every decider of the table meets the same extremes."""


@pytest.mark.parametrize("case", CASES, ids=str)
def test_an_extreme_is_answered_rightly_or_refused_with_a_reason(case):
    finding = judge(case)
    assert finding.verdict is not Verdict.FAILED, f"expected {case.expected.words}; {finding.happened}"
