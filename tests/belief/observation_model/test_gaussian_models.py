"""PLDA and the Gaussian model against dense covariance matrices, what made the data, and what PLDA is there for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from belief import Touch
from belief.observation_model import GaussianModel, PLDAModel
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.plda import Components, LogitEmbedding, covariance, estimate_components
from belief.observation_model.selection import log_posteriors
from belief.touch_batch import TouchBatch

LABELS = ("ball", "cube", "cone")
WIDE = LogitEmbedding(np.full(3, -1e6), np.full(3, 1e6))


def random_covariance(rng, scale, rank=2):
    root = rng.normal(size=(2, rank))
    return scale * root @ root.T


def random_plda(rng, scales=(0.5, 0.7, 0.6), rank=2, num_poses=3, pull=1.0):
    shares = [random_covariance(rng, scale, rank) for scale in scales]
    shares[2] = shares[2] + 0.1 * np.eye(2)
    return PLDAModel(LABELS, WIDE, pull * rng.normal(size=(num_poses, 3, 2)), Components(*shares))


def dense_covariance(model, poses):
    """Of all touches of an object stacked, ``(n D, n D)``."""
    of_object, of_pose, of_touch = model.components
    same_pose = poses[:, None] == poses
    return (
        np.kron(np.ones_like(same_pose, float), of_object)
        + np.kron(same_pose, of_pose)
        + np.kron(np.eye(len(poses)), of_touch)
    )


def dense_log_likelihood(model, batch):
    """From scipy's densities of all touches stacked, ``(S, K)``."""
    vectors = model.embedding(batch)
    found = np.empty((len(batch), 3))
    for s, poses in enumerate(batch.poses):
        for k in range(3):
            density = multivariate_normal(model.means[poses, k].ravel(), dense_covariance(model, poses))
            found[s, k] = density.logpdf(vectors[s].ravel())
    return found


def without_constant(log_likelihoods):
    """Log likelihood ratios to the first shape, as the models leave out what all shapes share."""
    return log_likelihoods - log_likelihoods[:, :1]


SCALES = {
    "all parts": (0.5, 0.7, 0.6),
    "nothing shared by the object": (0.0, 0.7, 0.6),
    "nothing shared in a pose": (0.5, 0.0, 0.6),
    "nothing shared": (0.0, 0.0, 0.6),
    "almost all shared": (1.0, 1e4, 1e-6),
}


@pytest.mark.parametrize("scales", SCALES.values(), ids=SCALES)
@pytest.mark.parametrize("rank", [1, 2])
@pytest.mark.parametrize("poses", [[0], [2, 2], [0, 1, 2], [1, 1, 0, 1, 2, 0]])
def test_likelihoods_are_those_of_one_large_gaussian(scales, rank, poses, rng):
    model = random_plda(rng, scales, rank)
    batch = TouchBatch(np.tile(poses, (4, 1)), 2.0 * rng.normal(size=(4, len(poses), 3)))
    found, expected = model.log_likelihood_batch(batch), dense_log_likelihood(model, batch)
    np.testing.assert_allclose(without_constant(found), without_constant(expected), rtol=1e-6, atol=1e-8)


@settings(max_examples=30)
@given(st.lists(st.lists(st.integers(0, 2), min_size=5, max_size=5), min_size=1, max_size=5), st.integers(0, 99))
def test_objects_touched_in_different_patterns_are_told_apart_in_one_batch(poses, seed):
    rng = np.random.default_rng(seed)
    model = random_plda(rng)
    batch = TouchBatch(np.array(poses), rng.normal(size=(len(poses), 5, 3)))
    found, expected = model.log_likelihood_batch(batch), dense_log_likelihood(model, batch)
    np.testing.assert_allclose(without_constant(found), without_constant(expected), rtol=1e-6, atol=1e-8)


