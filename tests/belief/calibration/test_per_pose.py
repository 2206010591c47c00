"""Folds of whole objects, and calibrations of every pose."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from belief.calibration import (
    CALIBRATIONS,
    PerPose,
    StructuredMatrixScaling,
    TemperatureScaling,
    VectorScaling,
)
from belief.observation_model.calibration_data import object_folds

pytestmark = [
    pytest.mark.filterwarnings("ignore:logits has no negative number:UserWarning"),
    pytest.mark.filterwarnings("ignore:all .* labels are .*:UserWarning"),
]

LABELS = ("cube", "sphere", "cone")


def sample_of_poses(rng, n=6000):
    """Poses 0 and 1, which call for different temperatures."""
    logits, poses = rng.normal(size=(n, 3)) * 3.0, rng.integers(2, size=n)
    labels = (logits / np.array([1.0, 4.0])[poses, None] + rng.gumbel(size=(n, 3))).argmax(axis=1)
    return logits, labels, poses


@given(st.integers(1, 6), arrays(np.int64, 40, elements=st.integers(0, 11)), st.randoms(use_true_random=False))
def test_folds_keep_objects_whole_and_shapes_even(num_folds, ids, random):
    num_folds = min(num_folds, len(np.unique(ids)))
    shape_of = np.array([random.randrange(3) for _ in range(12)])
    folds = object_folds(shape_of[ids], ids, num_folds)
    fold_of = {i: set(folds[ids == i].tolist()) for i in ids.tolist()}
    assert all(len(some) == 1 for some in fold_of.values())
    for shape in range(3):
        counts = [sum(fold_of[i] == {f} for i in fold_of if shape_of[i] == shape) for f in range(num_folds)]
        assert max(counts) - min(counts) <= 1
    order = np.array(random.sample(range(40), 40))
    np.testing.assert_array_equal(object_folds(shape_of[ids][order], ids[order], num_folds), folds[order])


@pytest.mark.parametrize(
    ("shapes", "ids", "num_folds", "message"),
    [
        ([0, 1], [1, 2], 3, "give num_folds=2"),
        ([0, 1], [1, 2], 0, "at least 1, got 0"),
        ([0, 1], [1, 2], 1.5, "must be an integer"),
        ([0, 1], [1, 2], True, "must be an integer"),
        ([0, 1, 0], [5, 5, 6], 2, r"object 5 has shape 0, and shape 1 in row 1 \(from 0\)"),
        ([0, 1], [1], 2, "for every touch"),
        ([[0, 1]], [[1, 2]], 2, "for every touch"),
    ],
)
def test_folds_that_cannot_be_dealt_are_refused(shapes, ids, num_folds, message):
    with pytest.raises(ValueError, match=message):
        object_folds(shapes, ids, num_folds)


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_poses_that_differ_get_calibrations_that_differ(name, rng):
    logits, labels, poses = sample_of_poses(rng)
    rows = np.arange(len(labels))
    pooled = CALIBRATIONS[name]().fit(logits, labels)
    own = PerPose(CALIBRATIONS[name]()).fit(logits, labels, poses)
    losses = [p[rows, labels].mean() for p in (pooled.predict_log_proba(logits), own.predict_log_proba(logits, poses))]
    assert losses[1] > losses[0] + 0.02


def test_temperatures_of_poses_are_averaged_in_their_inverse(rng):
    logits, labels, poses = sample_of_poses(rng, n=500)
    fitted = PerPose(TemperatureScaling(), pooling=150.0).fit(logits, labels, poses)
    for pose in (0, 1):
        n = (poses == pose).sum()
        inverse = (n / fitted.fitted[1 + pose].temperature + 150.0 / fitted.fitted[0].temperature) / (n + 150.0)
        expected = TemperatureScaling(1.0 / inverse, "ok").predict_log_proba(logits[:9])
        np.testing.assert_allclose(fitted.predict_log_proba(logits[:9], [pose] * 9), expected, atol=1e-12)


def test_poses_with_few_touches_keep_near_the_pooled_calibration(rng):
    logits, labels, poses = sample_of_poses(rng, n=500)
    poses[:2] = 2  # two touches in pose 2, none in pose 3
    fitted = PerPose().fit(logits, labels, poses, num_poses=4)
    pooled = fitted.fitted[0].predict_log_proba(logits)
    assert fitted.num_touches[2:] == (2, 0)
    np.testing.assert_allclose(fitted.predict_log_proba(logits, np.full(500, 3)), pooled, atol=1e-13)
    np.testing.assert_allclose(fitted.predict_log_proba(logits, np.full(500, 2)), pooled, atol=0.3)
    assert np.abs(fitted.predict_log_proba(logits, np.full(500, 1)) - pooled).max() > 0.1


def test_without_pooling_every_pose_stands_alone(rng):
    logits, labels, poses = sample_of_poses(rng, n=500)
    fitted = PerPose(pooling=0.0).fit(logits, labels, poses, num_poses=3)
    alone = StructuredMatrixScaling().fit(logits[poses == 1], labels[poses == 1])
    np.testing.assert_allclose(
        fitted.predict_log_proba(logits, np.ones(500, int)), alone.predict_log_proba(logits), atol=1e-12
    )
    np.testing.assert_allclose(
        fitted.predict_log_proba(logits, np.full(500, 2)), fitted.fitted[0].predict_log_proba(logits)
    )


@given(
    arrays(np.float64, (5, 3), elements=st.sampled_from([0.0, 1.0, 5e-324, -1e308, 1e308, np.nan, np.inf])),
    arrays(np.int64, 5, elements=st.integers(0, 2)),
    arrays(np.int64, 5, elements=st.integers(0, 2)),
    st.sampled_from(sorted(CALIBRATIONS)),
)
def test_whatever_the_numbers_there_is_an_error_or_a_distribution(logits, labels, poses, name):
    calibration = PerPose(CALIBRATIONS[name](), pooling=1.0)
    if not np.isfinite(logits).all():
        with pytest.raises(ValueError, match="not finite"):
            calibration.fit(logits, labels, poses)
        return
    log_probs = calibration.fit(logits, labels, poses).predict_log_proba(logits, poses)
    assert np.isfinite(log_probs).all()
    np.testing.assert_allclose(np.exp(log_probs).sum(axis=1), 1.0)


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        ([0, -1], r"poses?.* -1"),
        ([2, 0], r"poses?.* 2"),
        ([0.0, 1.0], "poses must be integers"),
        ([0], r"a pose for each( of 2)? row"),
    ],
)
def test_poses_that_are_not_known_are_refused(poses, message):
    logits, labels = [[0.0, 2.0], [2.0, 0.0]], [0, 1]
    fitted = PerPose().fit(logits, labels, [0, 1])
    with pytest.raises(ValueError, match=message):
        fitted.predict_log_proba(logits, poses)
    with pytest.raises(ValueError, match=message):
        PerPose().fit(logits, labels, poses, num_poses=2)


def test_what_was_not_fitted_or_makes_no_sense_is_refused():
    with pytest.raises(ValueError, match="call fit first"):
        PerPose().predict_log_proba([[0.0, 2.0]], [0])
    with pytest.raises(ValueError, match="pooling must be a finite number"):
        PerPose(pooling=-1.0)
    with pytest.raises(ValueError, match="need logits"):
        PerPose().fit([[0.0, 2.0]], [0], [0]).predict_log_proba([0.0, 2.0], [0])
    with pytest.raises(ValueError, match="each of 0 poses"):
        PerPose(fitted=(TemperatureScaling(),) * 2)
    two, three = (VectorScaling().fit(2.0 * np.eye(k), np.arange(k)) for k in (2, 3))
    with pytest.raises(ValueError, match="got 2 for"):
        PerPose(VectorScaling(), 1.0, (three, two), (2,))
