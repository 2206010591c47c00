"""Every observation model fitted to collections that hardly are any: it answers, and says what it had to assume."""

import numpy as np
import pytest

from belief import Touch
from belief.observation_model import plda, read_observation_model
from belief.observation_model.registry import fits


def collection(logits, shapes, ids=None, poses=None):
    """Touches, shapes and ids; every touch in pose 0 and of another object unless said otherwise."""
    poses = np.zeros(len(logits), int) if poses is None else poses
    touches = [Touch(int(pose), row) for pose, row in zip(poses, logits, strict=True)]
    return touches, np.asarray(shapes), np.arange(len(touches)) if ids is None else np.asarray(ids)


def scores(n, seed=0):
    shapes = np.arange(n) % 3
    return 2.0 * np.eye(3)[shapes] + np.random.default_rng(seed).normal(size=(n, 3)), shapes


def with_one(logits, row):
    return np.concatenate([logits[:-1], [row]])


NOISY, TRUTH = scores(60)
PAIRS = np.arange(60) // 6 * 3 + TRUTH  # two touches of each of thirty objects
COLLECTIONS = {
    "one touch": collection(NOISY[:1], TRUTH[:1]),
    "one object": collection(NOISY[:4], np.zeros(4, int), np.zeros(4, int), [0, 0, 1, 1]),
    "one object a shape": collection(NOISY, TRUTH, TRUTH),
    "one shape": collection(NOISY, np.ones(60, int), np.arange(60) // 2),
    "one touch a shape": collection(NOISY[:3], TRUTH[:3]),
    "two shapes of three": collection(NOISY, TRUTH % 2, np.arange(60) // 2 * 2 + TRUTH % 2),
    "all touches equal": collection(np.tile([1.0, 2.0, 3.0], (60, 1)), TRUTH, PAIRS),
    "all touches zero": collection(np.zeros((60, 3)), TRUTH, PAIRS),
    "touches of an object equal": collection(
        np.repeat(NOISY[:20], 3, axis=0), np.repeat(TRUTH[:20], 3), np.arange(60) // 3
    ),
    "separable": collection(50.0 * np.eye(3)[TRUTH], TRUTH, PAIRS),
    "always wrong": collection(-3.0 * np.eye(3)[TRUTH], TRUTH, PAIRS),
    "one huge touch": collection(with_one(NOISY, [1e308, -1e308, 0.0]), TRUTH, PAIRS),
    "huge touches": collection(1e307 * NOISY, TRUTH, PAIRS),
    "tiny touches": collection(1e-307 * NOISY, TRUTH, PAIRS),
    "subnormal touches": collection(5e-324 * np.sign(NOISY), TRUTH, PAIRS),
    "small floats": collection(NOISY.astype(np.float16), TRUTH.astype(np.uint8), PAIRS.astype(str)),
    "groups of unequal length": collection(NOISY, np.repeat([0, 1, 2], [1, 17, 42]), np.repeat([0, 1, 2], [1, 17, 42])),
    "a pose never seen": collection(NOISY, TRUTH, PAIRS, 2 * (np.arange(60) % 2)),
    "two shapes only": collection(NOISY[:, :2], TRUTH % 2, np.arange(60) // 2 * 2 + TRUTH % 2),
    "more shapes than touches": collection(np.eye(5)[:3], [0, 2, 4]),
}


@pytest.fixture(autouse=True)
def _tables_of_few_touches(monkeypatch):
    """Tables are made of 100 sampled touches: that they are finite counts here, which takes most of the time."""
    monkeypatch.setattr(plda.sampled_table, "__defaults__", (100,))


@pytest.mark.parametrize("data", COLLECTIONS.values(), ids=COLLECTIONS)
@pytest.mark.parametrize("name", fits())
def test_every_model_of_every_collection_answers_and_survives_a_file(name, data):
    model = fits()[name](*data, num_poses=4)
    again = read_observation_model(model.to_json())
    num_shapes = len(data[0][0].logits)
    for logits in (data[0][-1].logits, np.zeros(num_shapes), np.array([1e308, -1e308] + [0.0] * (num_shapes - 2))):
        for pose in (0, 3):
            found = model.log_likelihood([Touch(pose, logits)] * 5)
            assert np.isfinite(found).all()
            np.testing.assert_array_equal(again.log_likelihood([Touch(pose, logits)] * 5), found)
    assert np.isfinite(model.outcome_table(4).probs).all()
    touches = model.sample(num_shapes - 1, [0, 1, 2, 3], np.random.default_rng(0))
    assert np.isfinite([touch.logits for touch in touches]).all()


def test_the_ratio_says_where_it_had_no_repeats():
    expected = {"one touch": "one_shape", "touches of an object equal": "ok", "one touch a shape": "no_repeats"}
    assert {name: fits()["ratio"](*COLLECTIONS[name]).status for name in expected} == expected