def test_samples_have_the_covariances_of_the_model(rng):
    # 40 000 objects: entries of a covariance of size 2 have a standard error of at most .02.
    model = random_plda(rng)
    poses = np.array([0, 0, 1])
    batch = model.sample_batch(1, np.tile(poses, (40_000, 1)), rng)
    vectors = model.embedding(batch).reshape(40_000, -1)
    np.testing.assert_allclose(vectors.mean(axis=0), model.means[poses, 1].ravel(), atol=0.06)
    np.testing.assert_allclose(np.cov(vectors.T), dense_covariance(model, poses), atol=0.1)


def collected(model, rng, num_objects, poses):
    """Touches of objects of all shapes in turn, their shapes and ids."""
    touches, shapes = [], np.arange(num_objects) % 3
    for shape in shapes:
        touches += model.sample(int(shape), poses, rng)
    return touches, shapes.repeat(len(poses)), np.arange(num_objects).repeat(len(poses))


def fitted_parts(model):
    """B, V and W in logits."""
    return [part * model.embedding.unit**2 for part in model.components]


def test_fitting_recovers_what_made_the_data(rng):
    # 800 objects, two poses, three touches each. Standard errors of a variance: of B (.2 + .5/2 + .5/6) √(2/800)
    # = .027, of V (.5 + .5/3) √(2/800) = .033, of W .5 √(2/3200) = .0125; four of each.
    parts = [variance * np.array([[1.0, rho], [rho, 1.0]]) for variance, rho in ((0.2, 0.5), (0.5, -0.3), (0.5, 0))]
    source = PLDAModel(LABELS, WIDE, rng.normal(size=(2, 3, 2)), Components(*parts))
    found = PLDAModel.fit(*collected(source, rng, 800, [0, 1] * 3))
    for estimate, truth, tolerance in zip(fitted_parts(found), parts, (0.11, 0.135, 0.05), strict=True):
        np.testing.assert_allclose(estimate, truth, atol=tolerance)
    np.testing.assert_allclose(found.means * found.embedding.unit, source.means, atol=0.24)


@pytest.mark.parametrize("poses", [[0, 0, 1, 2, 2, 2], [0, 1, 2], [0, 0, 0]])
def test_components_are_those_of_unbalanced_collections_on_average(poses, rng):
    # 3 000 objects, every other of which has one touch less: a standard error of each moment of at most .04.
    source = random_plda(rng)
    rows, ids = np.tile(poses, 3000), np.arange(3000).repeat(len(poses))
    batch = source.sample_batch(0, np.tile(poses, (3000, 1)), rng)
    rest = (source.embedding(batch) - source.means[batch.poses, 0]).reshape(len(ids), -1)
    kept = (np.arange(len(ids)) % len(poses) > 0) | (ids % 2 == 0)
    touches = [Touch(int(pose), np.zeros(3)) for pose in rows[kept]]
    found = estimate_components(rest[kept], LabelledTouches.of(touches, np.zeros(kept.sum(), int), ids[kept]))
    expected = source.components
    if len(set(poses)) == 1:  # of the object or of the object in its only pose
        np.testing.assert_allclose(found[0] + found[1], expected[0] + expected[1], atol=0.2)
    elif len(poses) == 3:  # no repeats
        np.testing.assert_allclose(found[1] + found[2], expected[1] + expected[2], atol=0.2)
    else:
        for estimate, truth in zip(found, expected, strict=True):
            np.testing.assert_allclose(estimate, truth, atol=0.2)


def test_without_repeats_half_of_what_a_pose_does_not_share_is_taken_to_repeat(rng):
    source = random_plda(rng)
    found = PLDAModel.fit(*collected(source, rng, 300, [0, 1, 2]))
    np.testing.assert_allclose(found.components.of_pose, found.components.of_touch, rtol=1e-3, atol=1e-4)


def test_with_one_touch_of_each_object_a_third_is_taken_for_each_part(rng):
    touches, shapes, _ = collected(random_plda(rng), rng, 100, [0, 1])
    found = PLDAModel.fit(touches, shapes, np.arange(200))
    for part in found.components:
        np.testing.assert_array_equal(part, found.components.of_object)


