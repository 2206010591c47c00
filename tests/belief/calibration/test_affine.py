"""Vector, Dirichlet and structured matrix scaling against objectives written out a second time."""

import tracemalloc

import mpmath
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import log_softmax

from belief.calibration import (
    CALIBRATIONS,
    DirichletCalibration,
    StructuredMatrixScaling,
    TemperatureScaling,
    VectorScaling,
    affine,
)
from belief.calibration.affine import AffineCalibration, SoftmaxRegression

pytestmark = pytest.mark.filterwarnings("ignore:all .* labels are .*:UserWarning")
AFFINE = {name: kind for name, kind in CALIBRATIONS.items() if issubclass(kind, AffineCalibration)}
every_affine = pytest.mark.parametrize("calibration", [kind() for kind in AFFINE.values()], ids=list(AFFINE))


def sample(rng, n, num_shapes=3):
    """Labels from an affine map of the log-probabilities, with which a shape is taken for another."""
    logits = 2.0 * rng.normal(size=(n, num_shapes))
    weights = np.eye(num_shapes) * np.linspace(0.5, 1.0, num_shapes)
    weights[0, 1] = 0.6
    scores = log_softmax(logits, axis=1) @ weights.T + np.linspace(-0.5, 0.5, num_shapes)
    return logits, (scores + rng.gumbel(size=scores.shape)).argmax(axis=1)


def strengths(calibration, n, num_shapes):
    """Penalties of diagonal, off-diagonal and bias, from the formulas of the papers."""
    k = num_shapes
    match calibration:
        case VectorScaling():
            return 0.25 * k / n, None, 0.25 * k / n
        case StructuredMatrixScaling():
            return 1.0 * k / n, 1.0 * k * (k - 1) / n, 1.0 * k / n
        case DirichletCalibration():
            return 0.1 / n, 0.1 / (k * (k - 1)), 0.1 / k


def mass(calibration, n):
    """The share of the probability that is spread over the shapes."""
    return (1 / (n + 2)) ** (2 if isinstance(calibration, VectorScaling) else 1)


def forty_digit_objective(calibration, logits, labels, temperature, coefficients):
    """The penalised mean NLL, row by row, from the logits on."""
    n, k = logits.shape
    diagonal, off_diagonal, bias = strengths(calibration, n, k)
    spread = mpmath.mpf(mass(calibration, n))
    loss = mpmath.mpf(0)
    for row, label in zip(logits, labels, strict=True):
        weights = [mpmath.exp(mpmath.mpf(float(z)) / temperature) for z in row]
        x = [mpmath.log((1 - spread) * w / mpmath.fsum(weights) + spread / k) for w in weights]
        scores = [mpmath.fdot(coefficients[i][:-1], x) + coefficients[i][-1] for i in range(k)]
        loss += mpmath.log(mpmath.fsum(mpmath.exp(s - scores[label]) for s in scores)) / n
    for i in range(k):
        loss += diagonal * (coefficients[i][i] - 1) ** 2 + bias * coefficients[i][-1] ** 2
        for j in range(k):
            if i != j and off_diagonal is not None:
                loss += off_diagonal * coefficients[i][j] ** 2
    return loss


@every_affine
def test_objective_and_gradient_agree_with_forty_digits(calibration, rng):
    logits, labels = sample(rng, 12)
    fitted = calibration.fit(logits, labels)
    away = fitted.coefficients + np.where(
        fitted.coefficients != 0.0, 0.1 * rng.normal(size=fitted.coefficients.shape), 0.0
    )
    moved = type(calibration)(temperature=fitted.temperature, coefficients=away)
    value, gradient = moved.objective(logits, labels)
    with mpmath.workdps(40):
        exact = [[mpmath.mpf(float(c)) for c in row] for row in away]
        temperature = mpmath.mpf(fitted.temperature.temperature)
        expected = forty_digit_objective(calibration, logits, labels, temperature, exact)
        slopes = []
        for i, j in np.argwhere(np.isfinite(calibration.penalty(12, 3))).tolist():

            def along(c, i=i, j=j):
                bent = [list(row) for row in exact]
                bent[i][j] = c
                return forty_digit_objective(calibration, logits, labels, temperature, bent)

            slopes.append(float(mpmath.diff(along, exact[i][j])))
    assert value == pytest.approx(float(expected), rel=1e-13)
    np.testing.assert_allclose(gradient, slopes, rtol=1e-11, atol=1e-14)


