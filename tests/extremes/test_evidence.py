"""Extremes of what evidence is made from: calibrations, observation models, metrics, statistics."""

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
    choose_calibration,
    logits_from_probs,
)
from belief.files import sealed_json
from belief.metrics import (
    accuracy,
    bias_corrected_interval,
    brier_score,
    calibration_at_stop,
    calibration_report,
    classwise_calibration_error,
    confusion_matrix,
    expected_calibration_error,
    negative_log_likelihood,
    null_quantile,
    reliability_curve,
    reliability_diagram,
    shape_scores,
    smooth_calibration_error,
)
from belief.observation_model import (
    ConfusionModel,
    FittedRigidBody,
    FixedHypotheses,
    FixedWorlds,
    OutcomeTable,
    RigidBodyModel,
    SensorHealthModel,
    calibration_of_stops,
    fit_observation_model,
    read_observation_model,
    read_origin,
    spread_prior,
)
from belief.observation_model.registry import fits
from belief.observation_model.selection import choose_observation_model
from belief.out_of_distribution import auroc
from belief.statistics import (
    clopper_pearson_interval,
    cluster_bootstrap,
    mcnemar_test,
    paired_bootstrap,
    pareto_front,
    wilson_interval,
)
from belief.synthetic import random_model
from belief.touch_batch import TouchBatch
from tests.extremes.cases import (
    Case,
    Expectation,
    Verdict,
    answers,
    equal_to,
    judge,
    refusals,
    refuses,
    such_that,
)

_NAN = math.nan
_CALIBRATIONS = (TemperatureScaling, VectorScaling, DirichletCalibration, StructuredMatrixScaling)


def _rng() -> np.random.Generator:
    return np.random.default_rng(0)


_FINITE: Expectation = such_that(
    "finite log-probabilities that sum to one",
    lambda logs: bool(np.isfinite(logs).all() and np.allclose(np.exp(logs).sum(axis=-1), 1.0)),
)


def _noisy(num_rows: int = 200, num_shapes: int = 3) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    labels = np.arange(num_rows) % num_shapes
    return 2.0 * np.eye(num_shapes)[labels] + _rng().normal(size=(num_rows, num_shapes)), labels


def _fitted_to(given: str, logits: NDArray[np.float64], labels: NDArray[np.int64]) -> list[Case]:
    return [
        answers(
            f"{kind.__name__}.fit",
            given,
            lambda kind=kind: kind().fit(logits, labels).predict_log_proba(logits),
            _FINITE,
        )
        for kind in _CALIBRATIONS
    ]


def _calibrations() -> list[Case]:
    logits, labels = _noisy()
    return [
        *_fitted_to("one row", logits[:1], labels[:1]),
        *_fitted_to("one shape only", logits, np.zeros(len(labels), int)),
        *_fitted_to("perfectly separable logits", 5.0 * np.eye(3)[labels], labels),
        *_fitted_to("the same logits for all", np.ones_like(logits), labels),
        *_fitted_to("logits that point away from the truth", -logits, labels),
        *_fitted_to("logits of ±1e308", 1e308 * np.sign(logits), labels),
        *_fitted_to("logits of 1e-300", 1e-300 * logits, labels),
        answers(
            "TemperatureScaling.fit",
            "logits twice as large: twice the temperature",
            lambda: (
                TemperatureScaling().fit(2 * logits, labels).temperature
                / TemperatureScaling().fit(logits, labels).temperature
            ),
            equal_to(2.0),
        ),
        answers(
            "TemperatureScaling.fit",
            "separable logits say so",
            lambda: TemperatureScaling().fit(2.0 * np.eye(3)[labels], labels).status,
            such_that("separable", lambda s: s == "separable"),
        ),
        answers(
            "TemperatureScaling.fit",
            "anti-informative logits say so",
            lambda: TemperatureScaling().fit(-np.eye(3)[labels], labels).status,
            such_that("anti_informative", lambda s: s == "anti_informative"),
        ),
        answers(
            "TemperatureScaling",
            "a temperature of 1e-6",
            lambda: TemperatureScaling(1e-6, "ok").predict_proba([2.0, 1.0]),
            equal_to([1, 0]),
        ),
        answers(
            "TemperatureScaling",
            "a temperature of 1e6",
            lambda: TemperatureScaling(1e6, "ok").predict_proba([2.0, 1.0]),
            equal_to([0.5, 0.5], 1e-6),
        ),
        *refusals(
            "TemperatureScaling",
            ValueError,
            {
                "a temperature of zero": (lambda: TemperatureScaling(0.0), "temperature > 0"),
                "a temperature of NaN": (lambda: TemperatureScaling(_NAN), "temperature > 0"),
            },
        ),
        *refusals(
            "TemperatureScaling.fit",
            ValueError,
            {
                "no rows": (lambda: TemperatureScaling().fit(np.zeros((0, 3)), []), "n ≥ 1"),
                "a label out of range": (lambda: TemperatureScaling().fit(logits, labels + 1), "3"),
                "fractions of a label": (lambda: TemperatureScaling().fit(logits, labels + 0.5), "integer"),
                "NaN in row 4": (
                    lambda: TemperatureScaling().fit(np.where(np.arange(200)[:, None] == 4, _NAN, logits), labels),
                    "row 4",
                ),
            },
        ),
        refuses(
            "VectorScaling.predict_proba",
            "logits of another number of shapes",
            lambda: VectorScaling().fit(logits, labels).predict_proba(np.zeros((1, 4))),
            ValueError,
            "3.*4|4.*3",
        ),
        refuses(
            "choose_calibration",
            "one object for five folds",
            lambda: choose_calibration(logits, labels, np.zeros(200, int)),
            ValueError,
            "(?i)object|fold",
        ),
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
            lambda: [*fit_observation_model(np.eye(2), [0, 1], ["mug", "ball"], num_folds=2).losses.values()],
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
            lambda: calibration_of_stops(random_model(_rng(), sharpness=0.0), np.zeros((9, 4)), [0] * 9, [0] * 9),
            ValueError,
            "no object reaches",
        ),
    ]


