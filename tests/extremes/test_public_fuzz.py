"""Every public name of belief on numbers nobody would choose: an answer without NaN, or an error that says why.

A public name that is not in the table below fails a test; so does one that is there and gone.
"""

import inspect
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib import figure

import belief
from belief import (
    Belief,
    Touch,
    arrangement,
    bayes,
    calibration,
    estimators,
    metrics,
    observation_model,
    statistics,
    synthetic,
    touch_batch,
    validation,
)
from belief.observation_model import selection
from belief.observation_model.plda import Components, LogitEmbedding
from belief.table import Tabular
from belief.touch_batch import TouchBatch

pytestmark = pytest.mark.filterwarnings("ignore:logits has no negative number:UserWarning")
EXTREMES = (0.0, -0.0, 1.0, 0.5, 1 / 3, 1e-3, np.inf, -np.inf, np.nan, 5e-324, 1e-310, 1e-300, 1e308, -1e308, -1.0, 6e4)
LABELS = ("ball", "cube", "cone")
SHAPES = np.array([0, 1, 2, 1])
MODULES = (
    belief,
    touch_batch,
    arrangement,
    bayes,
    calibration,
    estimators,
    metrics,
    observation_model,
    validation,
    selection,
    statistics,
    synthetic,
)


def rng():
    return np.random.default_rng(0)


def embedding():
    return LogitEmbedding(np.full(3, -9.0), np.full(3, 9.0))


def world(probs):
    table = observation_model.OutcomeTable(np.stack([probs[:3]] * 2))
    return observation_model.ConfusionModel(LABELS, table.probs, calibration.TemperatureScaling(1.0, "ok"))


def one_body(values):
    fitted = observation_model.FittedRigidBody(LABELS, 4, 1.0, values[None], values[None, :, :3])
    return fitted.with_hypotheses(observation_model.FixedHypotheses(np.stack([values] * 3)[None]))


def normalised(log_probs):
    """These logarithms of probabilities, which sum to one."""
    np.testing.assert_allclose(np.exp(log_probs).sum(axis=-1), 1.0, rtol=1e-9)
    return log_probs


def at_most(bound, values):
    """These values, which lie between zero and a bound."""
    assert ((np.asarray(values) >= 0.0) & (np.asarray(values) <= bound + 1e-12)).all()
    return values


def touches(values):
    return [Touch(i % 2, row) for i, row in enumerate(values)]


def likelihood(kind):
    """A model of this kind fitted to ordinary touches asked about others, and one fitted to all of them."""

    def call(values):
        ordinary = [Touch(i % 2, 2.0 * np.eye(3)[i % 3] + 0.1 * i) for i in range(9)]
        ids = np.arange(9 + len(values)) // 2 * 3 + np.concatenate([np.arange(9) % 3, SHAPES])
        model = fitted.setdefault(kind, kind.fit(ordinary, np.arange(9) % 3, ids[:9], num_poses=2))
        every = kind.fit([*ordinary, *touches(values)], np.concatenate([np.arange(9) % 3, SHAPES]), ids, num_poses=2)
        return model.log_likelihood(touches(values)), every.log_likelihood(touches(values))

    return call


fitted: dict = {}


def about_logits(kind):
    def call(values):
        found = kind().fit(values, SHAPES)
        return found.predict_log_proba(values), found.predict_proba(values), found.objective(values, SHAPES)

    return call


def tracked_one(values):
    tracker = belief.BeliefTracker(Belief.from_probs(LABELS, np.full(3, 1 / 3)), Told())
    for touch in touches(values):
        tracker.update(touch)
    return normalised(tracker.belief.log_probs), tracker.log_evidence


class Told:
    """A model whose likelihoods are the logits."""

    shape_labels = LABELS

    def log_likelihood(self, some):
        with np.errstate(over="ignore", invalid="ignore"):
            return np.sum([touch.logits for touch in some], axis=0) if some else np.zeros(3)


def scene(values):
    problem = belief.SearchProblem(LABELS, ("p", "q"), 3)
    scene = belief.SceneBelief(problem, Told())
    for i in range(3):
        scene.update(i, touches(values[i : i + 1]))
    return normalised(scene.log_marginals()), at_most(1.0, scene.prob_present(0))


def as_labels(values):
    """Integers from numbers, as a caller's array of them may be."""
    return np.nan_to_num(np.asarray(values, np.float64), posinf=3, neginf=-3).clip(-3, 3).astype(int)