@every_affine
def test_the_fit_is_where_a_general_optimiser_ends(calibration, rng):
    logits, labels = sample(rng, 200)
    fitted = calibration.fit(logits, labels)
    diagonal, off_diagonal, bias = strengths(calibration, 200, 3)
    share = mass(calibration, 200)
    p = (1 - share) * np.exp(log_softmax(logits / fitted.temperature.temperature, axis=1)) + share / 3
    inputs = np.log(p)
    start, free = np.eye(3, 4), np.ones((3, 4), bool)
    if off_diagonal is None:
        free[:, :3] = np.eye(3, dtype=bool)

    def objective(parameters):
        matrix = start.copy()
        matrix[free] = parameters
        change = (matrix - start)[:, :-1]
        on_diagonal = np.eye(3, dtype=bool)
        penalty = diagonal * (change[on_diagonal] ** 2).sum() + bias * (matrix[:, -1] ** 2).sum()
        penalty += (off_diagonal or 0.0) * (change[~on_diagonal] ** 2).sum()
        log_probs = log_softmax(inputs @ matrix[:, :-1].T + matrix[:, -1], axis=1)
        return penalty - log_probs[np.arange(200), labels].mean()

    found = minimize(objective, start[free], method="BFGS", options={"gtol": 1e-7})
    assert objective(fitted.coefficients[free]) <= found.fun + 1e-12
    np.testing.assert_allclose(fitted.coefficients[free], found.x, atol=1e-4)
    np.testing.assert_array_equal(fitted.coefficients[~free], start[~free])


@pytest.mark.parametrize("factor", [0.3, 1.0, 3.0], ids=["under-confident", "right", "over-confident"])
def test_vector_scaling_reaches_the_optimum_without_penalties(factor, rng):
    labels = rng.integers(4, size=2000)
    logits = factor * (6.0 * np.eye(4)[labels] + 2.5 * rng.normal(size=(2000, 4)))

    def loss(fitted):
        return -fitted.predict_log_proba(logits)[np.arange(2000), labels].mean()

    free = VectorScaling(diagonal_strength=1e-9, bias_strength=1e-9).fit(logits, labels)
    assert loss(VectorScaling().fit(logits, labels)) - loss(free) < 1e-4


@every_affine
@pytest.mark.parametrize("num_shapes", [1, 2, 12])
@pytest.mark.parametrize("n", [1, 5, 5000])
def test_the_gradient_vanishes_for_any_number_of_shapes_and_rows(calibration, rng, num_shapes, n):
    logits, labels = rng.normal(size=(n, num_shapes)), rng.integers(num_shapes, size=n)
    _, gradient = calibration.fit(logits, labels).objective(logits, labels)
    assert np.abs(gradient).max() < 1e-10


@every_affine
def test_separable_data_with_missing_shapes_have_a_finite_optimum(calibration):
    logits, labels = 50.0 * np.eye(5)[[0, 0, 1, 1]], [0, 0, 1, 1]
    fitted = calibration.fit(logits, labels)
    assert fitted.status == "separable"
    assert np.abs(fitted.coefficients).max() < 20.0
    assert np.abs(fitted.objective(logits, labels)[1]).max() < 1e-10
    probs = fitted.predict_proba(logits)
    assert (probs.argmax(axis=1) == labels).all()
    assert probs.min() > 1e-6


@every_affine
def test_constant_scores_give_nearly_the_shares_of_the_shapes(calibration):
    labels = np.repeat([0, 1, 2], [600, 300, 100])
    fitted = calibration.fit(np.zeros((1000, 3)), labels)
    assert fitted.status == "uninformative"
    # Penalties still draw towards a third each: those of Dirichlet calibration do not shrink with n.
    np.testing.assert_allclose(fitted.predict_proba(np.zeros(3)), [0.6, 0.3, 0.1], atol=0.04)


@pytest.mark.parametrize("calibration", [VectorScaling(), StructuredMatrixScaling()])
def test_a_stronger_penalty_ends_at_temperature_scaling(calibration, rng):
    logits, labels = sample(rng, 100)
    strong = dict.fromkeys(calibration.penalty_names(), 1000000000.0)
    fitted = type(calibration)(**strong).fit(logits, labels)
    np.testing.assert_allclose(fitted.coefficients, np.eye(3, 4), atol=1e-6)
    expected = TemperatureScaling().fit(logits, labels).predict_proba(logits)
    np.testing.assert_allclose(fitted.predict_proba(logits), expected, atol=1 / 102)


def test_the_matrix_moves_as_the_touches_grow_more(rng):
    logits, labels = sample(rng, 30_000)
    distances = [
        np.abs(StructuredMatrixScaling().fit(logits[:n], labels[:n]).coefficients - np.eye(3, 4)).max()
        for n in (3, 30_000)
    ]
    assert distances[0] < 0.2
    assert distances[1] > 0.5  # as far as the map that made the labels


