"""Extremes of the evidence about one rigid body, and of the worlds of its sensor; test_public_fuzz has the rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

from belief import Touch
from belief.calibration import (
    DirichletCalibration,
    StructuredMatrixScaling,
    TemperatureScaling,
    VectorScaling,
    logits_from_probs,
)
from belief.metrics import reliability_diagram
from belief.observation_model import (
    FittedRigidBody,
    FixedHypotheses,
    FixedWorlds,
    RigidBodyModel,
    SensorHealthModel,
    calibration_of_stops,
    certified_stops,
    fit_observation_model,
    spread_prior,
)
from belief.synthetic import random_model
from tests.extremes.cases import Case, Verdict, answers, equal_to, judge, refusals, refuses, such_that

_CALIBRATIONS = (TemperatureScaling, VectorScaling, DirichletCalibration, StructuredMatrixScaling)


def _rigid_body(size: float = 1.0, temperature: float = 1.0) -> RigidBodyModel:
    """Two shapes, one pose, two hypotheses of each shape, which are opposite to those of the other."""
    table = np.array([[[[1.0, 0.0], [0.0, 1.0]], [[-1.0, 0.0], [0.0, -1.0]]]])
    references = np.array([[[1.0, 0.2], [-1.0, 0.1]]])
    fitted = FittedRigidBody(("a", "b"), 2, temperature, references, reference_logits=np.zeros((1, 2, 2)))
    with np.errstate(invalid="ignore"):
        return fitted.with_hypotheses(FixedHypotheses((table * size).astype(np.float32)))


def _of_worlds(size: float, prior: NDArray[np.float64] | None = None) -> SensorHealthModel:
    """:func:`_rigid_body`, and one world in which all signs are wrong."""
    nominal = _rigid_body()
    with np.errstate(invalid="ignore"):
        worlds = FixedWorlds((-nominal.table[:, None] * size).astype(np.float32))
    return SensorHealthModel(nominal, worlds, ("wrong sign",), spread_prior(1) if prior is None else prior)


def _of_rigid_bodies() -> list[Case]:
    def logs(feature: float, **changes: float) -> NDArray[np.float64]:
        touch = Touch(0, features=np.array([feature, feature / 2]))
        return _rigid_body(**changes).start().update(touch).log_likelihood

    first = such_that(
        "certainly the first shape", lambda logs: bool(np.isfinite(logs).all() and logs[0] > logs[1] + 50)
    )
    first_of_worlds = such_that(
        "the first shape in the described world", lambda logs: bool(np.isfinite(logs).all() and logs[0] > logs[1] + 1)
    )

    def in_worlds(feature: float) -> NDArray[np.float64]:
        return _of_worlds(1.0).start().update(Touch(0, features=np.array([feature, feature / 2]))).log_likelihood

    return [
        answers("SensorHealthModel", "features of 1e300", lambda: in_worlds(1e300), first_of_worlds),
        answers("SensorHealthModel", "features of 1e-300", lambda: in_worlds(1e-300), equal_to([0.0, 0.0])),
        *refusals(
            "SensorHealthModel",
            ValueError,
            {
                "features of NaN": (lambda: in_worlds(math.nan), "finite features"),
                "worlds of infinity": (lambda: _of_worlds(math.inf), "must be finite"),
                "a prior that gives all to the unknown": (
                    lambda: _of_worlds(1.0, np.array([0.0, 0.0, 1.0])),
                    "gives everything to the unknown",
                ),
                "a prior of NaN": (lambda: _of_worlds(1.0, np.full(3, math.nan)), "not finite"),
            },
        ),
        *refusals(
            "FixedWorlds", ValueError, {"four dimensions": (lambda: FixedWorlds(np.zeros((1,) * 4)), "must be .P")}
        ),
        *refusals(
            "spread_prior", ValueError, {"more than one": (lambda: spread_prior(2, 0.9, 0.2), "unknown must be")}
        ),
        answers("RigidBodyModel", "features of 1e300", lambda: logs(1e300, size=1e6), first),
        answers("RigidBodyModel", "a temperature of 1e-308", lambda: logs(1.0, temperature=1e-308), first),
        answers("RigidBodyModel", "features of 1e-300", lambda: logs(1e-300), equal_to([0.0, 0.0])),
        *refusals(
            "RigidBodyModel",
            ValueError,
            {
                "features of NaN": (lambda: logs(math.nan), "finite features"),
                "a touch without features": (
                    lambda: _rigid_body().start().update(Touch(0, np.zeros(2))),
                    "must bring its embedding of 2 numbers",
                ),
            },
        ),
        *refusals(
            "FixedHypotheses",
            ValueError,
            {
                "infinity": (lambda: _rigid_body(math.inf), "must be finite"),
                "numbers of 1e7": (lambda: _rigid_body(1e7), "at most 1e.06"),
                "a table of three dimensions": (lambda: FixedHypotheses(np.zeros((2, 2, 2))), "must be .P, K, N, D."),
            },
        ),
        *refusals(
            "FittedRigidBody",
            ValueError,
            {
                f"a temperature of {wrong}": (lambda wrong=wrong: _rigid_body(temperature=wrong), "temperature must be")
                for wrong in (0.0, -1.0, math.inf, math.nan)
            },
        ),
    ]


def _of_arrays() -> list[Case]:
    logits, labels = np.eye(4)[np.arange(200) % 4] - 0.5, np.arange(200) % 4
    return [
        answers(
            "logits_from_probs",
            "certainty, 0 and 1, in one column: finite, and as sure as the floor allows",
            lambda: logits_from_probs([0.0, 1.0], floor=1e-6)[:, 1].tolist(),
            equal_to([np.log(1e-6), 0.0]),
        ),
        refuses("logits_from_probs", "a sigmoid of 1.5", lambda: logits_from_probs([1.5]), ValueError, "1.5|-0.5"),
        refuses("logits_from_probs", "NaN", lambda: logits_from_probs([[np.nan, 1.0]]), ValueError, "nan|NaN"),
        *(
            refuses(
                f"{kind.__name__}.fit",
                f"weights {weights}",
                lambda kind=kind, weights=weights: kind().fit(logits[:2], labels[:2], weights),
                ValueError,
                "weights?",
            )
            for kind in _CALIBRATIONS
            for weights in ([0.0, 0.0], [1.0, -1.0], [np.nan, 1.0], [np.inf, 1.0], [1.0], "ab")
        ),
        answers(
            "fit_observation_model",
            "one touch of each of two objects: a model that knows as little",
            lambda: [*fit_observation_model(2 * np.eye(2), [0, 1], ["mug", "ball"], num_folds=2).losses.values()],
            such_that("finite losses", lambda found: bool(np.isfinite(found).all())),
        ),
        refuses(
            "fit_observation_model",
            "an object with two labels",
            lambda: fit_observation_model(logits, labels, np.zeros(200, int)),
            ValueError,
            "object 0 has shape",
        ),
        refuses(
            "calibration_of_stops",
            "a classifier that knows nothing: no stop",
            lambda: calibration_of_stops(
                random_model(np.random.default_rng(0), sharpness=0.0), np.zeros((9, 4)), [0] * 9, [0] * 9
            ),
            ValueError,
            "no object reaches",
        ),
        answers(
            "certified_stops",
            "two objects: nothing is promised",
            lambda: certified_stops(
                random_model(np.random.default_rng(0)), np.zeros((4, 4)), [0, 0, 1, 1], [0, 0, 1, 1]
            ),
            such_that("infinite thresholds", lambda found: set(found.thresholds) == {np.inf}),
        ),
        refuses(
            "certified_stops",
            "a risk of zero",
            lambda: certified_stops(random_model(np.random.default_rng(0)), np.zeros((2, 4)), [0, 1], [0, 1], risk=0.0),
            ValueError,
            "risk",
        ),
        answers(
            "metrics.reliability_diagram",
            "certain and wrong: one point at the lower right, far from its band",
            lambda: reliability_diagram([[1.0, 0.0]] * 3, [1] * 3, Figure().subplots()).is_consistent.tolist(),
            equal_to([False]),
        ),
    ]


@pytest.mark.parametrize("case", _of_rigid_bodies() + _of_arrays(), ids=str)
def test_an_extreme_is_answered_rightly_or_refused_with_a_reason(case):
    finding = judge(case)
    assert finding.verdict is not Verdict.FAILED, f"expected {case.expected.words}; {finding.happened}"