# What to do with an array (4, 3): of probabilities, of scores, of anything.
CALLS = {
    # belief
    "Belief": lambda a: (
        normalised(Belief.from_probs(LABELS, a[0]).update(np.minimum(-a[1], 0.0)).log_probs),
        normalised(Belief(LABELS, a[1]).log_probs),
        at_most(np.log(3.0), Belief(LABELS, a[1]).entropy),
    ),
    "BeliefTracker": tracked_one,
    "Composition": lambda a: belief.Composition(a[0, 0]).value,
    "Counts": lambda a: belief.Counts(dict(zip(LABELS, a[0].tolist(), strict=True))).total,
    "SceneBelief": scene,
    "SearchProblem": lambda a: belief.SearchProblem(LABELS, ("p",), 2, touch_cost=float(a[0, 0])).reward(0, 0, 2),
    "Touch": lambda a: Touch(0, a[0]).logits,
    "TouchHistory": lambda a: belief.TouchHistory(touches(a)).uses(2),
    # arrangement
    "arrangement_marginals": lambda a: at_most(1.0 + 1e-9, arrangement.arrangement_marginals(a[:3]).sum(axis=0)),
    "log_arrangement_marginals": lambda a: normalised(arrangement.log_arrangement_marginals(a[:3])),
    "log_at_most_one_marginals": lambda a: normalised(arrangement.log_at_most_one_marginals(a[:3], 1)),
    "prob_at_most_one_present": lambda a: arrangement.prob_at_most_one_present(
        np.exp(arrangement.log_at_most_one_marginals(a[:3], 1)), 1, 0
    ),
    "prob_shape_absent": lambda a: arrangement.prob_shape_absent(a[:3], None, 0),
    "blank_objects": lambda a: arrangement.blank_objects(a, (2, 1, 1)),
    "num_states": lambda a: arrangement.num_states(as_labels(a[0]).tolist(), 2),
    # batch, bayes
    "TouchBatch": lambda a: (
        TouchBatch.of([touches(a)]).logits,
        TouchBatch(np.zeros((1, 4), int), a[None], a[None]).features,
    ),
    "update": lambda a: (
        [(normalised(posterior), evidence) for posterior, evidence in (bayes.update(np.log(np.full(3, 1 / 3)), a),)],
        normalised(bayes.update(a, a)[0]),
    ),
    "entropy": lambda a: at_most(np.log(3.0), bayes.entropy(a)),
    "expected_information_gain": lambda a: at_most(np.log(3.0), bayes.expected_information_gain(a, a[None, :3])),
    "target_information_gain": lambda a: at_most(np.log(2.0), bayes.target_information_gain(a, a[None, :3], 1)),
    "layers": lambda a: len(arrangement.layers(tuple(as_labels(a[0]).clip(0).tolist()), 2)),
    # calibration
    "DirichletCalibration": about_logits(calibration.DirichletCalibration),
    "StructuredMatrixScaling": about_logits(calibration.StructuredMatrixScaling),
    "TemperatureScaling": about_logits(calibration.TemperatureScaling),
    "VectorScaling": about_logits(calibration.VectorScaling),
    "PerPose": lambda a: calibration.PerPose().fit(a, SHAPES, SHAPES % 2).predict_log_proba(a, SHAPES % 2),
    "logits_from_probs": calibration.logits_from_probs,
    # estimators
    "CalibratedClassifier": lambda a: normalised(
        np.log(estimators.CalibratedClassifier().fit(a, np.array(LABELS)[SHAPES]).predict_proba(a))
    ),
    "ObservationModelClassifier": lambda a: (
        estimators.ObservationModelClassifier(num_folds=2)
        .fit(a, np.array(LABELS)[SHAPES], SHAPES)
        .predict_proba(a, SHAPES)
    ),
    # metrics
    "accuracy": lambda a: metrics.accuracy(a, SHAPES),
    "brier_score": lambda a: metrics.brier_score(a, SHAPES),
    "calibration_report": lambda a: metrics.calibration_report(a, SHAPES, num_resamples=2),
    "calibration_at_stop": lambda a: metrics.calibration_at_stop(a[:, 0], a[:, 1] > 0.5, np.arange(4)),
    "classwise_calibration_error": lambda a: metrics.classwise_calibration_error(a, SHAPES),
    "confusion_matrix": lambda a: metrics.confusion_matrix(a, SHAPES),
    "expected_calibration_error": lambda a: metrics.expected_calibration_error(a, SHAPES),
    "negative_log_likelihood": lambda a: metrics.negative_log_likelihood(a, SHAPES),
    "null_quantile": lambda a: metrics.null_quantile(a, metrics.brier_score, rng(), num_resamples=3),
    "reliability_curve": lambda a: metrics.reliability_curve(a, SHAPES, binning="mass"),
    "reliability_diagram": lambda a: metrics.reliability_diagram(a, SHAPES, figure.Figure().subplots()),
    "shape_scores": lambda a: metrics.shape_scores(a[:3]),
    "smooth_calibration_error": lambda a: metrics.smooth_calibration_error(a, SHAPES),
    # observation models
    "ConfusionModel": lambda a: (likelihood(observation_model.ConfusionModel)(a), world(a).log_likelihood(touches(a))),
    "GaussianModel": lambda a: (
        likelihood(observation_model.GaussianModel)(a),
        observation_model.GaussianModel(
            LABELS, embedding(), a[None, :3, :2], Components(0 * a[:2, :2], 0 * a[:2, :2], a[:2, :2])
        ).log_likelihood([Touch(0, np.zeros(3))]),
    ),
    "HeavyTailsModel": lambda a: (
        likelihood(observation_model.HeavyTailsModel)(a),
        observation_model.HeavyTailsModel(LABELS, 1.0, a[None, :3], a[3], a[3], 0.5).log_likelihood(
            [Touch(0, row) for row in a]
        ),
    ),
    "PLDAModel": lambda a: (
        likelihood(observation_model.PLDAModel)(a),
        observation_model.PLDAModel(
            LABELS,
            embedding(),
            a[None, :3, :2],
            Components(a[:2, :2], a[2:, :2], np.eye(2)),
        ).log_likelihood([Touch(0, np.zeros(3))] * 3),
    ),
    "fit_observation_model": lambda a: [
        *observation_model.fit_observation_model(
            np.tile(a, (2, 1)), np.tile(SHAPES, 2), np.arange(8) % 4, num_folds=2
        ).losses.values()
    ],
    "calibration_of_stops": lambda a: (
        observation_model.calibration_of_stops(
            world(np.eye(3) * 0.9 + 1 / 30), np.vstack([a, a]), np.tile(SHAPES, 2), np.tile(SHAPES, 2), 0.5
        ).confidence
    ),
    "certified_stops": lambda a: (
        observation_model.certified_stops(
            world(np.eye(3) * 0.9 + 1 / 30), np.vstack([a, a]), np.tile(SHAPES, 2), np.tile(SHAPES, 2), 0.5
        ).stops
    ),
    "FixedHypotheses": lambda a: observation_model.FixedHypotheses(a[None, None])(4),
    "FixedWorlds": lambda a: observation_model.FixedWorlds(a[None, None, None]).in_pose(0),
    "SensorHealthModel": lambda a: observation_model.SensorHealthModel(
        one_body(a), observation_model.FixedWorlds(np.stack([a] * 3)[None, None]), ("soft",), a[0, :3]
    ),
    "spread_prior": lambda a: observation_model.spread_prior(2, *a[0, :2]),
    "FittedRigidBody": lambda a: one_body(a).outcome_table(2).probs,
    "RigidBodyModel": lambda a: (
        one_body(a).log_likelihood([Touch(0, features=row) for row in a]),
        one_body(a).start().update(Touch(0, features=a[0])).diagnostics,
        one_body(a).sample_batch(1, np.zeros((2, 2), int), rng()).features,
    ),
    "RatioModel": lambda a: (
        likelihood(observation_model.RatioModel)(a),
        observation_model.RatioModel(
            LABELS, calibration.TemperatureScaling(), a[0], float(a[1, 0]), a[None]
        ).log_likelihood([Touch(0, np.zeros(3))] * 3),
    ),
    "OutcomeTable": lambda a: observation_model.OutcomeTable(a[None]).information(),
    "read_observation_model": lambda a: observation_model.read_observation_model(str(a.tolist())),
    "read_origin": lambda a: observation_model.read_origin(str(a.tolist())),
    # rows, selection, synthetic
    "checked_outcomes": lambda a: validation.checked_outcomes("a", a[:, 0]).astype(float),
    "checked_pair": lambda a: validation.checked_pair(a, SHAPES)[0],
    "checked_probs": validation.checked_probs,
    "checked_values": lambda a: validation.checked_values("a", a),
    "log_sum": lambda a: validation.log_sum(validation.finite_logits(a), axis=-1),
    "log_softmax": lambda a: validation.log_softmax(validation.finite_logits(a)),
    "finite_logits": validation.finite_logits,
    "labelled_logits": lambda a: validation.labelled_logits(a, SHAPES)[0],
    "require_fraction": lambda a: validation.require_fraction("a", float(a[0, 0])),
    "unmasked": lambda a: validation.unmasked(a, "a").shape,
    "as_logs": lambda a: (validation.as_logs("a", -a, "b", None), validation.as_logs("a", None, "b", a)),
    "as_real": lambda a: validation.as_real(a, "a").dtype.itemsize,
    "require": lambda a: validation.require(a >= 0.0, a, "a", "what is below zero"),
    "checked_indices": lambda a: validation.checked_indices("a", as_labels(a[:, 0]), 3),
    "normalise_log_probs": lambda a: normalised(validation.normalise_log_probs(a)),
    "normalise_probs": lambda a: at_most(1.0 + 1e-9, validation.normalise_probs(a).sum(axis=-1)),
    "renormalised": lambda a: validation.renormalised(validation.normalise_probs(a)),
    "log_posteriors": lambda a: selection.log_posteriors(world(np.full((3, 3), 1 / 3)), TouchBatch.of([touches(a)])),
    "log_posteriors_by_touch": lambda a: selection.log_posteriors_by_touch(
        world(np.full((3, 3), 1 / 3)), TouchBatch.of([touches(a)])
    ),
    "grouped": lambda a: [index for _, index in touch_batch.grouped(TouchBatch.of([touches(np.eye(4, 3))]), a[:, 0])],
    "choose_observation_model": lambda a: selection.choose_observation_model(
        touches(a),
        SHAPES,
        SHAPES,
        shape_labels=LABELS,
        num_poses=2,
        candidates=dict.fromkeys(("confusion", "again"), observation_model.ConfusionModel.fit),
        num_folds=2,
    ).losses["confusion"],
    "random_model": lambda a: synthetic.random_model(rng(), 2, 1, float(a[0, 0])).probs,
    "SyntheticWorld": lambda a: synthetic.SyntheticWorld(world(a), [0, 1]).touch(0, rng()).logits,
    # statistics
    "clopper_pearson_interval": lambda a: statistics.clopper_pearson_interval(a[0, 0], a[0, 1], a[0, 2]),
    "cluster_bootstrap": lambda a: statistics.cluster_bootstrap(a[0], a[1], rng(), num_resamples=3),
    "mcnemar_test": lambda a: statistics.mcnemar_test(a[0], a[1]),
    "paired_bootstrap": lambda a: statistics.paired_bootstrap(a[0], a[1], rng(), num_resamples=3),
    "pareto_front": lambda a: statistics.pareto_front(a[0], a[1]),
    "wilson_interval": lambda a: statistics.wilson_interval(a[0, 0], a[0, 1], a[0, 2]),
}
NO_NUMBERS = {
    "check_observation_model": "of a model",
    "SceneView": "of a scene",
    "at": "an index",
    "pose_count": "indices",
    "require_count": "one integer",
    "require_index": "one integer",
    "require_number": "one number",
    "require_choice": "a word",
    "warn_of_probs": "a warning",
    "warn_of_one_shape": "a warning",
    "are_finite": "numbers, to answer whether they are finite",
    "read_origin": "text",
    "sample_arrangement": "of a problem",
}
INFINITE = {"negative_log_likelihood", "calibration_report"}  # +inf where a label had no probability


