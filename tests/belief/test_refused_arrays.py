"""What is no array of numbers, or stands for an absurd size, is refused by name, at once."""

from dataclasses import fields, replace

import numpy as np
import pytest

from belief import ActiveTouchError, Belief, Touch, files, metrics, seeding, statistics, validation
from belief.arrangement import arrangement_marginals
from belief.bayes import entropy, update
from belief.calibration import CALIBRATIONS, PerPose
from belief.errors import InvalidArgument
from belief.observation_model import (
    ConfusionModel,
    FixedHypotheses,
    GaussianModel,
    HeavyTailsModel,
    OutcomeTable,
    PLDAModel,
    RatioModel,
    RigidBodyModel,
)
from belief.observation_model.registry import OBSERVATION_MODELS

pytestmark = pytest.mark.filterwarnings("ignore:logits has no negative number:UserWarning")
FITS = {name: kind.fit for name, kind in OBSERVATION_MODELS.items()}
PROBS = np.array([[0.8, 0.2], [0.3, 0.7], [0.6, 0.4], [0.5, 0.5]])
TRUTH = np.array([0, 1, 0, 1])
NO_NUMBERS = {
    "masked": lambda a: np.ma.masked_array(a, np.arange(a.size).reshape(a.shape) == 1),
    "text": lambda a: a.astype(str),
    "objects": lambda a: a.astype(object),
    "booleans": lambda a: a > 0.5,
}
OF_NUMBERS = {
    **{f"fit {name}": (lambda a, kind=kind: kind().fit(a, TRUTH)) for name, kind in CALIBRATIONS.items()},
    **{f"predict {name}": (lambda a, kind=kind: kind().predict_log_proba(a)) for name, kind in CALIBRATIONS.items()},
    "PerPose": lambda a: PerPose().fit(a, TRUTH, np.zeros(4, int)),
    "update": lambda a: update(np.log([0.5, 0.5]), a),
    "a prior": lambda a: update(np.log(a) if a.dtype == float and type(a) is np.ndarray else a, [0.0, 0.0]),
    "entropy": entropy,
    "Belief": lambda a: Belief.from_probs(("a", "b"), a[0]),
    "arrangement_marginals": lambda a: arrangement_marginals(a[:2]),
    "accuracy": lambda a: metrics.accuracy(a, TRUTH),
    "brier_score": lambda a: metrics.brier_score(a, TRUTH),
    "expected_calibration_error": lambda a: metrics.expected_calibration_error(a, TRUTH),
    "negative_log_likelihood": lambda a: metrics.negative_log_likelihood(a, TRUTH),
    "null_quantile": lambda a: metrics.null_quantile(a, metrics.brier_score, np.random.default_rng(0)),
    "calibration_at_stop": lambda a: metrics.calibration_at_stop(a[:, 0], TRUTH, TRUTH),
}


@pytest.mark.parametrize("what", NO_NUMBERS)
@pytest.mark.parametrize("name", OF_NUMBERS)
def test_arrays_of_no_numbers_are_refused(name, what):
    OF_NUMBERS[name](PROBS)
    wrong = np.repeat(NO_NUMBERS[what](PROBS), 1, axis=0) if what != "masked" else np.ma.masked_array(PROBS, PROBS > 0)
    with pytest.raises(ActiveTouchError, match=r"masked|real numbers"):
        OF_NUMBERS[name](wrong)


@pytest.mark.parametrize("what", ["masked", "text", "objects"])
def test_statistics_of_no_numbers_are_refused(what):
    x, rng = TRUTH.astype(float), np.random.default_rng(0)
    wrong = NO_NUMBERS[what](x)
    for call in (
        lambda: statistics.paired_bootstrap(wrong, x, rng),
        lambda: statistics.mcnemar_test(wrong, x),
        lambda: statistics.pareto_front(wrong, x),
    ):
        with pytest.raises(ActiveTouchError, match=r"masked|array of"):
            call()


def test_masked_labels_are_refused():
    masked = np.ma.masked_equal(TRUTH, 1)
    for call in (
        lambda: CALIBRATIONS["temperature"]().fit(PROBS, masked),
        lambda: metrics.accuracy(PROBS, masked),
        lambda: ConfusionModel.fit([Touch(0, row) for row in PROBS], masked),
    ):
        with pytest.raises(ActiveTouchError, match="masked"):
            call()


@pytest.mark.parametrize("options", [{}, {"num_poses": 10**9}])
@pytest.mark.parametrize("kind", [ConfusionModel, GaussianModel, HeavyTailsModel, PLDAModel, RatioModel, PerPose])
def test_a_pose_number_that_no_data_can_have_is_refused_before_it_takes_memory(kind, options):
    poses = [0, 1, 0, 1 if options else 10**9]
    touches = [Touch(pose, row) for pose, row in zip(poses, PROBS, strict=True)]
    data = (PROBS, TRUTH, poses) if kind is PerPose else (touches, TRUTH, np.arange(4))
    fit = kind().fit if kind is PerPose else kind.fit
    with pytest.raises(ActiveTouchError, match="1000"):
        fit(*data, **options)