def stops(model, batch, shapes, threshold=0.95):
    """What is claimed and whether it is right, where the claim first exceeds the threshold or touches are at an end."""
    claimed, right = np.zeros(len(batch)), np.zeros(len(batch), bool)
    going = np.ones(len(batch), bool)
    for n in range(1, batch.num_touches + 1):
        probs = np.exp(log_posteriors(model, batch.first(n)))
        done = going & ((probs.max(axis=1) >= threshold) | (n == batch.num_touches))
        claimed[done], right[done] = probs.max(axis=1)[done], (probs.argmax(axis=1) == shapes)[done]
        going &= ~done
    return claimed, right


@pytest.mark.parametrize("correlation", [0.9])
def test_where_touches_repeat_it_claims_what_it_keeps_and_naive_bayes_claims_more(correlation, rng):
    parts = (variance * np.eye(2) for variance in (0.0, correlation, 1.0 - correlation))
    means = np.stack([1.6 * WIDE(TouchBatch(np.zeros((1, 3), int), np.eye(3)[None]))[0]] * 2)
    source = PLDAModel(LABELS, WIDE, means, Components(*parts))
    data = collected(source, rng, 300, [0, 1] * 5)
    careful, naive = PLDAModel.fit(*data), GaussianModel.fit(*data)
    num = 3000
    batches = [source.sample_batch(k, np.zeros((num, 12), int), rng) for k in range(3)]
    batch = TouchBatch(np.concatenate([b.poses for b in batches]), np.concatenate([b.logits for b in batches]))
    shapes = np.arange(3).repeat(num)
    gaps = {}
    for model in (careful, naive):
        claimed, right = stops(model, batch, shapes)
        sure = claimed >= 0.95
        gaps[model.name] = claimed[sure].mean() - right[sure].mean()
    # 9 000 stops: standard error of a share near .96 is .002.
    assert abs(gaps["plda"]) < 0.012
    assert gaps["gaussian"] > 0.02 + 3 * max(gaps["plda"], 0.0)


def test_a_million_touches_of_one_object_weigh_no_more_than_their_mean(rng):
    source = random_plda(rng)
    batch = source.sample_batch(1, rng.integers(3, size=(1, 10**6)), rng)
    found = source.log_likelihood_batch(batch)[0]
    assert np.isfinite(found).all()
    assert np.ptp(found) < 1e3  # bounded by B and V, however many touches there are


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"means": np.zeros((3, 3, 1))}, r"means must be \(P, 3, 2\)"),
        ({"means": np.full((1, 3, 2), np.nan)}, "means in row .* holds a number that is not finite"),
        ({"components": Components(*[np.zeros((2, 2))] * 3)}, "of_touch must be symmetric and positive definite"),
        ({"components": Components(*[-np.eye(2)] * 3)}, "of_object must be symmetric and positive semidefinite"),
        ({"components": Components(*[np.array([[1.0, 2.0], [0.0, 1.0]])] * 3)}, "symmetric"),
        ({"components": Components(*[np.eye(3)] * 3)}, "of shape"),
    ],
)
def test_what_cannot_be_is_refused(change, message, rng):
    model = random_plda(rng)
    fields = {name: getattr(model, name) for name in ("shape_labels", "embedding", "means", "components")}
    with pytest.raises(ValueError, match=message):
        PLDAModel(**{**fields, **change})


def test_fitting_the_gaussian_model_recovers_what_made_the_data(rng):
    # 6 000 touches, 2 000 of each shape: standard errors below .05 for means of two poses and .04 for the covariance.
    nothing, own = np.zeros((2, 2)), np.array([[2.0, 0.5], [0.5, 1.0]])
    source = GaussianModel(LABELS, WIDE, rng.normal(size=(2, 3, 2)), Components(nothing, nothing, own))
    touches, shapes, _ = collected(source, rng, 3_000, [0, 1])
    found = GaussianModel.fit(touches, shapes)
    unit = found.embedding.unit
    np.testing.assert_allclose(found.means * unit, source.means, atol=0.2)
    np.testing.assert_allclose(found.components.of_touch * unit**2, own, atol=0.25)


