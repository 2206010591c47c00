"""Extremes of beliefs: Bayes' rule, trackers, whole scenes, arrangements, the words of a search."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from belief import (
    Belief,
    BeliefTracker,
    Composition,
    Counts,
    ImpossibleObservation,
    SceneBelief,
    SearchProblem,
    Touch,
    ZeroPriorTarget,
)
from belief.arrangement import arrangement_marginals, log_arrangement_marginals
from belief.bayes import entropy, expected_information_gain, target_information_gain, update
from belief.errors import UnknownName
from belief.synthetic import random_model, sample_arrangement
from tests.extremes.cases import Case, Verdict, answers, equal_to, judge, refusals, refuses, such_that

_HALF = np.log([0.5, 0.5])
_NAN, _INF = math.nan, math.inf
_LABELS = ("cube", "cone")


def _posterior(prior: list[float], log_likelihood: list[float]) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.exp(update(np.log(prior), log_likelihood)[0])


def _scene(
    num_objects: int, num_shapes: int = 4, composition: Composition | Counts = Composition.DISTINCT
) -> SceneBelief:
    model = random_model(np.random.default_rng(0), num_shapes)
    return SceneBelief(SearchProblem(model.shape_labels, ("a", "b", "c"), num_objects, composition), model)


def _thousand_touches() -> float:
    steps = np.random.default_rng(0).normal(size=(1000, 1000, 2))
    log_probs = np.log(np.full((1000, 2), 0.5))
    for step in steps:
        log_probs, _ = update(log_probs, step)
    exact = [math.fsum(column) for column in (steps[:, :, 0] - steps[:, :, 1]).T]
    return float(np.abs(log_probs[:, 0] - log_probs[:, 1] - exact).max())


def _after_certainty() -> float:
    log_probs = np.log([[0.5, 0.5]])
    for step in [[0.0, -100.0]] * 1000 + [[-100.0, 0.0]] * 1001:
        log_probs, _ = update(log_probs, [step])
    return float(np.exp(log_probs[0, 1]))


def _brute_force(log_weights: np.ndarray) -> np.ndarray:
    marginals = np.zeros_like(log_weights)
    for shapes in itertools.permutations(range(log_weights.shape[1]), len(log_weights)):
        weight = np.exp(sum(log_weights[i, k] for i, k in enumerate(shapes)))
        for i, k in enumerate(shapes):
            marginals[i, k] += weight
    return marginals / marginals.sum(axis=1, keepdims=True)


def _in_any_order() -> float:
    rng = np.random.default_rng(0)
    model = random_model(rng)
    touches = model.sample(1, [0, 1, 2, 0, 1], rng)
    found = []
    for order in itertools.permutations(touches):
        tracker = BeliefTracker(Belief.uniform(model.shape_labels), model)
        for touch in order:
            tracker.update(touch)
        found.append(tracker.belief.probs)
    return float(np.ptp(found, axis=0).max())


def _zero_prior_target() -> None:
    model = random_model(np.random.default_rng(0), num_shapes=2)
    bag = Counts({"shape_1": 2})
    SceneBelief(SearchProblem(model.shape_labels, ("a",), 2, bag), model, target=0)


_RANDOM = np.random.default_rng(1).normal(size=(3, 5)) * 3

CASES: tuple[Case, ...] = (
    answers(
        "bayes.update", "log-likelihoods of ±1e308", lambda: _posterior([0.5, 0.5], [1e308, -1e308]), equal_to([1, 0])
    ),
    answers(
        "bayes.update",
        "log-likelihoods of -1e308 that differ by one bit",
        lambda: _posterior([0.5, 0.5], [-1e308, np.nextafter(-1e308, -_INF)]),
        equal_to([1, 0]),
    ),
    answers(
        "bayes.update",
        "likelihoods of 1e-300",
        lambda: _posterior([0.25, 0.75], np.log([3e-300, 1e-300]).tolist()),
        equal_to([0.5, 0.5]),
    ),
    answers(
        "bayes.update",
        "a likelihood of zero for one shape",
        lambda: _posterior([0.5, 0.5], [-_INF, 0]),
        equal_to([0, 1]),
    ),
    answers(
        "bayes.update",
        "a prior of zero against overwhelming evidence",
        lambda: _posterior([0, 1], [1e4, 0]),
        equal_to([0, 1]),
    ),
    answers(
        "bayes.update",
        "a float16 prior",
        lambda: update(np.log(np.float16([0.1, 0.2, 0.7])), np.zeros(3))[0],
        equal_to(np.log([0.1, 0.2, 0.7]), 2e-3),
    ),
    answers("bayes.update", "one shape only", lambda: update([0.0], [-1e5])[0], equal_to([0.0])),
    answers(
        "bayes.update",
        "a batch of 10 000 rows and each alone",
        lambda: float(
            np.abs(
                update(np.full(4, np.log(0.25)), (rows := np.random.default_rng(0).normal(size=(10_000, 4)) * 50))[0][
                    ::997
                ]
                - [update(np.full(4, np.log(0.25)), row)[0] for row in rows[::997]]
            ).max()
        ),
        such_that("no difference above 1e-9", lambda found: found <= 1e-9),
    ),
    refuses(
        "bayes.update",
        "zero likelihood for every shape still believed in",
        lambda: _posterior([1, 0], [-_INF, 0]),
        ImpossibleObservation,
        r"zero likelihood under every shape of positive probability: prior \[1.0, 0.0\]",
    ),
    *refusals(
        "bayes.update",
        ValueError,
        {
            "a likelihood of NaN": (lambda: update(_HALF, [_NAN, 0]), "NaN"),
            "a log-likelihood of +inf": (lambda: update(_HALF, [_INF, 0]), r"\+inf"),
            "a prior that sums to 0.9": (lambda: update(np.log([0.4, 0.5]), [0, 0]), "sum to one"),
            "NaN in row 7 of a batch": (
                lambda: update(_HALF, np.where(np.arange(9)[:, None] == 7, _NAN, np.zeros((9, 2)))),
                "row 7",
            ),
            "no shapes": (lambda: update([], []), "non-empty"),
            "no rows": (lambda: update(_HALF, np.zeros((0, 2))), "nothing to update"),
            "two shapes and three likelihoods": (lambda: update(_HALF, [0, 0, 0]), "last axis"),
            "words": (lambda: update(_HALF, ["a", "b"]), "real numbers"),
            "complex numbers": (lambda: update(_HALF, [1j, 0]), "real numbers"),
        },
    ),
    answers(
        "bayes.entropy",
        "a certain and a uniform belief",
        lambda: entropy([[1, 0], [0.5, 0.5]]),
        equal_to([0, math.log(2)]),
    ),
    *refusals(
        "bayes.entropy",
        ValueError,
        {
            "a negative probability": (lambda: entropy([-0.5, 1.5]), "below zero"),
            "nothing": (lambda: entropy([]), "empty"),
        },
    ),
    answers(
        "bayes.expected_information_gain",
        "a certain belief",
        lambda: expected_information_gain([1, 0], [np.eye(2)]),
        equal_to([0]),
    ),
    answers(
        "bayes.expected_information_gain",
        "outcomes of probability 1e-300",
        lambda: expected_information_gain([0.5, 0.5], [[[1, 1e-300], [1, 1e-300]]]),
        equal_to([0]),
    ),
    refuses(
        "bayes.expected_information_gain",
        "a table of other shapes",
        lambda: expected_information_gain([0.5, 0.5], [np.eye(3)]),
        ValueError,
        "for a belief",
    ),
    refuses(
        "bayes.target_information_gain",
        "a target that is no shape",
        lambda: target_information_gain([0.5, 0.5], [np.eye(2)], 2),
        ValueError,
        r"target must be an integer in \[0, 2\)",
    ),
    answers(
        "bayes.update",
        "a thousand touches of each of a thousand objects",
        _thousand_touches,
        such_that("within 1e-3 nats of exact summation", lambda found: found < 1e-3),
    ),
    answers("bayes.update", "contrary touches after certainty of 1e5 nats", _after_certainty, equal_to(1.0)),
    refuses("SceneBelief", "a target whose prior is zero", _zero_prior_target, ZeroPriorTarget, "no touch can find it"),
    answers(
        "BeliefTracker",
        "the same five touches in all 120 orders",
        _in_any_order,
        such_that("the same within 1e-9", lambda x: x < 1e-9),
    ),
    *refusals(
        "BeliefTracker",
        ValueError,
        {
            "a prior about other shapes": (
                lambda: BeliefTracker(Belief.uniform(_LABELS), random_model(np.random.default_rng(0))),
                "the prior is about",
            ),
            "a touch with logits of NaN": (
                lambda: BeliefTracker(
                    Belief.uniform([f"shape_{k}" for k in range(4)]), random_model(np.random.default_rng(0))
                ).update(Touch(0, np.full(4, _NAN))),
                "(?i)nan|finite",
            ),
            "a pose that the model does not know": (
                lambda: BeliefTracker(
                    Belief.uniform([f"shape_{k}" for k in range(4)]), random_model(np.random.default_rng(0))
                ).update(Touch(99, np.zeros(4))),
                "pose 99",
            ),
        },
    ),
    *refusals(
        "Belief",
        ValueError,
        {
            "no shapes": (lambda: Belief.uniform([]), "at least one"),
            "two shapes of one name": (lambda: Belief.uniform(["cube", "cube"]), "differ"),
        },
    ),
    refuses(
        "Belief.prob",
        "a shape that it does not know",
        lambda: Belief.uniform(_LABELS).prob("conee"),
        UnknownName,
        "Did you mean 'cone'",
    ),
    answers("SceneBelief", "one object of two shapes", lambda: _scene(1, 2).marginals(), equal_to([[0.5, 0.5]])),
    answers(
        "SceneBelief",
        "twelve distinct objects, untouched",
        lambda: _scene(12, 12).marginals(),
        equal_to(np.full((12, 12), 1 / 12)),
    ),
    refuses("SceneBelief", "22 distinct objects", lambda: _scene(22, 22), ValueError, "more than 1048576"),
    answers(
        "SceneBelief",
        "22 independent objects",
        lambda: _scene(22, 22, Composition.INDEPENDENT).marginals()[21],
        equal_to(np.full(22, 1 / 22)),
    ),
    refuses("SceneBelief.update", "an object that is not there", lambda: _scene(2).update(2, []), ValueError, "object"),
    answers(
        "arrangement_marginals",
        "3 objects of 5 shapes, by brute force",
        lambda: arrangement_marginals(_RANDOM),
        equal_to(_brute_force(_RANDOM)),
    ),
    answers(
        "arrangement_marginals",
        "weights of ±1e308",
        lambda: arrangement_marginals([[1e308, -1e308], [0.0, 0.0]]),
        equal_to(np.eye(2)),
    ),
    answers(
        "arrangement_marginals",
        "weights that contradict each other by 1e4 nats",
        lambda: log_arrangement_marginals([[0.0, -1e4], [0.0, 0.0]]),
        equal_to([[0, -1e4], [-1e4, 0]]),
    ),
    refuses(
        "arrangement_marginals",
        "two objects that can only be the same shape",
        lambda: arrangement_marginals([[0, -_INF], [0, -_INF]]),
        ImpossibleObservation,
        "to have the same shape",
    ),
    *refusals(
        "arrangement_marginals",
        ValueError,
        {
            "three objects of two shapes": (lambda: arrangement_marginals(np.zeros((3, 2))), "cannot all differ"),
            "NaN in row 1": (lambda: arrangement_marginals([[0, 0], [0, _NAN]]), "row 1"),
        },
    ),
    *refusals(
        "SearchProblem",
        ValueError,
        {
            "no objects": (lambda: SearchProblem(_LABELS, ("a",), 0), "at least 1, got 0"),
            "five distinct objects of two shapes": (lambda: SearchProblem(_LABELS, ("a",), 5), "independent"),
            "λ = NaN": (lambda: SearchProblem(_LABELS, ("a",), 1, touch_cost=_NAN), "touch_cost"),
            "λ = -0.1": (lambda: SearchProblem(_LABELS, ("a",), 1, touch_cost=-0.1), "touch_cost"),
            "no touch allowed": (lambda: SearchProblem(_LABELS, ("a",), 1, touch_limit=0), "touch_limit"),
        },
    ),
    refuses(
        "SearchProblem",
        "a bag with a shape that has no name",
        lambda: SearchProblem(_LABELS, ("a",), 1, Counts({"sphere": 1})),
        UnknownName,
        "sphere",
    ),
    refuses(
        "SearchProblem",
        "a bag with fewer objects than the table",
        lambda: SearchProblem(_LABELS, ("a",), 3, Counts({"cube": 2})),
        ValueError,
        "cannot come from a bag of 2",
    ),
    *refusals(
        "Counts",
        ValueError,
        {
            "an empty bag": (lambda: Counts({}), "at least one above zero"),
            "minus one cube": (lambda: Counts({"cube": -1}), "-1"),
        },
    ),
    refuses(
        "Composition", "an unknown word", lambda: SearchProblem(_LABELS, ("a",), 1, "distnct"), ValueError, "distnct"
    ),  # type: ignore[arg-type]
    answers(
        "sample_arrangement",
        "a bag with one kind",
        lambda: sample_arrangement(SearchProblem(_LABELS, ("a",), 2, Counts({"cone": 2})), np.random.default_rng(0)),
        equal_to([1, 1]),
    ),
)
"""Of :mod:`belief`, but for calibrations, observation models, metrics and statistics."""


@pytest.mark.parametrize("case", CASES, ids=str)
def test_an_extreme_is_answered_rightly_or_refused_with_a_reason(case):
    finding = judge(case)
    assert finding.verdict is not Verdict.FAILED, f"expected {case.expected.words}; {finding.happened}"
