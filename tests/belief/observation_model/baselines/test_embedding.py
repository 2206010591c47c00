"""Where Gaussian models look at a touch."""

import numpy as np
import pytest
from scipy.special import softmax

from belief.observation_model import FeatureEmbedding, LogitEmbedding
from belief.observation_model.baselines.embedding import embedding_from_fields
from belief.touch_batch import TouchBatch


def batch_of(logits, features=None):
    logits = np.asarray(logits, float)
    return TouchBatch(np.zeros((1, len(logits)), int), logits[None], None if features is None else features[None])


def test_a_constant_added_to_all_logits_changes_nothing(rng):
    logits = rng.normal(size=(50, 4))
    embedding = LogitEmbedding.fit(batch_of(logits))
    shifted = logits + rng.normal(size=(50, 1))
    np.testing.assert_allclose(embedding(batch_of(shifted)), embedding(batch_of(logits)), atol=1e-12)


def test_nothing_a_softmax_feels_is_lost(rng):
    logits = rng.normal(size=(50, 4))
    embedding = LogitEmbedding.fit(batch_of(logits))
    again = embedding.to_touches(np.zeros((1, 50), int), embedding(batch_of(logits))).logits[0]
    np.testing.assert_allclose(softmax(again, axis=1), softmax(logits, axis=1), rtol=1e-9)
    np.testing.assert_allclose(again.mean(axis=1), 0.0, atol=1e-12)


def test_what_is_beyond_experience_is_cut_off_at_it(rng):
    logits = rng.normal(size=(200, 3))
    embedding = LogitEmbedding.fit(batch_of(logits))
    far = embedding(batch_of([[9.0, 0.0, 0.0], [1e3, 0.0, 0.0], [1e308, 0.0, 0.0]]))[0]
    np.testing.assert_allclose(far, np.tile(far[0], (3, 1)))


def test_one_huge_logit_among_a_hundred_does_not_set_the_unit(rng):
    logits = rng.normal(size=(100, 3))
    unit = LogitEmbedding.fit(batch_of(logits)).unit
    logits[7] = [1e308, -1e308, 0.0]
    spoilt = LogitEmbedding.fit(batch_of(logits))
    assert spoilt.unit == pytest.approx(unit, rel=0.1)
    assert np.abs(spoilt(batch_of(logits))).max() <= 6.0


def test_principal_components_are_those_of_largest_variance(rng):
    basis = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    scores = rng.normal(size=(4000, 6)) * [3.0, 2.0, 0.1, 0.1, 0.1, 0.1]
    features = (scores @ basis.T + 5.0).astype(np.float32)
    embedding = FeatureEmbedding.fit(batch_of(scores[:, :3], features), num_components=2)
    np.testing.assert_allclose(
        np.abs(embedding.components @ basis)[:, :2], np.eye(2), atol=0.06
    )  # four standard errors
    vectors = embedding(batch_of(scores[:, :3], features))[0]
    np.testing.assert_allclose(np.abs(np.corrcoef(vectors.T, scores[:, :2].T)[:2, 2:]), np.eye(2), atol=0.06)
    # The last layer is read off as far as the components span it: here the first two logits, less the mean of three.
    again = embedding.to_touches(np.zeros((1, 4000), int), vectors[None])
    centred = scores[:, :3] - scores[:, :3].mean(axis=1, keepdims=True)
    np.testing.assert_allclose(again.logits[0], centred, atol=0.5)
    np.testing.assert_allclose(again.features[0], features, atol=0.6)


def test_features_of_any_size_and_without_variance_are_no_trouble(rng):
    for features in (
        np.zeros((9, 3)),
        np.full((9, 3), 1e300),
        1e308 * np.sign(rng.normal(size=(9, 3))),
        np.float16(rng.normal(size=(9, 3))),
    ):
        batch = batch_of(rng.normal(size=(9, 2)), features)
        embedding = FeatureEmbedding.fit(batch, 2)
        vectors = embedding(batch)
        assert np.isfinite(vectors).all()
        assert np.isfinite(embedding.to_touches(batch.poses, vectors).logits).all()


@pytest.mark.parametrize("number", [0, 4, -1])
def test_more_components_than_there_are_or_none_are_refused(number, rng):
    with pytest.raises(ValueError, match="between 1 and 3 components"):
        FeatureEmbedding.fit(batch_of(rng.normal(size=(9, 2)), rng.normal(size=(9, 3))), number)


def test_touches_without_features_or_with_others_are_refused(rng):
    embedding = FeatureEmbedding.fit(batch_of(rng.normal(size=(9, 2)), rng.normal(size=(9, 3))), 2)
    with pytest.raises(ValueError, match="no features"):
        embedding(batch_of(np.zeros((1, 2))))
    with pytest.raises(ValueError, match="is of 3 features, touch 0 has 4"):
        embedding(batch_of(np.zeros((1, 2)), np.zeros((1, 4))))


@pytest.mark.parametrize(
    ("bounds", "unit", "message"),
    [
        (([0.0, 1.0], [1.0, 0.0]), 1.0, "lowest ≤ highest"),
        (([np.nan, 0.0], [1.0, 1.0]), 1.0, "lowest holds NaN"),
        (([0.0], [1.0]), 1.0, "at least two shapes"),
        (([0.0, 0.0], [1.0, 1.0]), 0.0, "unit"),
        (([0.0, 0.0], [1.0, 1.0]), np.inf, "unit"),
    ],
)
def test_bounds_and_units_that_cannot_be_are_refused(bounds, unit, message):
    with pytest.raises(ValueError, match=message):
        LogitEmbedding(*map(np.array, bounds), unit)


def test_an_embedding_nobody_knows_is_refused():
    with pytest.raises(ValueError, match="unknown embedding 'Nobody'"):
        embedding_from_fields({"embedding": "Nobody"})
