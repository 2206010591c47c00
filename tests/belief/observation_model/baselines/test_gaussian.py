"""The Gaussian model against scipy's densities; discriminant analysis between its two ends."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from belief import Touch
from belief.observation_model import GaussianModel, LogitEmbedding
from belief.observation_model.baselines.covariances import pooled, positive_definite
from belief.observation_model.selection import log_posteriors
from belief.touch_batch import TouchBatch

LABELS = ("ball", "cube", "cone")
WIDE = LogitEmbedding(np.full(3, -1e6), np.full(3, 1e6))


def random_gaussian(rng):
    roots = rng.normal(size=(3, 2, 2))
    return GaussianModel(LABELS, WIDE, rng.normal(size=(2, 3, 2)), roots @ np.swapaxes(roots, 1, 2) + 0.1 * np.eye(2))


def collected(model, rng, num_touches):
    """Touches of shapes and poses at random, and the shapes."""
    shapes, poses = rng.integers(3, size=num_touches), rng.integers(2, size=num_touches)
    return [model.sample(int(k), [int(p)], rng)[0] for k, p in zip(shapes, poses, strict=True)], shapes


def test_likelihoods_are_sums_of_gaussian_log_densities(rng):
    model = random_gaussian(rng)
    batch = TouchBatch(rng.integers(2, size=(6, 4)), 2.0 * rng.normal(size=(6, 4, 3)))
    vectors = WIDE(batch)
    expected = np.zeros((6, 3))
    for (s, t), pose in np.ndenumerate(batch.poses):
        for k in range(3):
            density = multivariate_normal(model.means[pose, k], model.covariances[k])
            expected[s, k] += density.logpdf(vectors[s, t]) + np.log(2.0 * np.pi)
    np.testing.assert_allclose(model.log_likelihood_batch(batch), expected, rtol=1e-10)


def test_samples_have_the_mean_and_covariance_of_their_shape_and_pose(rng):
    model = random_gaussian(rng)
    vectors = WIDE(model.sample_batch(2, np.ones((40_000, 1), int), rng))[:, 0]
    np.testing.assert_allclose(vectors.mean(axis=0), model.means[1, 2], atol=0.05)
    np.testing.assert_allclose(np.cov(vectors.T), model.covariances[2], atol=0.12)


def test_fitting_recovers_what_made_the_data(rng):
    # 30 000 touches, 10 000 of each shape: standard errors below .03 for means and .06 for covariances of size 3.
    source = random_gaussian(rng)
    found = GaussianModel.fit(*collected(source, rng, 30_000))
    unit = found.embedding.unit
    np.testing.assert_allclose(found.means * unit, source.means, atol=0.12)
    np.testing.assert_allclose(found.covariances * unit**2, source.covariances, atol=0.25)


def test_fitting_in_an_embedding_of_ones_own_keeps_it_and_its_unit_changes_nothing(rng):
    touches, shapes = collected(random_gaussian(rng), rng, 300)
    own, default = (GaussianModel.fit(touches, shapes, embedding=embedding) for embedding in (WIDE, None))
    assert own.embedding is WIDE
    np.testing.assert_allclose(own.means * WIDE.unit, default.means * default.embedding.unit, rtol=1e-6)


def test_pooling_goes_from_quadratic_to_linear_discriminant_analysis(rng):
    touches, shapes = collected(random_gaussian(rng), rng, 600)
    own, some, one = (GaussianModel.fit(touches, shapes, pooling=pooling) for pooling in (0.0, 200.0, np.inf))
    batch = own.embedding(TouchBatch.of([touches]))[0]
    rest = batch - own.means[[touch.pose for touch in touches], shapes]
    for k in range(3):
        np.testing.assert_allclose(own.covariances[k], rest[shapes == k].T @ rest[shapes == k] / (shapes == k).sum())
        np.testing.assert_allclose(one.covariances[k], rest.T @ rest / 600, rtol=1e-9)
        weight = 200.0 / ((shapes == k).sum() + 200.0)
        between = weight * one.covariances[k] + (1.0 - weight) * own.covariances[k]
        np.testing.assert_allclose(some.covariances[k], between, rtol=1e-9)


def test_a_pose_or_shape_never_seen_gets_what_is_common(rng):
    touches, shapes = collected(random_gaussian(rng), rng, 400)
    some = [(touch, k) for touch, k in zip(touches, shapes, strict=True) if k < 2]
    model = GaussianModel.fit([touch for touch, _ in some], [int(k) for _, k in some], num_poses=3)
    every = model.embedding(TouchBatch.of([[touch for touch, _ in some]]))[0]
    np.testing.assert_allclose(model.means[:, 2], np.tile(every.mean(axis=0), (3, 1)))
    np.testing.assert_allclose(model.covariances[2], pooled_of(model, some))
    by_pose = np.sort(model.means[:, :2], axis=0)  # a pose never seen lies between those that were
    np.testing.assert_array_equal(by_pose[1], model.means[2, :2])


def pooled_of(model, some):
    """The covariance of all touches about the means of their shapes and poses."""
    vectors = model.embedding(TouchBatch.of([[touch for touch, _ in some]]))[0]
    rest = vectors - model.means[[touch.pose for touch, _ in some], [k for _, k in some]]
    return rest.T @ rest / len(some)


def test_sums_of_squares_of_nothing_are_no_reason_to_divide_by_zero():
    assert pooled(np.zeros((2, 1, 1)), [0, 0], 0.0).tolist() == [[[0.0]], [[0.0]]]
    assert pooled(np.array([[[4.0]], [[0.0]]]), [2, 0], 0.0).tolist() == [[[2.0]], [[2.0]]]


@pytest.mark.parametrize("pooling", [-1.0, np.nan, -np.inf])
def test_negative_pooling_is_refused(pooling):
    with pytest.raises(ValueError, match="pooling must be ≥ 0"):
        GaussianModel.fit([Touch(0, np.zeros(2))], [0], pooling=pooling)


def test_no_covariance_is_singular():
    for covariance in (np.zeros((2, 2)), np.ones((2, 2)), np.diag([1.0, -1e-9]), np.diag([1e-300, 1e300])):
        assert np.isfinite(np.linalg.cholesky(positive_definite(covariance[None]))).all()


EXTREME_COLLECTIONS = {
    "one touch": ([Touch(0, np.array([1.0, 0.0, 0.0]))], [0]),
    "all touches equal": ([Touch(0, np.array([1.0, 2.0, 3.0]))] * 9, [0, 1, 2] * 3),
    "separable": ([Touch(0, 50.0 * np.eye(3)[i % 3]) for i in range(30)], np.arange(30) % 3),
    "subnormal": ([Touch(0, 5e-324 * np.eye(3)[i % 3]) for i in range(30)], np.arange(30) % 3),
    "huge": ([Touch(0, 1e308 * np.eye(3)[i % 3]) for i in range(30)], np.arange(30) % 3),
    "small floats": ([Touch(0, np.eye(3)[i % 3].astype(np.float16)) for i in range(30)], np.arange(30) % 3),
}


@pytest.mark.parametrize("data", EXTREME_COLLECTIONS.values(), ids=EXTREME_COLLECTIONS)
def test_extreme_collections_give_a_model_that_answers(data):
    model = GaussianModel.fit(*data, num_poses=2)
    for logits in (data[0][0].logits, np.zeros(3), np.array([1e308, -1e308, 0.0])):
        assert np.isfinite(model.log_likelihood([Touch(1, logits)] * 7)).all()
    assert np.isfinite(model.outcome_table(3).probs).all()


def test_scale_of_the_logits_does_not_matter(rng):
    touches, shapes = collected(random_gaussian(rng), rng, 300)
    batch = TouchBatch.of([[touch] for touch in touches])
    expected = GaussianModel.fit(touches, shapes).log_likelihood_batch(batch)
    for scale in (1e-150, 1e150):
        scaled = [Touch(touch.pose, scale * touch.logits) for touch in touches]
        found = GaussianModel.fit(scaled, shapes).log_likelihood_batch(TouchBatch(batch.poses, scale * batch.logits))
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("place", [0, 250])
def test_one_touch_beyond_all_others_does_not_spoil_the_fit(place, rng):
    touches, shapes = collected(random_gaussian(rng), rng, 500)
    spoilt = [Touch(t.pose, np.array([1e308, -1e308, 0.0])) if i == place else t for i, t in enumerate(touches)]
    batch = TouchBatch.of([[touch] for touch in touches])
    losses = [
        -log_posteriors(GaussianModel.fit(some, shapes), batch)[np.arange(500), shapes].mean()
        for some in (touches, spoilt)
    ]
    assert losses[1] < losses[0] + 0.1 < np.log(3.0)


@pytest.mark.parametrize(
    ("means", "covariances", "message"),
    [
        (np.zeros((2, 3, 1)), np.stack([np.eye(2)] * 3), r"means must be \(P, 3, 2\)"),
        (np.zeros((0, 3, 2)), np.stack([np.eye(2)] * 3), r"means must be \(P, 3, 2\)"),
        (np.full((2, 3, 2), np.inf), np.stack([np.eye(2)] * 3), "means must be finite"),
        (np.zeros((2, 3, 2)), np.eye(2)[None], "must be finite and of shape"),
        (np.zeros((2, 3, 2)), np.zeros((3, 2, 2)), "positive definite"),
        (np.zeros((2, 3, 2)), np.full((3, 2, 2), np.nan), "must be finite"),
    ],
)
def test_what_cannot_be_is_refused(means, covariances, message):
    with pytest.raises(ValueError, match=message):
        GaussianModel(LABELS, WIDE, means, covariances)