def _touches(
    num_objects: int, repeats: int, scale: float = 1.0
) -> tuple[list[Touch], NDArray[np.int64], NDArray[np.int64]]:
    rng = _rng()
    source = random_model(rng, num_shapes=3, num_poses=2)
    touches = [t for i in range(num_objects) for t in source.sample(i % 3, [0, 1] * repeats, rng)]
    ids = np.repeat(np.arange(num_objects), 2 * repeats)
    return [Touch(t.pose, scale * t.logits) for t in touches], ids % 3, ids


def _model(name: str, num_objects: int = 30, repeats: int = 2, scale: float = 1.0) -> object:
    return fits()[name](*_touches(num_objects, repeats, scale), shape_labels=("a", "b", "c"), num_poses=2)


_SOUND = such_that("finite differences, the same in any order of touches", lambda found: bool(found))


def _sound(name: str, scale: float, logits: list[list[float]]) -> bool:
    """Whether likelihoods are finite, and those of touches in another order the same."""
    model = _model(name, scale=scale)
    touches = [Touch(i % 2, np.array(row)) for i, row in enumerate(logits)]
    forth, back = (np.asarray(model.log_likelihood(some)) for some in (touches, touches[::-1]))  # type: ignore[attr-defined]
    return bool(np.isfinite(forth).all() and np.allclose(forth - forth.max(), back - back.max(), atol=1e-9))


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


def _observation_models() -> list[Case]:
    extreme = [[1e308, 0.0, -1e308], [0.0, 0.0, 0.0], [1e4, -1e4, 0.0]]
    cases: list[Case] = []
    for name in fits():
        entry = f"fits()[{name!r}]"
        cases += [
            answers(
                entry, "touches with logits of ±1e308 and ±1e4", lambda name=name: _sound(name, 1.0, extreme), _SOUND
            ),
            answers(
                entry,
                "fitted to logits of 1e5",
                lambda name=name: _sound(name, 1e5, [[3e5, 0, 0], [0, 1e5, 0]]),
                _SOUND,
            ),
            answers(
                entry,
                "fitted to three objects touched once in a pose",
                lambda name=name: np.isfinite(
                    _model(name, 3, 1).log_likelihood([Touch(0, np.array([1.0, 0.0, 0.0]))])
                ).all(),
                such_that("finite likelihoods", bool),
            ),
            answers(entry, "no touches", lambda name=name: _model(name).log_likelihood([]), equal_to(np.zeros(3))),
            answers(
                entry,
                "written and read back",
                lambda name=name: (m := _model(name)).to_json() == read_observation_model(m.to_json()).to_json(),
                such_that("the same text", bool),
            ),
            *refusals(
                entry,
                ValueError,
                {
                    "a touch of NaN": (
                        lambda name=name: _model(name).log_likelihood([Touch(0, np.full(3, _NAN))]),
                        "(?i)nan|finite",
                    ),
                    "a touch of another number of shapes": (
                        lambda name=name: _model(name).log_likelihood([Touch(0, np.zeros(5))]),
                        "knows 3 shapes",
                    ),
                },
            ),
        ]
    return [
        *cases,
        answers(
            "ConfusionModel",
            "an outcome that no calibration touch had",
            lambda: float(_model("confusion").outcome_table().probs.min()),
            such_that("above zero", lambda p: p > 0),
        ),
        refuses("ConfusionModel", "one shape", lambda: random_model(_rng(), num_shapes=1), ValueError, "two shapes"),
        *refusals(
            "ConfusionModel.fit",
            ValueError,
            {
                "no touches": (lambda: ConfusionModel.fit([], []), "at least one touch"),
                "an object of two shapes": (
                    lambda: ConfusionModel.fit([Touch(0, np.zeros(2))] * 2, [0, 1], [7, 7]),
                    "object 7 has",
                ),
            },
        ),
        *_of_rigid_bodies(),
        refuses(
            "OutcomeTable",
            "rows that sum to 1.1",
            lambda: OutcomeTable(np.full((1, 2, 2), 0.55)),
            ValueError,
            "no distribution over outcomes",
        ),
        refuses(
            "TouchBatch",
            "a negative pose",
            lambda: TouchBatch(np.array([[-1]]), np.zeros((1, 1, 2))),
            ValueError,
            "pose",
        ),
        refuses(
            "choose_observation_model",
            "no candidates",
            lambda: choose_observation_model(*_touches(6, 1), shape_labels="abc", num_poses=2, candidates={}),
            ValueError,
            "no candidate",
        ),
        refuses(
            "read_observation_model",
            "nothing",
            lambda: read_observation_model(""),
            ValueError,
            "not an observation model",
        ),
        refuses("read_origin", "a text without a digest", lambda: read_origin("{}"), ValueError, "SHA-256"),
        refuses(
            "read_observation_model",
            "a model of an unknown kind",
            lambda: read_observation_model(sealed_json({"model": "oracle"})),
            ValueError,
            "unknown kind 'oracle'",
        ),
    ]


