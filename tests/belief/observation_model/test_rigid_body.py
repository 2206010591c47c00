"""The joint model over shape, orientation and size keeps Bayes' rule, at the extremes too."""

import copy
import json
import pickle
from dataclasses import replace
from functools import reduce

import numpy as np
import pytest
from scipy.special import log_softmax, logsumexp
from scipy.stats import kstest

from belief import SceneBelief, SearchProblem, Touch
from belief.bayes import update
from belief.conflict import ON_MISFIT, log_conflict
from belief.errors import InvalidArgument
from belief.observation_model import FittedRigidBody, FixedHypotheses, RigidBodyModel, read_observation_model
from belief.observation_model.model import check_observation_model
from belief.touch_batch import TouchBatch

P, K, N, D = 3, 2, 40, 4
SPREAD = 1.5
"""Standard deviation of what is felt, around what a body shows in a pose."""


class World:
    """Bodies that show a point of the plane in each pose; a touch feels it with Gaussian noise, so ratios are exact."""

    def __init__(self, rng, num_hypotheses=N):
        self.points = 2.0 * rng.normal(size=(P, K, num_hypotheses, 2))

    def embed(self, num_hypotheses):
        points = self.points[:, :, :num_hypotheses]
        norms = np.square(points).sum(axis=-1, keepdims=True)
        return np.concatenate([points, norms, np.ones_like(norms)], axis=-1).astype(np.float32)

    def touch(self, shape, body, pose, rng):
        felt = self.points[pose, shape, body] + SPREAD * rng.normal(size=2)
        return Touch(pose, np.zeros(K), np.array([*(felt / SPREAD**2), -0.5 / SPREAD**2, 0.0]))

    def model(self, rng, temperature=1.0):
        found = [[self.touch(i % K, i % N, pose, rng).features for i in range(60)] for pose in range(P)]
        labels, blank = tuple("ab"), np.zeros((P, 60, K))
        unnamed = RigidBodyModel(
            labels, N, temperature, np.array(found), blank, hypotheses=FixedHypotheses(self.embed(N))
        )
        marginal = [logsumexp(unnamed.scores(p, some), axis=2) for p, some in enumerate(unnamed.references)]
        return RigidBodyModel(
            labels, N, temperature, np.array(found), np.array(marginal), hypotheses=FixedHypotheses(self.embed(N))
        )


@pytest.mark.parametrize("size", [1e10, 1e30, 1e31, 1e100, 1e300, np.finfo(float).max])
@pytest.mark.parametrize("alternatives", [1, 2])
def test_what_an_embedding_says_does_not_depend_on_its_size(size, alternatives):
    table = np.tile(np.array([[[[3.0, 0.0]], [[0.0, 3.0]]]], np.float32), alternatives)
    one = np.ones((1, 1, 2))
    for temperature in (1.0, 1e-6, 1e6):
        model = RigidBodyModel(("mug", "cup"), 1, temperature, one, one, hypotheses=FixedHypotheses(table))
        for embedding, expected in (([0.25, 1.0], [0.0, 1.0]), ([1.0, 0.5], [1.0, 0.0]), ([1.0, 1.0], [0.5, 0.5])):
            touch = Touch(0, features=np.array(embedding) * size)
            for found in (model.log_likelihood([touch]), model.start().update(touch).log_likelihood):
                posterior = np.exp(update(np.log([0.5, 0.5]), found)[0])
                np.testing.assert_allclose(posterior, expected, atol=1e-6)


@pytest.fixture
def world(rng):
    return World(rng)


def touches_of(world, shape, body, poses, rng):
    return [world.touch(shape, body, pose, rng) for pose in poses]


def posterior(log_likelihood):
    return np.exp(log_softmax(log_likelihood))


def test_the_likelihood_is_the_mean_over_bodies_of_the_product_over_touches(world, rng):
    model = world.model(rng)
    touches = touches_of(world, 1, 7, [0, 2, 2, 1], rng)
    felt = np.array([touch.features[:2] * SPREAD**2 for touch in touches])
    points = world.points[[touch.pose for touch in touches]]  # (n, K, N, 2)
    densities = np.exp(-0.5 * np.square((felt[:, None, None] - points) / SPREAD).sum(axis=-1))
    expected = densities.prod(axis=0).mean(axis=1)
    np.testing.assert_allclose(posterior(model.log_likelihood(touches)), expected / expected.sum(), rtol=1e-4)


