"""Objects with a scale of their own, logits with heavy tails, and rare answers: what is stated at stops is right."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from belief import Touch
from belief.errors import OverconfidentStops
from belief.observation_model import (
    HeavyTailsModel,
    PLDAModel,
    calibration_of_stops,
    certified_stops,
    fit_observation_model,
    read_observation_model,
)
from belief.observation_model.plda import Components, LogitEmbedding
from belief.observation_model.registry import fits
from belief.observation_model.selection import log_posteriors_by_touch
from belief.touch_batch import TouchBatch

SHAPES, TOUCHES = 4, 6


def drawn(kind, number, rng):
    """Logits, labels and groups of objects that are alike, or have their own scale, or noise of heavy tails."""
    labels = rng.integers(SHAPES, size=number)
    signal, size = np.eye(SHAPES)[labels][:, None], ((number, 1, SHAPES), (number, TOUCHES, SHAPES))
    if kind == "usual":
        z = 2.2 * signal + 0.6 * rng.normal(size=size[0]) + 0.8 * rng.normal(size=size[1])
    elif kind == "own scale":
        scale = np.exp(0.8 * rng.normal(size=(number, 1, 1)))
        z = 1.8 * signal + scale * (0.6 * rng.normal(size=size[0]) + 0.7 * rng.normal(size=size[1]))
    else:
        z = 1.8 * signal + 0.5 * rng.standard_t(2, size=size[0]) + 0.6 * rng.standard_t(2, size=size[1])
    return 1.5 * z.reshape(-1, SHAPES), np.repeat(labels, TOUCHES), np.repeat(np.arange(number), TOUCHES)


def as_touches(logits, labels, groups):
    return [Touch(0, row) for row in logits], labels, groups


@pytest.mark.parametrize(("kind", "name"), [("own scale", "plda"), ("heavy tails", "heavy tails")])
def test_what_is_stated_at_stops_is_right_where_objects_differ_in_scale(kind, name):
    rng = np.random.default_rng(0)
    known, new = drawn(kind, 400, rng), drawn(kind, 2000, rng)
    some = {each: fits()[each] for each in ("plda", "heavy tails")}
    choice = fit_observation_model(*known, candidates=some, num_folds=2)
    assert choice.name == name
    found = calibration_of_stops(choice.model, *new)
    before = calibration_of_stops(PLDAModel.fit(*as_touches(*known), spread=0.0), *new)
    assert before.overall.mean_stated - before.overall.share_right > 0.2
    assert found.overall.mean_stated - found.overall.share_right <= 0.03
    assert found.overall.count > 2 * before.overall.count
    assert choice.stops.overall.excess == 0.0
    assert f"right {choice.stops.overall.share_right:.3f}" in choice.at_stops


def test_a_fit_warns_where_no_candidate_knows_of_scales(rng):
    some = {"plda": lambda *data, **labels: PLDAModel.fit(*data, spread=0.0, **labels)}
    with pytest.warns(OverconfidentStops, match=r"stated 0\.9.* right 0\.[5-8]"):
        choice = fit_observation_model(*drawn("own scale", 600, rng), candidates=some, num_folds=2)
    assert choice.stops.overall.excess > 0.03


@pytest.mark.parametrize("seed", [0, 1])
def test_where_objects_are_alike_nothing_changes(seed):
    data = as_touches(*drawn("usual", 400, np.random.default_rng(seed)))
    found, without = PLDAModel.fit(*data), PLDAModel.fit(*data, spread=0.0)
    assert found.spread == 0.0
    assert found.to_json() == without.to_json()
    assert "spread" not in found.to_fields()  # files of before are the same


def scaled(rng, spread):
    """A model of two poses whose objects have scales of this spread."""
    parts = [np.diag([0.5, 1.0]), np.diag([0.3, 0.2]), np.diag([0.6, 0.4])]
    wide = LogitEmbedding(np.full(3, -1e6), np.full(3, 1e6))
    return PLDAModel(("a", "b", "c"), wide, rng.normal(size=(2, 3, 2)), Components(*parts), spread)


def test_the_likelihood_is_a_mean_over_scales_of_normal_densities(rng):
    model, poses = scaled(rng, 0.6), np.array([[0, 1, 0]])
    batch = model.sample_batch(1, poses, rng)
    vectors, (shared, in_pose, alone) = model.embedding(batch)[0], model.components
    equal = (poses[0][:, None] == poses[0]).astype(float)
    spread = np.kron(np.ones((3, 3)), shared) + np.kron(equal, in_pose) + np.kron(np.eye(3), alone)
    nodes = np.linspace(-3.0, 3.0, 301)
    expected = [
        np.mean(
            [
                multivariate_normal.pdf(vectors.ravel(), model.means[poses[0], k].ravel(), np.exp(1.2 * node) * spread)
                * np.exp(-0.5 * node**2)
                for node in nodes
            ]
        )
        for k in range(3)
    ]
    found = model.log_likelihood_batch(batch)[0]
    np.testing.assert_allclose(found - found[0], np.log(expected) - np.log(expected[0]), atol=0.05)


def test_a_model_with_scales_is_written_and_read_and_its_samples_have_the_spread(rng):
    model = scaled(rng, 0.5)
    again = read_observation_model(model.to_json())
    batch = model.sample_batch(0, np.zeros((3000, 4), int), rng)
    np.testing.assert_array_equal(again.log_likelihood_batch(batch), model.log_likelihood_batch(batch))
    away = model.embedding(batch) - model.embedding(batch).mean(axis=1, keepdims=True)
    assert np.log((away**2).sum(axis=(1, 2))).std() > 0.9  # 2 × 0.5 of the scales, beside that of a χ²


def test_heavy_tails_are_recovered_and_one_wrong_logit_does_not_spoil_the_others(rng):
    source = HeavyTailsModel(("a", "b", "c"), 1.0, 3.0 * np.eye(3)[None], np.full(3, 0.3), np.full(3, 0.6), 0.5)
    shapes, poses = np.arange(900) % 3, np.zeros((900, 5), int)
    touches = [
        touch for k, row in zip(shapes, poses, strict=True) for touch in source.sample(int(k), row.tolist(), rng)
    ]
    found = HeavyTailsModel.fit(touches, shapes.repeat(5), np.arange(900).repeat(5))
    assert found.spread in (0.35, 0.5, 0.7)
    np.testing.assert_allclose(found.means * found.unit, source.means, atol=0.2)
    np.testing.assert_allclose(found.of_touch * found.unit**2, source.of_touch, rtol=0.5)
    far = [Touch(0, np.array([3.0, 0.0, 40.0]))] * 3
    assert found.log_likelihood(far).argmax() == 0
    np.testing.assert_array_equal(
        read_observation_model(found.to_json()).log_likelihood(far), found.log_likelihood(far)
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"means": np.zeros((1, 2, 2))}, "means must be"),
        ({"of_touch": np.zeros(3)}, "of_touch must be 3 positive"),
        ({"of_object": np.ones(2)}, "of_object must be 3 positive"),
        ({"spread": 0.0}, "spread must be"),
        ({"unit": 0.0}, "unit must be"),
    ],
)
def test_a_model_of_heavy_tails_that_cannot_be_is_refused(change, message):
    parts = {"unit": 1.0, "means": np.zeros((1, 3, 3)), "of_object": np.ones(3), "of_touch": np.ones(3), "spread": 0.5}
    with pytest.raises(ValueError, match=message):
        HeavyTailsModel(("a", "b", "c"), **{**parts, **change})


def rare(number, rng, apart):
    """Logits, labels and groups of objects of which 1 % have the shape 2, and 2 % the shape 1."""
    labels = rng.choice(3, number, p=[0.97, 0.02, 0.01]).repeat(4)
    shared = rng.normal(size=(number, 1, 3)).repeat(4, axis=1).reshape(-1, 3)
    logits = apart * np.eye(3)[labels] + shared + 2.0 * rng.normal(size=(4 * number, 3))
    return logits, labels, np.arange(number).repeat(4)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_certificate_by_answer_holds_for_rare_answers(seed):
    rng, risk, number = np.random.default_rng(seed), 0.1, 20_000
    for apart, certified in ((2.0, 1), (6.0, 3)):
        model = PLDAModel.fit(*as_touches(*rare(1500, rng, apart)), spread=0.0)
        made = certified_stops(model, *rare(number, rng, apart), risk=risk, by_answer=True)
        assert made.answers == model.shape_labels
        assert np.isfinite(made.thresholds).sum() == certified
        assert ("Not certifiable: shape_1 (too many wrong), shape_2" in str(made).replace("\n", " ")) == (certified < 3)
        logits, labels, _ = rare(number, rng, apart)
        batch = TouchBatch(np.zeros((number, 4), int), logits.reshape(number, 4, 3))
        probs = np.exp(log_posteriors_by_touch(model, batch))
        named = probs.argmax(axis=2)
        reached = probs.max(axis=2) >= np.array(made.thresholds)[named]
        stops = reached & (np.cumsum(reached, axis=1) == 1)
        is_wrong = named != labels.reshape(number, 4)
        for shape in range(3):
            here = stops & (named == shape)
            assert (is_wrong & here).sum() <= risk * here.sum()
            assert here.any() == np.isfinite(made.thresholds[shape])
        if apart == 2.0:  # where one threshold serves all answers, most stops that name the rare shape are wrong
            reached = probs.max(axis=2) >= 0.9
            here = reached & (np.cumsum(reached, axis=1) == 1) & (named == 2)
            assert is_wrong[here].mean() > 0.5