_EVEN = [[0.5, 0.5], [0.5, 0.5]]
_METRICS = (
    negative_log_likelihood,
    brier_score,
    expected_calibration_error,
    classwise_calibration_error,
    smooth_calibration_error,
)


def _metrics() -> list[Case]:
    cases: list[Case] = []
    for metric in _METRICS:
        entry = f"metrics.{metric.__name__}"
        cases += [
            answers(entry, "perfect predictions", lambda metric=metric: metric(np.eye(3), [0, 1, 2]), equal_to(0.0)),
            answers(
                entry,
                "one row, float16",
                lambda metric=metric: np.isfinite(metric(np.float16([[0.1, 0.9]]), [1])),
                such_that("finite", bool),
            ),
            *refusals(
                entry,
                ValueError,
                {
                    "no rows": (lambda metric=metric: metric(np.zeros((0, 2)), []), "n ≥ 1"),
                    "a label out of range": (lambda metric=metric: metric(_EVEN, [0, 2]), r"\[0, 2\)|range|row 1"),
                    "NaN": (
                        lambda metric=metric: metric([[_NAN, 0.5], [0.5, 0.5]], [0, 1]),
                        "row 0 holds",
                    ),
                },
            ),
        ]
    return [
        *cases,
        answers(
            "metrics.negative_log_likelihood",
            "certain and wrong: never infinite by silence",
            lambda: negative_log_likelihood([[1.0, 0.0]], [1]),
            such_that("infinite, or larger than any sensible loss", lambda x: x > 30),
        ),
        answers("metrics.brier_score", "certain and wrong", lambda: brier_score([[1.0, 0.0]], [1]), equal_to(2.0)),
        answers(
            "metrics.expected_calibration_error",
            "sure at .8, right at .5",
            lambda: expected_calibration_error([[0.8, 0.2], [0.8, 0.2]], [0, 1]),
            equal_to(0.3),
        ),
        refuses(
            "metrics.expected_calibration_error",
            "no bins",
            lambda: expected_calibration_error(_EVEN, [0, 1], num_bins=0),
            ValueError,
            "(?i)bins",
        ),
        answers(
            "metrics.reliability_curve",
            "one row in fifteen bins",
            lambda: int(np.sum(reliability_curve([[0.7, 0.3]], [0]).count)),
            equal_to(1),
        ),
        answers(
            "metrics.reliability_diagram",
            "certain and wrong: one point at the lower right, far from its band",
            lambda: reliability_diagram([[1.0, 0.0]] * 3, [1] * 3, Figure().subplots()).is_consistent.tolist(),
            equal_to([False]),
        ),
        answers(
            "metrics.shape_scores",
            "a shape that never came and was never guessed",
            lambda: all(
                np.isfinite([s.precision, s.recall, s.f1]).all()
                for s in shape_scores(confusion_matrix(np.eye(3)[:2], [0, 1]))
            ),
            such_that("finite scores", bool),
        ),
        answers("metrics.accuracy", "a tie: the first shape", lambda: accuracy(_EVEN, [0, 1]), equal_to(0.5)),
        answers(
            "metrics.null_quantile",
            "certain predictions: no chance",
            lambda: null_quantile(np.eye(2), expected_calibration_error, _rng(), num_resamples=20),
            equal_to(0.0),
        ),
        refuses(
            "metrics.bias_corrected_interval",
            "one row",
            lambda: bias_corrected_interval([[0.9, 0.1]], [0], brier_score, _rng(), num_resamples=20),
            ValueError,
            "at least two clusters",
        ),
        answers(
            "metrics.calibration_report",
            "one row of one shape",
            lambda: calibration_report([[1.0]], [0], num_resamples=10).accuracy,
            equal_to(1.0),
        ),
        answers(
            "metrics.calibration_at_stop",
            "one search that claimed certainty and was wrong",
            lambda: calibration_at_stop([1.0], [False], [3]).overall.is_consistent,
            equal_to(False),
        ),
        *refusals(
            "metrics.calibration_at_stop",
            ValueError,
            {
                "no searches": (lambda: calibration_at_stop([], [], []), "(?i)one|empty"),
                "a stated confidence of 1.5": (lambda: calibration_at_stop([1.5], [True], [1]), "1.5"),
            },
        ),
        answers("auroc", "ties only", lambda: auroc([1, 1, 1], [1, 1]), equal_to(0.5)),
        refuses("auroc", "nothing known", lambda: auroc([], [1.0]), ValueError, "(?i)empty|at least one"),
    ]