@pytest.mark.parametrize("name", FITS)
def test_an_array_in_place_of_touches_is_told_what_works(name):
    embed = (
        {"embed": lambda number: np.zeros((1, 2, number, 2), np.float32)}
        if OBSERVATION_MODELS[name].reads == "embeddings"
        else {}
    )
    for wrong in (PROBS, PROBS.tolist(), [Touch(0, PROBS[0]), *PROBS[1:]]):
        with pytest.raises(
            ActiveTouchError, match=r"touch [01] of sequence 0 must be a Touch, such as Touch\(pose, log"
        ):
            FITS[name](wrong, TRUTH, np.arange(4), **embed)


def fitted_models():
    """One of every kind of observation model that is made from arrays, and of the embeddings that some hold."""
    rng = np.random.default_rng(0)
    touches = [Touch(i % 2, 2.0 * np.eye(2)[i % 2] + rng.normal(size=2), rng.normal(size=4)) for i in range(40)]
    labels, ids = np.arange(40) % 2, np.arange(40) // 4 * 2 + np.arange(40) % 2
    hypotheses, references = rng.normal(size=(2, 2, 3, 4)).astype(np.float32), rng.normal(size=(2, 5, 4))
    found = {name: fit(touches, labels, ids) for name, fit in FITS.items() if name != "rigid body"}
    return {
        **found,
        "fixed hypotheses": FixedHypotheses(hypotheses),
        "rigid body": RigidBodyModel(
            ("a", "b"), 3, 1.0, references, references[..., :2], hypotheses=FixedHypotheses(hypotheses)
        ),
        "OutcomeTable": OutcomeTable(np.full((2, 2, 2), 0.5)),
        "LogitEmbedding": found["plda"].embedding,
        "VectorScaling": CALIBRATIONS["vector"]().fit(logits=2.0 * np.eye(2), labels=[0, 1]),
    }


MADE = fitted_models()


@pytest.mark.parametrize("name", MADE)
def test_no_record_is_made_of_arrays_that_are_none(name):
    made = MADE[name]
    for field in fields(made):
        value = getattr(made, field.name)
        if not isinstance(value, np.ndarray):
            continue
        first = np.arange(value.size).reshape(value.shape) == 0
        for wrong in (np.where(first, np.nan, value), np.ma.masked_array(value, first), value.astype(str)):
            with pytest.raises(ValueError, match=r"."):
                replace(made, **{field.name: wrong})
        again = replace(made, **{field.name: np.ma.masked_array(value, False)})
        assert type(getattr(again, field.name)) is np.ndarray


@pytest.mark.parametrize("name", [name for name, made in MADE.items() if "shape_labels" in vars(made)])
def test_no_model_has_labels_that_are_no_different_names(name):
    for wrong, message in ((("a", "a"), "differ"), ("ab", "sequence of names"), ((1, 2), "sequence of names")):
        with pytest.raises(InvalidArgument, match=f"shape_labels must .*{message}|shape_labels must {message}"):
            replace(MADE[name], shape_labels=wrong)
    assert replace(MADE[name], shape_labels=["a", "b"]).shape_labels == ("a", "b")


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("field", ["hypotheses", "references", "reference_logits"])
def test_a_model_of_one_body_has_finite_tables(field, number):
    model = MADE["rigid body"]
    wrong = np.array(model.table if field == "hypotheses" else getattr(model, field))
    wrong.flat[-1] = number
    with pytest.raises(ValueError, match=rf"{field}.*finite"):
        FixedHypotheses(wrong) if field == "hypotheses" else replace(model, **{field: wrong})
    if field == "hypotheses":
        with pytest.raises(ValueError, match=r"hypotheses must be finite, got .* at \[1, 1, 2, 3\]"):
            assert replace(MADE["rigid body"], hypotheses=lambda number: wrong).table.size


@pytest.mark.parametrize(
    ("check", "arguments", "message"),
    [
        (validation.require_count, ("number", 1, 2), "number must be an integer, at least 2, got 1"),
        (validation.require_index, ("number", -1, 4), r"number must be an integer in \[0, 4\), got -1"),
        (validation.require_number, ("number", np.nan, 0.0, 1.0), r"number must be a number in \[0, 1\], got nan"),
        (validation.require_choice, ("kind", "fine", ["ok", "no"]), "kind must be one of ok, no; got 'fine'"),
        (validation.require_fraction, ("number", 95), r"number must be a number in \(0, 1\), got 95"),
        (validation.checked_indices, ("number", [0, 2], 2), r"number must be integers in \[0, 2\), got 2 in row 1"),
        (
            validation.checked_indices,
            ("labels", ["mug"], 2),
            r"got <U3; np.unique\(names, return_inverse=True\) numbers",
        ),
        (seeding.checked_key, ([3, -1],), r"integers ≥ 0, got -1 in \[3, -1\]"),
        (files.plain_number, ("1_000",), "'1_000' is not a decimal number"),
    ],
)
def test_what_is_out_of_range_is_named(check, arguments, message):
    with pytest.raises(ValueError, match=message):
        check(*arguments)
