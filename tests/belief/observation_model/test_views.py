"""Poses that share a table of outcomes answer as poses with tables of their own."""

import numpy as np
import pytest

from belief import Touch
from belief.observation_model import FixedHypotheses, RigidBodyModel, read_observation_model
from belief.observation_model.outcome_mixture import SharedMixture, Views

P, K, N, D = 14, 3, 12, 5


class Turned:
    """Bodies that pose p shows as pose 0 shows the p-th next body: a world in which views are exact."""

    groups = (0,) * P

    def __init__(self, rng):
        self.first = rng.normal(size=(K, N, D)).astype(np.float32)

    def views(self, num_hypotheses):
        assert num_hypotheses == N
        return Views(np.zeros(P, np.int64), (np.arange(P)[:, None] + np.arange(N)) % N)

    def in_pose(self, num_hypotheses, pose):
        assert num_hypotheses == N
        return np.roll(self.first, -pose, axis=1)

    def __call__(self, num_hypotheses):
        return np.stack([self.in_pose(num_hypotheses, pose) for pose in range(P)])


@pytest.fixture
def turned(rng):
    return Turned(rng)


def models(turned, rng):
    references, logits = 2.0 * rng.normal(size=(1, 40, D)), rng.normal(size=(1, 40, K))
    shared = RigidBodyModel(tuple("abc"), N, 1.3, references, logits, groups=turned.groups, hypotheses=turned)
    alone = RigidBodyModel(
        tuple("abc"),
        N,
        1.3,
        np.repeat(references, P, 0),
        np.repeat(logits, P, 0),
        hypotheses=FixedHypotheses(turned(N)),
    )
    return shared, alone


def touched(model, rng, number):
    evidence = model.start()
    for _ in range(number):
        evidence = evidence.update(Touch(int(rng.integers(P)), np.zeros(K), 2.0 * rng.normal(size=D)))
    return evidence


def test_outcomes_of_chosen_hypotheses_are_those_of_every_pose_by_itself(turned, rng):
    chosen = rng.integers(N, size=(K, 5))
    shared, alone = (model.outcomes.of(chosen, 20) for model in models(turned, rng))
    np.testing.assert_allclose(shared, alone, atol=1e-5)


@pytest.mark.parametrize("number", [0, 1, 4, 30])
def test_shared_outcomes_are_those_of_every_pose_by_itself(turned, rng, number):
    ours, theirs = (touched(model, np.random.default_rng(number), number) for model in models(turned, rng))
    np.testing.assert_allclose(ours.log_likelihood, theirs.log_likelihood, atol=1e-5)
    for outcomes, hypotheses in ((40, N), (10, 4)):
        mine, other = (evidence.outcome_mixture(outcomes, hypotheses) for evidence in (ours, theirs))
        np.testing.assert_allclose(mine.table.probs, other.table.probs, atol=1e-5)
        factors = rng.normal(size=(2, K))
        positive = np.abs(factors) * [1.0, 1e-8, 0.0]  # the second is negligible, the third is nothing
        np.testing.assert_allclose(mine.one_touch(positive), other.one_touch(positive), atol=1e-5)
        np.testing.assert_allclose(mine.two_touches(3, factors), other.two_touches(3, factors), atol=1e-5)


def test_a_model_with_shared_references_survives_its_file_and_samples_as_the_other(turned, rng):
    shared, alone = models(turned, rng)
    again = read_observation_model(shared.to_json()).with_hypotheses(turned)
    assert (again.groups, again.num_poses) == (shared.groups, P)
    evidence = touched(again, np.random.default_rng(0), 3)
    expected = touched(shared, np.random.default_rng(0), 3)
    np.testing.assert_allclose(evidence.log_likelihood, expected.log_likelihood, atol=1e-4)
    assert shared.outcome_table().probs.shape[:2] == (P, K)
    poses = rng.integers(P, size=(50, 4))
    drawn = [model.sample_batch(1, poses, np.random.default_rng(5)) for model in (shared, alone)]
    assert (drawn[0].features == drawn[1].features).mean() > 0.99  # but for rounding of the normalisers


def test_a_table_that_does_not_fit_the_references_is_refused(turned, rng):
    references, logits = rng.normal(size=(1, 4, D)), np.zeros((1, 4, K))
    with pytest.raises(ValueError, match="groups"):
        RigidBodyModel(tuple("abc"), N, 1.0, references, logits, groups=(0, 1), hypotheses=turned)
    other = RigidBodyModel(tuple("abc"), N, 1.0, references, logits, groups=(0,) * (P - 1), hypotheses=turned)
    with pytest.raises(ValueError, match="groups"):
        _ = other.views
    for groups, same in (([1], [[0]]), ([0], [[1]]), ([0], [[-1]]), ([0, 0], [[0]]), ([0], [])):
        with pytest.raises(ValueError, match=r"groups|same"):
            Views(np.array(groups), np.array(same, int))
    views, outcomes = Views(np.array([0]), np.array([[0]])), np.ones((1, 1, 1, 1), np.float32)
    for log_weights in ([[0.5, 0.5]], [[1.0], [1.0]], [[np.nan]], [[-np.inf]], [[np.inf]]):
        with pytest.raises(ValueError, match="log weights"):
            SharedMixture(np.array(log_weights), 1, outcomes, views)


def test_one_certain_hypothesis_among_many_poses(turned, rng):
    shared, _ = models(turned, rng)
    evidence = shared.start()
    for _ in range(200):  # all mass on one body of each shape
        evidence = evidence.update(Touch(2, np.zeros(K), 50.0 * turned.first[0, 3]))
    table = evidence.outcome_mixture(40, 8).table.probs
    assert np.isfinite(table).all()
    body = evidence.diagnostics.most_likely[0]
    np.testing.assert_allclose(table[5, 0], shared.outcomes.shared(40)[0, 0, (body + 5) % N], atol=1e-5)


def test_a_fitted_model_shares_touches_of_each_group_of_poses(turned, rng):
    """Pose 0 is a group, and the other poses are one; the first number of an embedding says of which pose it is."""
    turned.groups = (0, *[1] * (P - 1))
    poses, shapes, ids = np.tile(np.arange(P), 30), np.arange(30 * P) // P % K, np.arange(30 * P) // P
    felt = rng.normal(size=(30 * P, D))
    felt[:, 0] = poses
    touches = [Touch(int(pose), rng.normal(size=K), row) for pose, row in zip(poses, felt, strict=True)]
    model = RigidBodyModel.fit(touches, shapes, ids, embed=turned, num_hypotheses=N)
    assert model.groups == turned.groups
    first, others = model.references[..., 0]
    assert set(first) == {0.0}
    assert set(others) == set(range(1, P))
    for group, members in enumerate((range(1), range(1, P))):  # touches of the data with their own logits
        logits = {tuple(np.float16(t.features)): np.float16(t.logits) for t in touches if t.pose in members}
        for reference, own in zip(model.references[group], model.reference_logits[group], strict=True):
            np.testing.assert_array_equal(logits[tuple(np.float16(reference))], own)