@pytest.mark.parametrize(("correlation", "drift"), [(0.0, 0.0), (0.4, 0.0), (1.0, 0.0), (0.0, 0.2), (0.4, 0.2)])
def test_touch_by_touch_and_all_at_once_are_the_same_in_any_order(world, rng, correlation, drift):
    model = replace(world.model(rng), correlation=correlation, drift=drift)
    touches = touches_of(world, 0, 3, [0, 1, 2, 0, 0], rng)
    evidence = model.start()
    for touch in touches:
        evidence = evidence.update(touch)
    assert evidence.num_touches == 5
    expected = posterior(evidence.log_likelihood)
    for order in (range(5), (4, 2, 0, 1, 3)):
        shuffled = [touches[i] for i in order]
        np.testing.assert_allclose(posterior(model.log_likelihood(shuffled)), expected, atol=1e-6)


def test_the_same_touch_again_tells_less_and_with_correlation_one_nothing(world, rng):
    touch = world.touch(1, 7, 0, rng)
    once, *again = (
        replace(world.model(rng), correlation=rho).log_likelihood([touch] * n)
        for rho, n in ((0.5, 1), (0.0, 6), (0.5, 6), (1.0, 6))
    )
    spread = [np.ptp(found) for found in again]
    assert spread[0] > spread[1] > spread[2]
    np.testing.assert_allclose(again[2] - again[2].max(), once - once.max(), atol=1e-5)


def test_a_reader_that_errs_alike_in_a_pose_gets_a_correlation(world, rng):
    """Where all touches in a pose are the same, four tell as much as one."""

    def touches_of_objects(repeated):
        found, shapes, ids = [], [], []
        for number in range(240):
            for pose in range(P):
                felt = [world.touch(number % K, number % N, pose, rng) for _ in range(4)]
                found += [felt[0]] * 4 if repeated else felt
                shapes += [number % K] * 4
                ids += [number] * 4
        return found, shapes, ids

    fitted = [RigidBodyModel.fit(*touches_of_objects(same), embed=world.embed, num_hypotheses=N) for same in (0, 1)]
    assert fitted[0].correlation < 0.1
    assert fitted[1].correlation > 0.8


def test_one_pose_that_was_touched_more_often_does_not_decide_the_correlation_alone(world, rng):
    """All touches in a pose are the same; one object has one more in one pose."""
    found, shapes, ids = [], [], []
    for number in range(240):
        for pose in range(P):
            found += [world.touch(number % K, number % N, pose, rng)] * 4
            shapes += [number % K] * 4
            ids += [number] * 4
    whole = (found, shapes, ids), ([*found, found[0]], [*shapes, shapes[0]], [*ids, ids[0]])
    even, uneven = (RigidBodyModel.fit(*data, embed=world.embed, num_hypotheses=N) for data in whole)
    assert even.correlation > 0.3
    assert uneven.correlation == pytest.approx(even.correlation, abs=0.1)


def test_one_object_with_a_single_touch_does_not_shorten_the_sequences_of_all(world, rng):
    found, shapes, ids = [], [], []
    for number in range(80):
        poses = [0] if number == 0 else list(range(P)) * 2
        found += touches_of(world, number % K, number % N, poses, rng)
        shapes += [number % K] * len(poses)
        ids += [number] * len(poses)
    model = RigidBodyModel.fit(found, shapes, ids, embed=world.embed, num_hypotheses=N)
    assert model.conflict is not None
    assert model.conflict.num_touches == 2 * P
    without = RigidBodyModel.fit(found[1:], shapes[1:], ids[1:], embed=world.embed, num_hypotheses=N)
    assert model.temperature == pytest.approx(without.temperature, rel=0.2)


def test_a_reader_that_errs_alike_about_an_object_gets_a_drift():
    """Two shapes that look the same in 14 poses; the reader's error is of the touch, or of the object."""
    rng, hypotheses = np.random.default_rng(0), np.zeros((14, 2, 1, 2), np.float32)
    hypotheses[:, 0, 0, 0] = hypotheses[:, 1, 0, 1] = 1.0
    shapes = np.repeat(np.arange(400) % 2, 14)
    found = []
    for of_object in (0.0, 0.7):
        errors = rng.normal(size=(5600, 2)) + of_object * np.repeat(rng.normal(size=(400, 2)), 14, axis=0)
        touches = [
            Touch(number % 14, np.zeros(2), feature) for number, feature in enumerate(np.eye(2)[shapes] + errors)
        ]
        found.append(
            RigidBodyModel.fit(
                touches, shapes, np.repeat(np.arange(400), 14), embed=lambda _: hypotheses, num_hypotheses=1
            )
        )
    assert found[0].drift < 0.05 < 0.2 < found[1].drift
    assert RigidBodyModel.from_fields(found[1].to_fields()).drift == found[1].drift


