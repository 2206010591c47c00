"""Signatures against the sum over all of them, touch by touch."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belief import Touch
from belief.calibration import TemperatureScaling
from belief.observation_model import ConfusionModel, SignatureModel
from belief.observation_model.selection import sequence_nll
from belief.touch_batch import TouchBatch

LABELS = ("ball", "cube", "cone")
PLAIN = TemperatureScaling(1.0, "ok")


def single_touches(table):
    return ConfusionModel(LABELS[: table.shape[1]], table, PLAIN)


def by_hand(table, rho, poses, outcomes):
    """∏ over poses of ∑_m T_km ∏_t (ρ [o_t = m] + (1 - ρ) T_k,o_t), ``(K,)``."""
    total = np.ones(table.shape[1])
    for pose in set(poses):
        shown = [o for p, o in zip(poses, outcomes, strict=True) if p == pose]
        of_pose = np.zeros(table.shape[1])
        for m in range(table.shape[2]):
            product = table[pose, :, m].copy()
            for o in shown:
                product *= rho * (o == m) + (1.0 - rho) * table[pose, :, o]
            of_pose += product
        total *= of_pose
    return total


touches = st.lists(st.tuples(st.integers(0, 1), st.integers(0, 2)), min_size=1, max_size=7)


@settings(max_examples=200)
@given(touches, st.sampled_from([0.0, 0.1, 0.5, 0.95, 0.999]), st.booleans(), st.integers(0, 20))
def test_likelihoods_are_the_sum_over_signatures(felt, rho, has_zeros, seed):
    table = np.random.default_rng(seed).dirichlet(np.ones(3), size=(2, 3))
    if has_zeros:
        table[0, 1, 0] = table[1, 2, 2] = 0.0
        table /= table.sum(axis=2, keepdims=True)
    poses, outcomes = zip(*felt, strict=True)
    batch = TouchBatch(np.array([poses]), 5.0 * np.eye(3)[list(outcomes)][None])
    found = SignatureModel(single_touches(table), rho).log_likelihood_batch(batch)[0]
    with np.errstate(divide="ignore"):
        np.testing.assert_allclose(found, np.log(by_hand(table, rho, poses, outcomes)), rtol=1e-9, atol=1e-12)


def test_without_repeats_it_is_the_confusion_model(rng):
    single = single_touches(rng.dirichlet(np.ones(3), size=(2, 3)))
    batch = TouchBatch(rng.integers(2, size=(30, 8)), rng.normal(size=(30, 8, 3)))
    found = SignatureModel(single, 0.0).log_likelihood_batch(batch)
    np.testing.assert_allclose(found, single.log_likelihood_batch(batch), rtol=1e-10)


def test_one_touch_says_the_same_whatever_repeats(rng):
    single = single_touches(rng.dirichlet(np.ones(3), size=(2, 3)))
    batch = TouchBatch(rng.integers(2, size=(30, 1)), rng.normal(size=(30, 1, 3)))
    for rho in (0.3, 0.999):
        found = SignatureModel(single, rho).log_likelihood_batch(batch)
        np.testing.assert_allclose(found, single.log_likelihood_batch(batch), rtol=1e-10)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.999])
def test_likelihoods_of_everything_that_can_happen_sum_to_one(rho, rng):
    single = single_touches(rng.dirichlet(np.ones(3), size=(2, 3)))
    outcomes = np.array(np.meshgrid(*[range(3)] * 4)).reshape(4, -1).T  # all 81 of four touches
    batch = TouchBatch(np.tile([0, 0, 1, 0], (81, 1)), 5.0 * np.eye(3)[outcomes])
    total = np.exp(SignatureModel(single, rho).log_likelihood_batch(batch)).sum(axis=0)
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)


def test_samples_repeat_as_often_as_the_model_says(rng):
    # 40 000 pairs of touches: standard error of a share at most .0025.
    table = rng.dirichlet(np.ones(3), size=(2, 3))
    model = SignatureModel(single_touches(table), 0.6)
    outcomes = model.confusion.outcomes_of(model.sample_batch(1, np.tile([0, 0, 1], (40_000, 1)), rng).logits)
    chance = (table[0, 1] ** 2).sum()
    assert (outcomes[:, 0] == outcomes[:, 1]).mean() == pytest.approx(0.36 + 0.64 * chance, abs=0.01)
    assert (outcomes[:, 0] == outcomes[:, 2]).mean() == pytest.approx(table[0, 1] @ table[1, 1], abs=0.01)
    np.testing.assert_allclose(np.bincount(outcomes[:, 1]) / 40_000, table[0, 1], atol=0.01)


def collected(model, rng, num_objects, poses):
    felt, shapes = [], np.arange(num_objects) % 3
    for shape in shapes:
        felt += model.sample(int(shape), poses, rng)
    return felt, shapes.repeat(len(poses)), np.arange(num_objects).repeat(len(poses))


@pytest.mark.parametrize("rho", [0.0, 0.4, 0.8])
def test_fitting_finds_how_far_touches_repeat(rho, rng):
    table = 0.6 * np.eye(3) + 0.4 / 3 + np.zeros((2, 3, 3))
    source = SignatureModel(single_touches(table), rho)
    found = SignatureModel.fit(*collected(source, rng, 1500, [0, 1] * 4))
    assert found.status == "ok"
    assert found.repeat_probability == pytest.approx(rho, abs=0.06)


def test_exact_copies_are_worth_one_touch(rng):
    source = single_touches(0.6 * np.eye(3) + 0.4 / 3 + np.zeros((2, 3, 3)))
    felt, shapes, ids = collected(source, rng, 900, [0])
    found = SignatureModel.fit(np.repeat(np.array(felt, object), 4).tolist(), shapes.repeat(4), ids.repeat(4))
    assert found.repeat_probability > 0.98
    once, often = (np.ptp(found.log_likelihood([felt[0]] * n)) for n in (1, 50))
    assert often < 1.05 * once


@pytest.mark.parametrize("size", [1, 2])
def test_what_is_not_known_of_repeats_is_assumed_and_said(size):
    # One touch of each object; then two, but of objects of one shape only.
    felt = [Touch(0, np.eye(3)[i % 3]) for i in range(6)]
    shapes, ids = (np.arange(6) % 3, np.arange(6)) if size == 1 else (np.zeros(6, int), np.arange(6) // 2)
    model = SignatureModel.fit(felt, shapes, ids)
    assert (model.status, model.repeat_probability) == ("no_repeats", 0.5)


def test_groups_of_any_length_count(rng):
    table = 0.6 * np.eye(3) + 0.4 / 3 + np.zeros((1, 3, 3))
    source, felt, shapes, ids = SignatureModel(single_touches(table), 0.5), [], [], []
    for i in range(900):
        some = source.sample(i % 3, [0] * (1 + i % 5), rng)
        felt, shapes, ids = felt + some, shapes + [i % 3] * len(some), ids + [f"{i}"] * len(some)
    assert SignatureModel.fit(felt, shapes, ids).repeat_probability == pytest.approx(0.5, abs=0.1)


def test_a_million_touches_that_repeat_are_no_trouble(rng):
    model = SignatureModel(single_touches(rng.dirichlet(np.ones(3), size=(2, 3))), 0.9)
    batch = model.sample_batch(1, np.zeros((1, 10**6), int), rng)
    assert np.isfinite(model.log_likelihood_batch(batch)).all()


@pytest.mark.parametrize(
    "change",
    [{"repeat_probability": 1.0}, {"repeat_probability": -0.1}, {"repeat_probability": np.nan}, {"status": "fine"}],
)
def test_what_cannot_be_is_refused(change):
    single = single_touches(np.full((1, 3, 3), 1 / 3))
    with pytest.raises(ValueError, match=r"in \[0, 1\)|must be one of"):
        SignatureModel(**{"confusion": single, "repeat_probability": 0.5, **change})


def unlike_objects(rng, number, num_shapes=4, num_poses=3, rounds=4):
    """Touches of objects that differ within a shape, and in each pose once more."""
    ids = np.repeat(np.arange(number), num_poses * rounds)
    poses = np.tile(np.repeat(np.arange(num_poses), rounds), number)
    shift = 1.5 * rng.normal(size=(number, 1, num_shapes)) + 0.7 * rng.normal(size=(number, num_poses, num_shapes))
    logits = (
        2.0 * np.eye(num_shapes)[ids % num_shapes] + shift[ids, poses] + 0.7 * rng.normal(size=(len(ids), num_shapes))
    )
    return [Touch(int(pose), row) for pose, row in zip(poses, logits, strict=True)], ids % num_shapes, ids


def test_repeats_of_a_few_unlike_objects_are_worth_what_they_are_on_other_objects():
    # Three worlds of twelve objects. Fitted to counts of the same objects, ρ is 0.55 and the loss 0.2 above the least.
    above = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        model = SignatureModel.fit(*unlike_objects(rng, 12))
        touches, shapes, ids = unlike_objects(rng, 60)
        losses = [
            sequence_nll(replace(model, repeat_probability=rho), TouchBatch.of([touches]), shapes, ids)
            for rho in (model.repeat_probability, 0.4, 0.6, 0.8, 0.9, 0.99)
        ]
        above.append(losses[0] - min(losses))
    assert np.mean(above) < 0.08