def is_made_by_others(kind):
    """Records without methods, protocols, abstract classes and exceptions; reports that functions return."""
    methods = [n for n, member in vars(kind).items() if not n.startswith("_") and inspect.isroutine(member)]
    return (
        issubclass(kind, Exception)
        or inspect.isabstract(kind)
        or getattr(kind, "_is_protocol", False)
        or (is_dataclass(kind) and not hasattr(kind, "__post_init__") and not methods)
        or issubclass(kind, Tabular)
        or kind in (metrics.CalibrationReport, metrics.ReliabilityCurve)
    )


def public_names():
    """What packages export and other modules define, without records, protocols, abstract classes and exceptions."""
    for module in MODULES:
        for name in getattr(module, "__all__", vars(module)):
            member = getattr(module, name)
            is_own = hasattr(module, "__all__") or getattr(member, "__module__", None) == module.__name__
            if name.startswith("_") or not is_own or not (inspect.isfunction(member) or inspect.isclass(member)):
                continue
            if inspect.isclass(member) and is_made_by_others(member):
                continue
            yield name


def test_no_public_name_is_missing_from_the_table():
    assert set(public_names()) == set(CALLS) | set(NO_NUMBERS)


@st.composite
def anything(draw):
    """Extreme numbers; or rows that are distributions, some of them spoilt; of any type of float."""
    dtype = draw(st.sampled_from([np.float64, np.float64, np.float32, np.float16]))
    if draw(st.booleans()):
        values = draw(arrays(np.float64, (4, 3), elements=st.sampled_from(EXTREMES)))
    else:
        values = draw(arrays(np.float64, (4, 3), elements=st.sampled_from([0.0, 0.0, 1.0, 0.5, 1e-300, 5e-324])))
        values[values.max(axis=1) < 0.1, 0] = 1.0
        values /= values.sum(axis=1, keepdims=True)
        for _ in range(draw(st.integers(0, 1))):
            values[draw(st.integers(0, 3)), draw(st.integers(0, 2))] = draw(st.sampled_from(EXTREMES))
    with np.errstate(over="ignore"):
        return values.astype(dtype)