@pytest.mark.parametrize("num_touches", [1, 5])
def test_objects_that_were_touched_in_few_of_many_poses_can_be_fitted(num_touches):
    rng, hypotheses = np.random.default_rng(0), np.zeros((14, 2, 1, 2), np.float32)
    hypotheses[:, 0, 0, 0] = hypotheses[:, 1, 0, 1] = 1.0
    shapes = np.repeat(np.arange(400) % 2, num_touches)
    felt = np.eye(2)[shapes] + rng.normal(size=(len(shapes), 2))
    touches = [Touch(number % num_touches, np.zeros(2), feature) for number, feature in enumerate(felt)]
    ids = np.repeat(np.arange(400), num_touches)
    model = RigidBodyModel.fit(touches, shapes, ids, num_poses=14, embed=lambda _: hypotheses, num_hypotheses=1)
    assert model.temperature == pytest.approx(1.0, abs=0.3)
    assert model.drift < 0.1


def test_its_posterior_is_calibrated_and_ranks_of_bodies_are_uniform(world, rng):
    """Simulation-based calibration: the true body is as often among the likeliest as the posterior says."""
    model = world.model(rng)
    number = 600
    shapes, bodies = rng.integers(K, size=number), rng.integers(N, size=number)
    poses = rng.integers(P, size=(number, 4))
    rows = [touches_of(world, *who, where, rng) for *who, where in zip(shapes, bodies, poses.tolist(), strict=True)]
    batch = TouchBatch.of(rows)
    probs = posterior_rows(model.log_likelihood_batch(batch))
    stated, right = probs.max(axis=1), probs.argmax(axis=1) == shapes
    assert abs(stated.mean() - right.mean()) < 3 * np.sqrt((stated * (1 - stated)).mean() / number)
    weights = model.log_weights(batch)[np.arange(number), shapes]  # (number, N)
    shares = np.exp(log_softmax(weights, axis=1))
    own = shares[np.arange(number), bodies][:, None]
    ranks = (shares * (shares > own)).sum(axis=1) + rng.random(number) * own[:, 0]
    assert kstest(ranks, "uniform").pvalue > 0.01


def posterior_rows(log_likelihoods):
    return np.exp(log_softmax(log_likelihoods, axis=1))


@pytest.mark.parametrize(("too_sure", "error"), [(3.0, 0.05), (200.0, 0.3), (0.02, 0.3)])  # the prior is at 1
def test_a_reader_that_is_too_sure_or_too_modest_gets_a_temperature(world, rng, too_sure, error):
    world.points *= 5.0  # so that a touch tells the body
    touches, shapes, ids = [], [], []
    for number in range(120):
        shape, body = int(rng.integers(K)), int(rng.integers(N))
        touches += touches_of(world, shape, body, range(P), rng)
        shapes += [shape] * P
        ids += [number] * P
    honest = RigidBodyModel.fit(touches, shapes, ids, embed=world.embed, num_hypotheses=N)
    other = RigidBodyModel.fit(
        [Touch(t.pose, t.logits, too_sure * t.features) for t in touches],
        shapes,
        ids,
        embed=world.embed,
        num_hypotheses=N,
    )
    assert honest.temperature == pytest.approx(1.0, abs=0.3)
    assert other.temperature == pytest.approx(too_sure * honest.temperature, rel=error)


def test_as_many_sequences_give_the_temperature_where_memory_is_short(world, rng, monkeypatch):
    shapes, objects, bodies = np.arange(60) % K, np.repeat(np.arange(60), P), rng.integers(N, size=60)
    touches = [t for i in range(60) for t in touches_of(world, shapes[i], bodies[i], range(P), rng)]
    held = RigidBodyModel.fit(touches, shapes[objects], objects, embed=world.embed, num_hypotheses=N)
    monkeypatch.setattr("belief.observation_model.rigid_body_fit._MOST_NUMBERS", 7 * P * K * N)  # of seven sequences
    in_parts = RigidBodyModel.fit(touches, shapes[objects], objects, embed=world.embed, num_hypotheses=N)
    assert in_parts.temperature == pytest.approx(held.temperature, rel=1e-6)


