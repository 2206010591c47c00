"""Repeats whose evidence is shared in some directions and new in others."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import log_softmax

from belief import Touch
from belief.calibration import TemperatureScaling
from belief.observation_model import RatioModel
from belief.observation_model.directional_discount import discounts, fit_directions
from belief.observation_model.repeat_discount import Repeats, effective_touches
from belief.touch_batch import TouchBatch

SHARED = np.diag([0.9, 0.0])  # the first number of a touch hardly changes, the second is new every time
MEANS = np.array([[1.0, 0.8], [1.0, -0.8], [-1.0, 0.8], [-1.0, -0.8]])  # all as far from the middle: the law is exact


def gaussian_touches(rng, num_objects, num_touches, shared):
    """Log ratios ``(N, n, 4)`` of touches of unit covariance, of which ``shared`` is the object's, and the shapes."""
    shapes = np.arange(num_objects) % 4
    kept = rng.normal(size=(num_objects, 1, 2)) @ np.sqrt(shared)
    new = rng.normal(size=(num_objects, num_touches, 2)) @ np.sqrt(np.eye(2) - shared)
    x = MEANS[shapes][:, None] + kept + new
    return x @ MEANS.T - 0.5 * (MEANS**2).sum(axis=1), shapes


def exact(log_ratio, shared):
    """Log posteriors from all touches by the normal density of their mean, whose covariance is known."""
    x = np.linalg.lstsq(MEANS, (log_ratio + 0.5 * (MEANS**2).sum(axis=1)).mean(axis=1).T, rcond=None)[0].T
    precision = np.linalg.inv(shared + (np.eye(2) - shared) / log_ratio.shape[1])
    away = x[:, None] - MEANS
    return log_softmax(-0.5 * np.einsum("ski,ij,skj->sk", away, precision, away), axis=1)


def grouped(log_ratio, shapes):
    return log_ratio.reshape(-1, 4), Repeats(np.arange(log_ratio.size // 4).reshape(log_ratio.shape[:2]), shapes)


def model_with(directions, correlation=0.5):
    return RatioModel(
        ("a", "b", "c", "d"),
        TemperatureScaling(1.0, "ok"),
        np.full(4, 0.25),
        correlation,
        np.zeros((2, 1, 4)),
        directions=directions,
    )


def test_a_multiple_of_the_identity_is_the_law_of_one_correlation(rng):
    batch = TouchBatch(rng.integers(2, size=(50, 7)), rng.normal(size=(50, 7, 4)))
    by_number, by_matrix = (model_with(d).log_likelihood_batch(batch) for d in (None, 0.5 * np.eye(4)))
    np.testing.assert_allclose(log_softmax(by_matrix, axis=1), log_softmax(by_number, axis=1), atol=1e-12)


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.999])
def test_sums_are_worth_what_their_mean_is_times_the_effective_touches(correlation):
    for n in (1, 2, 6, 10**6):
        assert discounts(n, correlation * np.eye(2))[0, 0] * n == pytest.approx(effective_touches(n, correlation))


def test_the_fit_comes_as_near_to_the_truth_as_the_exact_posterior(rng):
    known, shapes = gaussian_touches(rng, 3000, 5, SHARED)
    directions = fit_directions(*grouped(known, shapes), correlation=0.4)
    fresh, truth = gaussian_touches(rng, 6000, 5, SHARED)
    batch = TouchBatch(np.zeros(fresh.shape[:2], int), fresh)
    rows = np.arange(len(truth))

    def nll(log_probs):
        return -log_probs[rows, truth].mean()

    def loss(directions, correlation):
        return nll(log_softmax(model_with(directions, correlation).log_likelihood_batch(batch), axis=1))

    least = nll(exact(fresh, SHARED))
    assert loss(directions, 0.4) < least + 0.003
    assert min(loss(None, rho) for rho in np.linspace(0.0, 0.95, 20)) > least + 0.03  # no single number does it


def test_touches_of_one_correlation_leave_it_at_that(rng):
    known, shapes = gaussian_touches(rng, 3000, 4, 0.5 * np.eye(2))
    directions = fit_directions(*grouped(known, shapes), correlation=0.5)
    plane = MEANS / np.linalg.norm(MEANS, axis=0)  # where the evidence lies
    np.testing.assert_allclose(plane.T @ directions @ plane, 0.5 * np.eye(2), atol=0.08)


def test_few_groups_hardly_move_it(rng):
    known, shapes = gaussian_touches(rng, 6, 2, SHARED)
    directions = fit_directions(*grouped(known, shapes), correlation=0.4)
    assert np.abs(directions - 0.4 * np.eye(4)).max() < 0.1


def test_touches_that_contradict_each_other_share_nothing_and_never_less(rng):
    x, shapes = gaussian_touches(rng, 300, 1, np.zeros((2, 2)))
    errors = rng.normal(size=x.shape)
    directions = fit_directions(*grouped(np.concatenate([x + errors, x - errors], axis=1), shapes), correlation=0.0)
    assert np.linalg.eigvals(directions).real.min() > -1e-9
    huge = model_with(directions).log_likelihood_batch(
        TouchBatch(np.zeros((1, 10_000), int), np.resize(x, (1, 10_000, 4)))
    )
    assert np.isfinite(huge).all()


def test_the_fit_is_an_optimum_of_what_it_minimises(rng):
    known, shapes = gaussian_touches(rng, 900, 3, np.diag([0.9, 0.4]))
    found = fit_directions(*grouped(known, shapes), correlation=0.3)
    rows = np.arange(len(shapes))

    def loss(directions):
        model, nll = model_with(directions), 0.0
        for n in (2, 3):
            log_probs = log_softmax(
                model.log_likelihood_batch(TouchBatch(np.zeros((900, n), int), known[:, :n])), axis=1
            )
            nll -= log_probs[rows, shapes].mean() / 2.0
        return nll + 10.0 / 900 * ((directions - 0.3 * np.eye(4)) ** 2).sum()

    for _ in range(20):
        assert loss(found) <= loss(found + 0.02 * np.abs(rng.normal(size=(4, 4)))) + 1e-9


def test_touches_beyond_all_bounds_are_finite_evidence():
    logits = np.array([[[1e308, -1e308, 0.0, 1.0]] * 3])
    found = model_with(0.5 * np.eye(4)).log_likelihood_batch(TouchBatch(np.zeros((1, 3), int), logits))
    assert np.isfinite(found).all()
    assert found.argmax() == 0


@pytest.mark.parametrize(
    ("directions", "message"),
    [(np.eye(2), "4 × 4"), (np.full((4, 4), np.nan), "finite"), (-0.1 * np.eye(4), "below zero, got -0.1")],
)
def test_impossible_directions_are_refused(directions, message):
    with pytest.raises(ValueError, match=message):
        model_with(directions)


def test_files_of_models_without_directions_say_nothing_of_them():
    assert "directions" not in model_with(None).to_fields()
    model = replace(model_with(None), directions=0.2 * np.eye(4))
    assert model.to_fields()["directions"] == (0.2 * np.eye(4)).tolist()
    assert model.log_likelihood([Touch(0, np.zeros(4))]).tolist() == [0.0] * 4