def test_structured_matrix_scaling_finds_the_map_that_made_the_labels(rng):
    logits, labels = sample(rng, 60_000)
    test_logits, test_labels = sample(rng, 20_000)
    rows = np.arange(len(test_labels))
    scores = log_softmax(test_logits, axis=1)
    weights = np.diag([0.5, 0.75, 1.0])
    weights[0, 1] = 0.6
    best = -log_softmax(scores @ weights.T + [-0.5, 0.0, 0.5], axis=1)[rows, test_labels].mean()
    losses = {
        name: -kind().fit(logits, labels).predict_log_proba(test_logits)[rows, test_labels].mean()
        for name, kind in CALIBRATIONS.items()
    }
    assert losses["structured_matrix"] < best + 0.003
    assert losses["structured_matrix"] < losses["vector"] < losses["temperature"] - 0.03


def test_blocks_of_rows_add_up(rng):
    features, labels = rng.normal(size=(3, 10_000)), rng.integers(4, size=10_000)
    penalty, coefficients = rng.uniform(0.1, 1.0, size=(4, 3)), rng.normal(size=(4, 3))
    penalty[1, 2] = np.inf
    centre = np.where(np.isfinite(penalty), 0.0, coefficients)
    value, gradient = SoftmaxRegression(features, labels, np.ones(len(labels)), penalty, centre).value_and_gradient(
        coefficients
    )
    log_probs = log_softmax((coefficients @ features).T, axis=1)
    free = np.isfinite(penalty)
    ridge = (penalty[free] * coefficients[free] ** 2).sum()
    assert value == pytest.approx(ridge - log_probs[np.arange(10_000), labels].mean(), rel=1e-13)
    slope = (np.exp(log_probs) - np.eye(4)[labels]).T @ features.T / 10_000
    np.testing.assert_allclose(gradient, slope[free] + 2.0 * (penalty * coefficients)[free], rtol=1e-10, atol=1e-13)


@pytest.mark.parametrize("kind", AFFINE.values(), ids=list(AFFINE))
@pytest.mark.parametrize("strength", [0.0, -1.0, np.inf, np.nan])
def test_a_strength_that_leaves_no_optimum_is_refused(kind, strength):
    with pytest.raises(ValueError, match="bias_strength must be a finite number > 0"):
        kind(bias_strength=strength)


@pytest.mark.parametrize("coefficients", [np.eye(3), np.zeros(4), np.full((3, 4), np.nan), np.full((1, 2), np.inf)])
def test_coefficients_of_the_wrong_form_are_refused(coefficients):
    with pytest.raises(ValueError, match=r"\(K, K \+ 1\) and finite"):
        StructuredMatrixScaling(coefficients=coefficients)


@every_affine
def test_another_number_of_shapes_than_fitted_is_refused(calibration, rng):
    fitted = calibration.fit(*sample(rng, 30))
    with pytest.raises(ValueError, match="fitted for 3 shapes, got logits of 4"):
        fitted.predict_proba(np.zeros(4))
    with pytest.raises(ValueError, match="fitted for 3 shapes, got logits of 2"):
        fitted.objective(np.zeros((1, 2)), [0])


@every_affine
def test_before_the_fit_there_are_no_coefficients(calibration):
    with pytest.raises(ValueError, match="call fit first"):
        calibration.objective([[0.0, 1.0]], [0])
    with pytest.raises(ValueError, match="call fit first"):
        _ = calibration.weights
    assert type(calibration).from_fields(calibration.to_fields()).coefficients is None


@pytest.mark.parametrize("kind", [VectorScaling, StructuredMatrixScaling, DirichletCalibration])
def test_many_coefficients_are_fitted_as_few_are(kind, monkeypatch, rng):
    labels = np.arange(400) % 5
    logits = 2.0 * np.eye(5)[labels] + rng.normal(size=(400, 5)) + rng.normal(size=(5, 5))[labels]
    few = kind().fit(logits, labels)
    monkeypatch.setattr(affine, "_MOST_DENSE", 0)
    many = kind().fit(logits, labels)
    np.testing.assert_allclose(many.coefficients, few.coefficients, rtol=1e-7, atol=1e-7)
    assert np.abs(many.objective(logits, labels)[1]).max() < 1e-8


def test_a_hundred_shapes_are_calibrated_without_a_matrix_of_all_pairs_of_coefficients(rng):
    labels = np.arange(300) % 100
    logits = 2.0 * np.eye(100)[labels] + rng.normal(size=(300, 100))
    tracemalloc.start()
    fitted = StructuredMatrixScaling().fit(logits, labels)
    slope = np.abs(fitted.objective(logits, labels)[1]).max()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert slope < 1e-8
    assert peak < 50e6  # the matrix alone would be 8 (100 · 101)² = 816e6