def test_a_thousand_touches_leave_it_finite_and_as_large_as_one(world, rng):
    model = world.model(rng)
    evidence = model.start()
    for touch in touches_of(world, 1, 5, rng.integers(P, size=1000).tolist(), rng):
        evidence = evidence.update(touch)
    assert np.isfinite(evidence.log_weights).all()
    assert evidence.log_weights.nbytes == model.start().log_weights.nbytes
    assert posterior(evidence.log_likelihood)[1] > 0.999
    assert evidence.diagnostics.most_likely[1] == 5
    assert evidence.diagnostics.effective_hypotheses[1] == pytest.approx(1.0, abs=0.01)


def test_contradiction_after_certainty_is_still_an_answer(world, rng):
    model = world.model(rng)
    evidence = model.start()
    for touch in touches_of(world, 0, 2, [0, 1, 2] * 30, rng) + touches_of(world, 1, 9, [0, 1, 2] * 60, rng):
        evidence = evidence.update(touch)
    assert np.isfinite(evidence.log_likelihood).all()
    assert posterior(evidence.log_likelihood).max() > 0.99  # no hypothesis fits well; the answer is not uniform
    assert evidence.diagnostics.effective_hypotheses == pytest.approx(1.0, abs=0.01)  # and the diagnostics say so


@pytest.mark.parametrize("scale", [1e-30, 1e4, 1e30])
def test_embeddings_of_any_size_are_answered(world, rng, scale):
    model = world.model(rng)
    touch = world.touch(0, 1, 2, rng)
    found = model.log_likelihood([Touch(2, touch.logits, scale * touch.features)] * 3)
    assert np.isfinite(posterior(found)).all()


def test_embeddings_and_tables_in_half_precision_agree_with_single(world, rng):
    model, touches = world.model(rng), touches_of(world, 0, 1, [0, 1, 2, 1], rng)
    expected = posterior(model.log_likelihood(touches))
    halves = [Touch(t.pose, t.logits, t.features.astype(np.float16)) for t in touches]
    np.testing.assert_allclose(posterior(model.log_likelihood(halves)), expected, atol=5e-3)
    half = replace(model, hypotheses=FixedHypotheses(world.embed(N).astype(np.float16)))
    np.testing.assert_allclose(posterior(half.log_likelihood(touches)), expected, atol=5e-3)


def test_it_keeps_the_contract_of_observation_models(world, rng):
    check_observation_model(world.model(rng), rng)


def test_sampled_touches_are_of_one_body(world, rng):
    """Repeats of one pose are of one body, so they are more alike than touches of different objects."""
    model = world.model(rng)
    batch = model.sample_batch(0, np.zeros((400, 2), int), rng)
    first, second = batch.features[:, 0], batch.features[:, 1]
    assert np.corrcoef(first[:, 0], second[:, 0])[0, 1] > 0.3