def numbers_in(result):
    """All numbers of a result, however they are packed."""
    if result is None or isinstance(result, str | bytes):
        return
    if is_dataclass(result):
        for field in fields(result):
            yield from numbers_in(getattr(result, field.name))
    elif isinstance(result, tuple | list):
        for part in result:
            yield from numbers_in(part)
    else:
        yield np.asarray(result, np.float64)


@pytest.mark.parametrize("name", CALLS)
def test_an_answer_without_nan_or_an_error_that_says_why(name):
    answers = 0

    @settings(max_examples=10)
    @given(anything())
    def attempt(values):
        nonlocal answers
        try:
            result = CALLS[name](values)
        except (ValueError, belief.ActiveTouchError) as error:
            assert str(error)  # noqa: PT017
            return
        answers += 1
        for found in numbers_in(result):
            assert not np.isnan(found).any()
            assert name in INFINITE or not (found == np.inf).any()  # log probabilities may well be -inf

    attempt()
    assert answers >= 2 or name in {*ORDINARY, *REFUSE_ALL_NUMBERS}  # refusing nearly everything proves nothing


# What to do with numbers that are hardly ever right by chance, so that each name answers something.
ORDINARY = {
    "Belief": np.stack([np.full(3, 1 / 3), np.log(np.full(3, 1 / 3))]),
    "Counts": np.array([[2, 1, 0]]),
    "GaussianModel": np.eye(4, 3),
    "HeavyTailsModel": np.full((4, 3), 0.5),
    "PLDAModel": np.vstack([np.eye(2, 3), np.eye(2, 3)]),
    "RatioModel": np.full((4, 3), 1 / 3),
    "checked_outcomes": np.eye(4, 3),
    "clopper_pearson_interval": np.array([[3, 5, 0.95]]),
    "mcnemar_test": np.eye(4, 3),
    "normalise_log_probs": np.log(np.full((4, 3), 1 / 3)),
    "numbered_objects": np.arange(12.0).reshape(4, 3),
    "require_fraction": np.array([[0.5]]),
    "update": np.log(np.full((4, 3), 1 / 3)),
    "wilson_interval": np.array([[3, 5, 0.95]]),
}
REFUSE_ALL_NUMBERS = {"Composition", "read_observation_model", "read_origin"}


@pytest.mark.parametrize("name", CALLS)
def test_ordinary_numbers_are_answered(name):
    values = ORDINARY.get(name, np.array([[0.5, 0.3, 0.2], [0.1, 0.8, 0.1], [0.2, 0.2, 0.6], [0.3, 0.6, 0.1]]))
    if name in REFUSE_ALL_NUMBERS:
        with pytest.raises(ValueError, match=r"."):
            CALLS[name](values)
    else:
        assert all(not np.isnan(found).any() for found in numbers_in(CALLS[name](values.copy())))
