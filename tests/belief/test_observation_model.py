"""Probability laws every observation model must obey, and what is particular to the confusion model."""

import numpy as np
import pytest
from scipy import stats

from belief import Touch
from belief.calibration import TemperatureScaling
from belief.observation_model import ConfusionModel, OutcomeTable, read_observation_model
from belief.synthetic import random_model

# Every observation model the package has; the laws below run on each.
MODELS = {
    "confusion": random_model(np.random.default_rng(1)),
    "confusion, confidence bins": ConfusionModel(
        ("a", "b", "c"),
        np.random.default_rng(2).dirichlet(np.ones(6), size=(2, 3)),
        TemperatureScaling(1.7, "ok"),
        confidence_edges=(0.8,),
    ),
    "confusion, floored calibration": ConfusionModel(
        ("a", "b", "c"),
        np.random.default_rng(3).dirichlet(np.ones(9), size=(2, 3)),
        TemperatureScaling(1e-6, "separable", floor=0.05),
        confidence_edges=(0.9, 0.95),
    ),
}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())


@every_model
def test_the_outcome_table_holds_distributions(model):
    table = model.outcome_table()
    assert table.num_shapes == len(model.shape_labels)
    np.testing.assert_allclose(table.probs.sum(axis=2), 1.0)


@every_model
def test_samples_have_the_outcome_frequencies_of_the_table(model, rng):
    # Pearson's chi-square on 4 000 samples; a right model fails with probability 1e-4, the seed is fixed.
    touches = model.sample(1, [0] * 4000, rng)
    expected = model.outcome_table().probs[0, 1] * 4000
    observed = np.bincount(model.outcomes(touches), minlength=expected.size)
    assert stats.chisquare(observed, expected).pvalue > 1e-4


@every_model
def test_no_touches_are_no_evidence(model):
    assert model.log_likelihood([]).tolist() == [0.0] * len(model.shape_labels)


@every_model
def test_order_of_touches_does_not_matter(model, rng):
    touches = model.sample(0, [0, 1, 0, 1], rng)
    np.testing.assert_allclose(model.log_likelihood(touches), model.log_likelihood(touches[::-1]), atol=1e-12)


@every_model
def test_likelihoods_of_the_true_shape_win_in_the_long_run(model, rng):
    for shape in range(len(model.shape_labels)):
        assert model.log_likelihood(model.sample(shape, [0, 1] * 100, rng)).argmax() == shape


@every_model
def test_json_keeps_every_bit(model):
    copy = read_observation_model(model.to_json())
    np.testing.assert_array_equal(copy.probs, model.probs)
    assert (copy.shape_labels, copy.calibration, copy.confidence_edges) == (
        model.shape_labels,
        model.calibration,
        model.confidence_edges,
    )


def touches_from(table: np.ndarray, n: int, rng) -> tuple[list[Touch], np.ndarray]:
    """One-hot touches in pose 0 and 1, alternating, with the outcome frequencies of a (P, K, K) table."""
    shapes = rng.integers(table.shape[1], size=n)
    poses = np.arange(n) % 2
    outcomes = [rng.choice(table.shape[2], p=table[p, k]) for p, k in zip(poses, shapes, strict=True)]
    return [Touch(int(p), 4.0 * np.eye(table.shape[2])[m]) for p, m in zip(poses, outcomes, strict=True)], shapes


def test_fitting_recovers_the_matrix_that_made_the_data(rng):
    truth = rng.dirichlet(np.ones(3) * 2, size=(2, 3))
    touches, shapes = touches_from(truth, 30_000, rng)
    fitted = ConfusionModel.fit(touches, shapes, pooling=0.0)
    # 5 000 touches per pose and shape: standard error at most .0071, six of them .043.
    np.testing.assert_allclose(fitted.probs, truth, atol=0.043)


def test_an_outcome_never_seen_is_unlikely_but_not_impossible():
    touches = [Touch(0, np.array([5.0, 0.0])), Touch(0, np.array([0.0, 5.0]))] * 50
    fitted = ConfusionModel.fit(touches, np.array([0, 1] * 50), num_poses=2)
    assert (fitted.probs > 0.0).all()
    assert fitted.probs[0, 0, 1] < 0.02
    np.testing.assert_allclose(fitted.probs[1], fitted.probs[0], atol=0.02)  # a pose never seen gets the pooled matrix


def test_a_shape_without_touches_gets_a_uniform_row():
    fitted = ConfusionModel.fit([Touch(0, np.array([3.0, 0.0, 0.0]))] * 9, np.zeros(9, int))
    np.testing.assert_allclose(fitted.probs[0, 2], 1 / 3)


@pytest.mark.parametrize(
    ("touches", "shapes", "options", "message"),
    [
        ([], [], {}, "at least one touch"),
        ([Touch(0, np.zeros(2))], [2], {}, r"\[0, 2\)"),
        ([Touch(0, np.zeros(2))], [0, 1], {}, "one shape and object for each"),
        ([Touch(0, np.array([np.nan, 0.0]))], [0], {}, "finite logits"),
        ([Touch(0, np.zeros(2))], [0], {"smoothing": 0.0}, "smoothing must be > 0"),
    ],
)
def test_bad_calibration_data_raise_and_say_why(touches, shapes, options, message):
    with pytest.raises(ValueError, match=message):
        ConfusionModel.fit(touches, np.array(shapes, int), **options)


@pytest.mark.parametrize(
    ("probs", "message"),
    [
        ([[[0.5, 0.6]]], r"probs\[pose 0, shape 0\] is no distribution"),
        ([[[-0.5, 1.5]]], "no distribution"),
        ([[[np.nan, 1.0]]], "no distribution"),
        ([[0.5, 0.5]], r"must be \(P, K, M\)"),
    ],
)
def test_what_is_no_table_is_refused(probs, message):
    with pytest.raises(ValueError, match=message):
        OutcomeTable(probs)


@pytest.mark.parametrize(
    ("touch", "message"),
    [
        (Touch(-1, np.zeros(4)), "pose -1"),
        (Touch(3, np.zeros(4)), "pose 3"),
        (Touch(0, np.zeros(5)), "row of logits"),
        (Touch(0, np.array([0.0, np.nan, 0.0, 0.0])), "finite logits"),
    ],
)
def test_a_touch_that_does_not_fit_the_model_is_refused(touch, message):
    with pytest.raises(ValueError, match=rf"touch 1 .*{message}"):
        MODELS["confusion"].log_likelihood([Touch(0, np.zeros(4)), touch])


@pytest.mark.parametrize("edges", [(0.9, 0.5), (0.2,), (1.0,)])
def test_confidence_edges_that_do_not_rise_are_refused(edges):
    with pytest.raises(ValueError, match="must rise"):
        ConfusionModel(
            ("a", "b"), np.full((1, 2, 2 * len(edges) + 2), 1 / (2 * len(edges) + 2)), TemperatureScaling(), edges
        )


@pytest.mark.parametrize("text", ["", "{}", '{"model": "plda"}', '{"model": "confusion"}'])
def test_text_that_is_no_model_is_refused(text):
    with pytest.raises(ValueError, match=r"model|Expecting"):
        read_observation_model(text)