def test_a_file_brings_it_back_and_the_reader_completes_it(world, rng):
    rows = [(number // P % K, number // P % N, number % P, number // P) for number in range(150)]
    touches = [world.touch(shape, body, pose, rng) for shape, body, pose, _ in rows]
    shapes, _, _, ids = np.array(rows).T
    model = RigidBodyModel.fit(touches, shapes, ids, embed=world.embed, num_hypotheses=N)
    found = read_observation_model(model.to_json())
    assert type(found) is FittedRigidBody
    touches = touches_of(world, 0, 1, [0, 1], rng)
    for ask in (found.log_likelihood, lambda _: found.sample(0, [0], rng)):
        with pytest.raises(ValueError, match="with_hypotheses"):
            ask(touches)
    found = found.with_hypotheses(world.embed)
    assert type(found) is RigidBodyModel
    np.testing.assert_allclose(found.log_likelihood(touches), model.log_likelihood(touches))
    np.testing.assert_allclose(found.outcome_table(4).probs, model.outcome_table(4).probs)
    fields = json.loads(model.to_json())
    assert "hypotheses" not in fields


@pytest.mark.parametrize(
    "features", [None, np.zeros(D - 1), np.full(D, np.nan)], ids=["none", "too few", "not a number"]
)
def test_touches_without_their_embedding_are_refused(world, rng, features):
    with pytest.raises(ValueError, match=r"embedding of 4 numbers|finite"):
        world.model(rng).start().update(Touch(0, np.zeros(K), features))


def test_a_touch_that_does_not_fit_the_shapes_is_refused_by_itself_and_in_a_batch(world, rng):
    model, fine = world.model(rng), world.touch(0, 1, 2, rng)
    for wrong in (
        Touch(0, np.zeros(K + 1), fine.features),
        Touch(P, fine.logits, fine.features),
        Touch(0, fine.logits, np.zeros(D + 1)),
    ):
        messages = set()
        for ask in (model.start().update, lambda touch: model.log_likelihood([touch])):
            with pytest.raises(ValueError, match=r"touch|shapes") as error:
                ask(wrong)
            messages.add(str(error.value))
        assert len(messages) == 1


def test_as_many_hypotheses_are_effective_as_share_the_weight(world, rng):
    evidence = world.model(rng).start()
    assert evidence.diagnostics.effective_hypotheses.tolist() == [N] * K
    for number in (1, 3, 10):
        weights = np.full((K, N), -1e3)
        weights[:, 5 : 5 + number] = 0.0
        found = replace(evidence, log_weights=weights).diagnostics
        assert found.effective_hypotheses == pytest.approx([number] * K)
        assert found.most_likely.tolist() == [5] * K


def test_what_evidence_holds_cannot_be_overwritten(world, rng):
    evidence = replace(world.model(rng), correlation=0.4).start().update(world.touch(0, 1, 2, rng))
    for array in (evidence.log_weights, evidence.log_likelihood, evidence.in_pose[2][1]):
        assert not array.flags.writeable


def test_a_table_with_a_generator_of_ones_own_is_made_anew_and_not_kept(world, rng):
    model = world.model(rng)
    assert model.default_outcomes == 12
    table, drawn = model.outcome_table(), model.outcome_table(rng=np.random.default_rng(0))
    assert model.outcome_table(12) is table is not drawn
    np.testing.assert_array_equal(drawn.probs, table.probs)


def test_outcomes_that_no_reference_has_are_as_likely_as_a_tenth_of_a_touch_makes_them(world, rng):
    model = world.model(rng)
    alike = replace(model, reference_logits=np.zeros_like(model.reference_logits))  # of 60 touches in each pose
    probs = np.sort(alike.outcome_table(5).probs, axis=2)
    np.testing.assert_allclose(probs[..., :4], 0.1 / 5 / 60.1)


def test_arrays_that_do_not_fit_are_refused(world):
    references, logits = np.zeros((P, 5, D)), np.zeros((P, 5, K))
    for arguments, words in (
        ((N, 0.0, references, logits), "temperature"),
        ((N, np.inf, references, logits), "temperature"),
        ((0, 1.0, references, logits), "num_hypotheses must be an integer, at least 1"),
        ((N, 1.0, references, logits[:, :4]), "reference_logits"),
    ):
        with pytest.raises(ValueError, match=words):
            FittedRigidBody(("a", "b"), *arguments)
    fitted = FittedRigidBody(("a", "b"), N, 1.0, references, logits)
    for table, number in ((world.embed(N)[:, :1], N), (world.embed(N), N + 1)):
        with pytest.raises(ValueError, match="hypotheses must be"):
            fitted.with_hypotheses(FixedHypotheses(table), number)
    with pytest.raises(ValueError, match=r"must be \(P, K, N, D\), got \(4, 4\)"):
        FixedHypotheses(np.zeros((4, 4)))
    with pytest.raises(ValueError, match=r"at most 1e.06"):
        FixedHypotheses(np.full((P, K, N, D), 1e7))
    with pytest.raises(ValueError, match=r"groups \(0, 1, 2\) need hypotheses embedded by pose"):
        replace(fitted, groups=(0, 1, 2)).with_hypotheses(world.embed)


def test_hypotheses_are_embedded_at_first_use_and_never_again(world, rng):
    made = []

    def embed(num_hypotheses):
        made.append(num_hypotheses)
        return world.embed(num_hypotheses)

    whole = world.model(rng)
    model = whole.with_hypotheses(embed)
    assert made == []
    touches = touches_of(world, 0, 1, [0, 1], rng)
    np.testing.assert_array_equal(model.log_likelihood(touches), whole.log_likelihood(touches))
    sent = copy.deepcopy(model)
    np.testing.assert_array_equal(sent.log_likelihood(touches), whole.log_likelihood(touches))
    assert made == [N]
    for one in (model, sent):
        assert not one.table.flags.writeable


@pytest.mark.parametrize("num_kept", [0, 1, P])
def test_outcomes_are_kept_in_as_many_poses_as_fit_and_computed_in_the_others(world, rng, monkeypatch, num_kept):
    model, chosen = world.model(rng), rng.integers(N, size=(K, 7))
    expected, bound = model.outcomes.of(chosen, 20), num_kept * K * N * 20
    monkeypatch.setattr("belief.observation_model.embedded_hypotheses._MOST_OUTCOMES", bound)
    fresh = model.with_hypotheses(FixedHypotheses(model.table))
    np.testing.assert_allclose(fresh.outcomes.of(chosen, 20), expected, rtol=1e-5)
    assert sum(kept.size for kept in fresh.outcomes._of_poses.values()) == bound
    assert expected.shape == (P, K, 7, 20)


def test_a_copy_in_another_process_scores_touches_alike_to_the_last_bit(world, rng):
    model = world.model(rng)
    sent = pickle.loads(pickle.dumps(model))
    felt = world.touch(0, 1, 2, rng).features[None]
    np.testing.assert_array_equal(sent.scores(2, felt), model.scores(2, felt))
    assert sent.table.strides == model.table.strides


def test_logits_are_of_no_account_to_it(world, rng):
    model = world.model(rng)
    touches = touches_of(world, 0, 3, [0, 1, 2, 0], rng)
    bare = [Touch(touch.pose, features=touch.features) for touch in touches]
    np.testing.assert_array_equal(model.log_likelihood(bare), model.log_likelihood(touches))
    ours, theirs = (reduce(lambda e, touch: e.update(touch), some, model.start()) for some in (bare, touches))
    np.testing.assert_array_equal(ours.log_weights, theirs.log_weights)


def test_an_object_whose_sides_fit_no_body_is_a_stranger_and_then_no_conflict(world, rng):
    world.points *= 5.0  # so that a touch tells the body
    touches, shapes, ids = [], [], []
    for number in range(120):
        shape, body = number % K, int(rng.integers(N))
        touches += touches_of(world, shape, body, [0, 1, 2, 0], rng)
        shapes, ids = shapes + [shape] * 4, ids + [number] * 4
    fitted = RigidBodyModel.fit(touches, shapes, ids, shape_labels=tuple("ab"), embed=world.embed, num_hypotheses=N)
    start = fitted.start()
    assert start.log_unlisted == 0.0
    usual, strange = start, start
    for touch in touches_of(world, 0, 3, [0, 1, 2], rng):
        usual = usual.update(touch)
    for pose in [0, 1, 2, 0]:
        strange = strange.update(world.touch(pose % K, 5 + 7 * strange.num_touches, pose, rng))
    for evidence in (usual, strange):
        bets = log_conflict([evidence.log_bets[ON_MISFIT]])
        ratio = evidence.log_unlisted - (logsumexp(evidence.log_likelihood) - np.log(K))
        assert ratio == pytest.approx(bets, abs=1e-9)
    unlisted = [one.log_unlisted - logsumexp(one.log_likelihood) for one in (usual, strange)]
    assert unlisted[1] > unlisted[0] + 3.0
    scenes = [SceneBelief(SearchProblem(tuple("ab"), tuple("xyz"), 1, unlisted=share), fitted) for share in (0.0, 0.3)]
    for pose, body in zip([0, 1, 2, 0, 1, 2], [1, 9, 17, 25, 33, 6], strict=True):
        touch = world.touch(pose % K, body, pose, rng)
        closed, open_ = (scene.update(0, [touch]) for scene in scenes)
    assert closed.unlisted == 0.0
    assert closed.probs.sum() == pytest.approx(1.0)
    assert open_.unlisted > 0.8
    assert scenes[0].log_conflict > scenes[1].log_conflict + 1.0  # a stranger explains it


def test_a_model_without_a_conflict_test_cannot_weigh_strangers(world, rng):
    problem = SearchProblem(tuple("ab"), tuple("xyz"), 2, unlisted=0.05)
    with pytest.raises(InvalidArgument, match="no conflict test, by which it would tell"):
        SceneBelief(problem, world.model(rng))