def test_a_pose_or_shape_never_seen_gets_what_is_common(rng):
    source = random_plda(rng, num_poses=2)
    touches, shapes, _ = collected(source, rng, 300, [0, 1])
    some = [(touch, int(k)) for touch, k in zip(touches, shapes, strict=True) if k < 2]
    model = GaussianModel.fit([touch for touch, _ in some], [k for _, k in some], num_poses=3)
    every = model.embedding(TouchBatch.of([[touch for touch, _ in some]]))[0]
    np.testing.assert_allclose(model.means[:, 2], np.tile(every.mean(axis=0), (3, 1)))
    by_pose = np.sort(model.means[:, :2], axis=0)  # a pose never seen lies between those that were
    np.testing.assert_array_equal(by_pose[1], model.means[2, :2])


@pytest.mark.parametrize("kind", [GaussianModel, PLDAModel])
def test_scale_of_the_logits_does_not_matter(kind, rng):
    touches, shapes, ids = collected(random_plda(rng), rng, 60, [0, 1, 0])
    batch = TouchBatch.of([[touch] for touch in touches])
    expected = kind.fit(touches, shapes, ids).log_likelihood_batch(batch)
    for scale in (1e-150, 1e150):
        scaled = [Touch(touch.pose, scale * touch.logits) for touch in touches]
        found = kind.fit(scaled, shapes, ids).log_likelihood_batch(TouchBatch(batch.poses, scale * batch.logits))
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("place", [0, 250])
def test_one_touch_beyond_all_others_does_not_spoil_the_fit(place, rng):
    touches, shapes, _ = collected(random_plda(rng), rng, 250, [0, 1])
    spoilt = [Touch(t.pose, np.array([1e308, -1e308, 0.0])) if i == place else t for i, t in enumerate(touches)]
    batch = TouchBatch.of([[touch] for touch in touches])
    losses = [
        -log_posteriors(GaussianModel.fit(some, shapes), batch)[np.arange(500), shapes].mean()
        for some in (touches, spoilt)
    ]
    assert losses[1] < losses[0] + 0.1 < np.log(3.0)


def test_no_covariance_is_singular():
    for scatter in (np.zeros((2, 2)), np.ones((2, 2)), np.diag([1e-150, 1e150])):
        assert np.isfinite(np.linalg.cholesky(covariance(scatter))).all()


def test_what_a_softmax_does_not_see_is_all_that_an_embedding_of_logits_loses(rng):
    logits = rng.normal(size=(50, 4))
    batch = TouchBatch(np.zeros((1, 50), int), logits[None])
    embedding = LogitEmbedding.fit(batch)
    shifted = TouchBatch(batch.poses, batch.logits + rng.normal(size=(1, 50, 1)))
    np.testing.assert_allclose(embedding(shifted), embedding(batch), atol=1e-12)
    again = embedding.to_touches(batch.poses, embedding(batch)).logits[0]
    np.testing.assert_allclose(again, logits - logits.mean(axis=1, keepdims=True), atol=1e-12)


def test_logits_beyond_those_of_the_calibration_are_clipped_and_do_not_set_the_unit(rng):
    logits = rng.normal(size=(100, 3))
    unit = LogitEmbedding.fit(TouchBatch(np.zeros((1, 100), int), logits[None])).unit
    logits[7] = [1e308, -1e308, 0.0]
    batch = TouchBatch(np.zeros((1, 100), int), logits[None])
    embedding = LogitEmbedding.fit(batch)
    assert embedding.unit == pytest.approx(unit, rel=0.1)
    assert np.abs(embedding(batch)).max() <= 6.0


@pytest.mark.parametrize(
    ("bounds", "unit", "message"),
    [
        (([0.0, 1.0], [1.0, 0.0]), 1.0, "lowest ≤ highest"),
        (([np.nan, 0.0], [1.0, 1.0]), 1.0, "lowest holds NaN"),
        (([0.0], [1.0]), 1.0, "at least two shapes"),
        (([0.0, 0.0], [1.0, 1.0]), 0.0, "unit"),
    ],
)
def test_bounds_and_units_that_cannot_be_are_refused(bounds, unit, message):
    with pytest.raises(ValueError, match=message):
        LogitEmbedding(*map(np.array, bounds), unit)