def _statistics() -> list[Case]:
    return [
        answers("wilson_interval", "0 of 1", lambda: wilson_interval(0, 1)[0], equal_to(0.0)),
        answers("wilson_interval", "1e15 of 1e15", lambda: wilson_interval(10**15, 10**15)[1], equal_to(1.0)),
        answers(
            "clopper_pearson_interval",
            "0 of 100: rule of three",
            lambda: clopper_pearson_interval(0, 100)[1],
            equal_to(1 - 0.025**0.01),
        ),
        *refusals(
            "wilson_interval",
            ValueError,
            {
                "no trials": (lambda: wilson_interval(0, 0), "0 of 0"),
                "2 of 1": (lambda: wilson_interval(2, 1), "2 of 1"),
                "a confidence of 95": (lambda: wilson_interval(1, 2, 95), r"\(0, 1\), got 95"),
            },
        ),
        refuses("clopper_pearson_interval", "NaN trials", lambda: clopper_pearson_interval(1, _NAN), ValueError, "nan"),  # type: ignore[arg-type]
        answers("paired_bootstrap", "one pair", lambda: paired_bootstrap([1], [0], _rng()), equal_to([1, 1, 1])),
        answers(
            "paired_bootstrap",
            "differences that are all equal",
            lambda: paired_bootstrap([0.3] * 9, [0.1] * 9, _rng()),
            equal_to([0.2] * 3),
        ),
        *refusals(
            "paired_bootstrap",
            ValueError,
            {
                "lists of different lengths": (lambda: paired_bootstrap([1, 0], [1], _rng()), "equally long"),
                "NaN in place 1": (lambda: paired_bootstrap([1, _NAN], [1, 1], _rng()), r"at \[1\]"),
            },
        ),
        answers(
            "cluster_bootstrap", "one cluster", lambda: cluster_bootstrap([0, 1], [7, 7], _rng()), equal_to([0.5] * 3)
        ),
        answers(
            "mcnemar_test",
            "two deciders that never differ",
            lambda: mcnemar_test([1, 0], [1, 0]).p_value,
            equal_to(1.0),
        ),
        refuses("mcnemar_test", "no episodes", lambda: mcnemar_test([], []), ValueError, "at least one"),
        answers("pareto_front", "one configuration", lambda: pareto_front([1.0], [0.0]), equal_to([True])),
        answers(
            "pareto_front", "equal configurations", lambda: pareto_front([1.0, 1.0], [0.5, 0.5]), equal_to([True, True])
        ),
        refuses("pareto_front", "an infinite cost", lambda: pareto_front([math.inf], [0.5]), ValueError, "finite"),
    ]


CASES: tuple[Case, ...] = (*_calibrations(), *_observation_models(), *_metrics(), *_statistics())
"""Of calibrations, observation models, metrics, out-of-distribution scores and statistics."""


@pytest.mark.parametrize("case", CASES, ids=str)
def test_an_extreme_is_answered_rightly_or_refused_with_a_reason(case):
    finding = judge(case)
    assert finding.verdict is not Verdict.FAILED, f"expected {case.expected.words}; {finding.happened}"
