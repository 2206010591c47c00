"""Laws that every observation model must obey, whatever it is made of."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from belief import Touch
from belief.files import sealed_json, unsealed_json
from belief.observation_model import read_observation_model, read_origin
from belief.observation_model.plda import sampled_posteriors
from belief.observation_model.registry import fits
from belief.observation_model.selection import log_posteriors
from belief.synthetic import random_model
from belief.touch_batch import TouchBatch

BOTH_POSES = np.array([0, 1])
OPTIONS = {"shape_labels": ("ball", "cube", "cone"), "num_poses": 2}


def objects(model, rng, num_objects, poses):
    """Touches of so many objects of each shape, and their shapes."""
    rows = np.tile(poses, (num_objects, 1))
    batches = [model.sample_batch(k, rows, rng) for k in range(len(model.shape_labels))]
    features = None if batches[0].features is None else np.concatenate([b.features for b in batches])
    batch = TouchBatch(
        np.concatenate([b.poses for b in batches]), np.concatenate([b.logits for b in batches]), features
    )
    return batch, np.repeat(np.arange(len(batches)), num_objects)


def with_logits(touch, logits):
    """The touch with other logits, and with features as large, if it has any."""
    scale = float(np.clip(np.abs(np.asarray(logits, np.float64)).max(), None, 1e308))
    features = None if touch.features is None else np.resize([scale, -scale, 0.0], len(touch.features))
    return Touch(touch.pose, logits, features)


def test_no_touches_are_no_evidence(any_model):
    assert any_model.log_likelihood([]).tolist() == [0.0] * 3
    batch, _ = objects(any_model, np.random.default_rng(0), 1, [0])
    assert any_model.log_likelihood_batch(batch.first(0)).tolist() == [[0.0] * 3] * 3


def test_order_of_touches_does_not_matter(any_model, rng):
    batch, _ = objects(any_model, rng, 5, [0, 1, 0, 1, 0, 0])
    found = any_model.log_likelihood_batch(batch)
    for order in (slice(None, None, -1), rng.permutation(6)):
        np.testing.assert_allclose(any_model.log_likelihood_batch(batch.touches(order)), found, rtol=1e-9, atol=1e-9)


def test_one_by_one_is_as_all_at_once(any_model, rng):
    batch, _ = objects(any_model, rng, 4, [0, 1, 1])
    found = [any_model.log_likelihood(batch.sequence(row)) for row in range(len(batch))]
    np.testing.assert_allclose(any_model.log_likelihood_batch(batch), found, rtol=1e-9, atol=1e-9)


def test_more_sequences_than_fit_a_block_are_as_few(any_model, rng):
    batch, _ = objects(any_model, rng, 2, [0, 1, 1])
    rows = np.resize(np.arange(len(batch)), 8000)
    found = any_model.log_likelihood_batch(batch.sequences(rows))
    np.testing.assert_allclose(found, any_model.log_likelihood_batch(batch)[rows], rtol=1e-12, atol=1e-9)


def test_claims_about_its_own_touches_are_right(any_model, rng):
    # If p is the posterior, the true shape has probability ∑ p² on average: two touches of 9 000 objects.
    batch, shapes = objects(any_model, rng, 3000, BOTH_POSES)
    probs = np.exp(log_posteriors(any_model, batch))
    surprise = probs[np.arange(len(shapes)), shapes] - (probs**2).sum(axis=1)
    # Single precision, cut-offs and, for the ratio, the calibration of few touches: none is worth more than .02.
    assert abs(surprise.mean()) < 4.0 * surprise.std() / np.sqrt(len(shapes)) + (
        0.02 if any_model.name == "ratio" else 0.002
    )


def test_the_true_shape_wins_in_the_long_run_with_several_poses(any_model, rng):
    batch, shapes = objects(any_model, rng, 400, np.tile(BOTH_POSES, 15))
    losses = [-log_posteriors(any_model, batch.first(n))[np.arange(len(shapes)), shapes].mean() for n in (1, 2, 30)]
    assert losses[0] > losses[1] > losses[2]
    assert losses[0] < np.log(3.0)


def test_json_keeps_every_bit(any_model, rng):
    copy = read_observation_model(any_model.to_json())
    batch, _ = objects(any_model, rng, 20, [0, 1, 0])
    assert copy.to_json() == any_model.to_json()
    assert type(copy) is type(any_model)
    assert getattr(copy, "status", None) == getattr(any_model, "status", None)
    np.testing.assert_array_equal(copy.log_likelihood_batch(batch), any_model.log_likelihood_batch(batch))
    np.testing.assert_array_equal(copy.outcome_table().probs, any_model.outcome_table().probs)


def paths(fields, path=()):
    """Where values are in nested dictionaries."""
    for key, value in fields.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from paths(value, (*path, key))


def damaged(text, path, *values):
    """The text without what is at the path; then with each value in its place."""
    for value in (None, *[(value,) for value in values]):
        fields = json.loads(text)
        inner = fields
        for key in path[:-1]:
            inner = inner[key]
        if value is None:
            del inner[path[-1]]
        else:
            inner[path[-1]] = value[0]
        yield json.dumps(fields)


def resealed(text):
    """A text that somebody changed by hand, with the digest of what it says now, if it can have one."""
    try:
        return sealed_json({key: value for key, value in json.loads(text).items() if key != "sha256"})
    except ValueError:
        return text


def test_damaged_text_is_refused_or_read_as_a_model_that_works(any_model, rng):
    batch, _ = objects(any_model, rng, 2, [0, 1])
    if any_model.name == "ratio":  # a few references will do, and are read faster
        any_model = replace(any_model, references=any_model.references[:, :3])
    text, refused = any_model.to_json(), 0
    values = (None, "x", [], {}, -1, [[1.0]], float("nan"), float("inf"))
    for path in paths(unsealed_json(text)):
        for broken in damaged(text, path, *values):
            try:
                model = read_observation_model(resealed(broken))
            except ValueError as error:
                assert str(error).startswith("not an observation model: ")  # noqa: PT017
                refused += 1
            else:
                assert not np.isnan(model.log_likelihood_batch(batch)).any()
    assert refused > 30


def test_a_model_in_which_one_digit_flipped_is_refused(any_model):
    text = any_model.to_json()
    at = [found.start() + 2 for found in re.finditer(r"\d\.[1-8]", text)][-1]
    with pytest.raises(ValueError, match="was changed after it was written"):
        read_observation_model(text[:at] + str(int(text[at]) + 1) + text[at + 1 :])


def test_a_model_keeps_what_it_was_fitted_to(any_model):
    text = any_model.to_json({"scene": {"pad": 3}})
    assert read_origin(text) == {"scene": {"pad": 3}}
    assert read_origin(any_model.to_json()) is None
    assert read_observation_model(text).to_json() == any_model.to_json()


@pytest.mark.parametrize("part", [0.0, 0.3, 0.999])
def test_truncated_text_is_refused(any_model, part):
    text = any_model.to_json()
    with pytest.raises(ValueError, match="not an observation model"):
        read_observation_model(text[: int(part * len(text))])


@pytest.mark.parametrize(
    "text", ["null", "[]", "3", '"ratio"', "{}", '{"model": "oracle"}', '{"model": []}', "[" * 9**5]
)
def test_foreign_text_is_refused(text):
    with pytest.raises(ValueError, match="not an observation model"):
        read_observation_model(text)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda t: Touch(2, t.logits, t.features), "pose 2"),
        (lambda t: Touch(0, t.logits[:2], t.features), "row of logits"),
        (lambda t: Touch(0, t.logits - np.array([0.0, np.inf, 0.0]), t.features), "finite logits"),
        (lambda t: Touch(0, t.logits, np.array([np.inf, 0.0])), "features"),
    ],
)
def test_a_touch_that_does_not_fit_is_refused_by_number(any_model, rng, spoil, message):
    good, bad = any_model.sample(0, [0, 1], rng)
    if "features" in message and good.features is None:
        good = Touch(good.pose, good.logits, np.zeros(2))
    with pytest.raises(ValueError, match=rf"touch 1 .*{message}"):
        any_model.log_likelihood([good, spoil(bad)])


def test_touches_of_another_number_of_shapes_are_refused(any_model):
    with pytest.raises(ValueError, match=r"knows 3 shapes .* touch 0 and all others have 2 logits"):
        any_model.log_likelihood([Touch(0, np.zeros(2), np.zeros(5))])


@pytest.mark.parametrize(
    ("shape", "poses", "message"),
    [
        (3, [0], r"shape must be an integer in \[0, 3\)"),
        (-1, [0], "shape must be"),
        (0, [2], "poses must be"),
        (0, [0.5], "integers"),
    ],
)
def test_samples_of_what_there_is_not_are_refused(any_model, rng, shape, poses, message):
    with pytest.raises(ValueError, match=message):
        any_model.sample(shape, poses, rng)


EXTREME_LOGITS = [
    np.array([1e308, -1e308, 0.0]),
    np.array([-1.7e308, 1.7e308, 1.7e308]),
    np.array([1e-300, -1e-300, 0.0]),
    np.array([5e-324, 0.0, 0.0]),
    np.zeros(3),
    np.full(3, 1e308),
    np.float16([60000.0, -60000.0, 6e-8]),
    np.float32([3e38, -3e38, 1e-45]),
    np.longdouble([1.0, 2.0, 3.0]),
    np.array([1, 0, 2]),
]


@pytest.mark.parametrize("logits", EXTREME_LOGITS, ids=str)
def test_extreme_logits_give_finite_answers(any_model, rng, logits):
    ordinary = any_model.sample(0, [0, 1], rng)
    for touches in ([with_logits(ordinary[0], logits)], [*ordinary, with_logits(ordinary[0], logits)] * 40):
        found = any_model.log_likelihood(touches)
        # Only a table with zeros may call an outcome impossible.
        assert np.isfinite(found).all() or (any_model.outcome_table().probs == 0.0).any()
        assert not np.isnan(found).any()


@pytest.mark.parametrize("name", fits())
def test_relabelling_shapes_permutes_the_answer(name, world, rng):
    new = np.array([2, 0, 1])  # the new index of each shape
    old = np.argsort(new)
    batch, shapes = objects(world, rng, 60, [0, 1, 0, 1, 1, 0])
    touches = [touch for row in range(len(batch)) for touch in batch.sequence(row)]
    ids = np.arange(len(touches)) // batch.num_touches
    model = fits()[name](touches, shapes[ids], ids)
    renamed = [Touch(touch.pose, touch.logits[old]) for touch in touches]
    other = fits()[name](renamed, new[shapes[ids]], ids)
    found = log_posteriors(other, TouchBatch(batch.poses, batch.logits[..., old]))
    np.testing.assert_allclose(found, log_posteriors(model, batch)[:, old], rtol=1e-5, atol=1e-5)


def test_the_outcome_table_holds_positive_distributions_and_is_the_same_when_asked_twice(any_model):
    table = any_model.outcome_table()
    assert (table.num_poses, table.num_shapes) == (2, 3)
    assert table.num_outcomes == any_model.default_outcomes
    np.testing.assert_allclose(table.probs.sum(axis=2), 1.0, rtol=1e-12)
    assert (table.probs >= 0.0).all()
    again = read_observation_model(any_model.to_json()).outcome_table()
    np.testing.assert_array_equal(again.probs, table.probs)
    assert any_model.outcome_table() is table  # as planners ask for it again and again


def test_fewer_outcomes_tell_less_and_none_more_than_the_touch(any_model):
    told = [any_model.outcome_table(m).information() for m in (1, 2, 4, 9)]
    assert [any_model.outcome_table(m).num_outcomes for m in (1, 2)] == [1, 2]
    np.testing.assert_allclose(told[0], 0.0, atol=1e-12)
    means = [some.mean() for some in told]
    assert means[0] < means[1] < means[2] + 1e-3 < means[3] + 2e-3
    # 12 000 sampled touches each: a standard error of about .005 nats.
    log_posteriors = sampled_posteriors(any_model, np.random.default_rng(1), 4000)
    most = np.einsum("pknk->pkn", log_posteriors).mean(axis=(1, 2)) + np.log(log_posteriors.shape[1])
    assert (told[-1] < most + 0.03).all()
    if any_model.name != "ratio":  # whose samples are of its references, of which there are few
        assert (told[-1] > 0.8 * most - 0.02).all()


@pytest.mark.parametrize("number", [0, -3])
def test_a_table_of_no_outcomes_is_refused(any_model, number):
    with pytest.raises(ValueError, match=r"num_outcomes must be .* at least 1"):
        any_model.outcome_table(number)


@pytest.mark.parametrize("name", fits())
def test_lists_names_and_small_floats_will_do_as_arrays_would(name, world, rng):
    batch, shapes = objects(world, rng, 30, [0, 1, 0])
    touches = [touch for row in range(len(batch)) for touch in batch.sequence(row)]
    ids = np.arange(len(touches)) // 3
    model = fits()[name](touches, shapes[ids], ids)
    listed = [Touch(int(touch.pose), touch.logits.tolist()) for touch in touches]
    same = fits()[name](tuple(listed), shapes[ids].tolist(), [f"{i:09d}" for i in ids])
    np.testing.assert_array_equal(same.log_likelihood_batch(batch), model.log_likelihood_batch(batch))
    halves = [Touch(touch.pose, touch.logits.astype(np.float16)) for touch in touches]
    rounded = fits()[name](halves, shapes[ids].astype(np.uint8), ids)
    np.testing.assert_allclose(log_posteriors(rounded, batch), log_posteriors(model, batch), rtol=0.1, atol=0.1)


@pytest.mark.parametrize("name", fits())
def test_a_touch_without_logits_is_refused_by_a_model_that_reads_them(name, rng):
    source, ids = random_model(rng, num_shapes=2, num_poses=2), np.arange(160) // 4
    touches = [touch for i in range(40) for touch in source.sample(i % 2, [0, 1, 0, 1], rng)]
    model, bare = fits()[name](touches, ids % 2, ids), Touch(1, features=np.zeros(3))
    for ask in (model.start().update, lambda touch: model.log_likelihood([touch])):
        with pytest.raises(ValueError, match="have no logits"):
            _ = getattr(ask(bare), "log_likelihood", None)
