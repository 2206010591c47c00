import pickle
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from belief import SceneBelief, SearchProblem
from belief.conflict import SimulatedTouches
from belief.observation_model import (
    FixedHypotheses,
    FixedWorlds,
    RigidBodyModel,
    SensorHealthModel,
    read_observation_model,
    spread_prior,
)
from belief.observation_model.rigid_body import joint_model
from belief.problem import Elsewhere, Touch

P, W, K, N, M = 3, 3, 3, 4, 6  # poses, worlds, shapes, hypotheses, outcomes
LABELS, WORLDS = ("mug", "cup", "jar"), ("soft", "noisy", "stuck")


def drawn(sharpness, rng):
    """p(outcome | pose, world, shape, hypothesis), where the nominal world is the first, (P, 1 + W, K, N, M)."""
    weights = rng.normal(size=(P, 1 + W, K, N, M)) + 0.8 * rng.normal(size=(P, 1 + W, K, 1, M))
    probs = np.exp(sharpness * weights)
    return probs / probs.sum(axis=-1, keepdims=True)


def model_of(probs, prior=None, forgetting=0.02, **discounts):
    """The exact model of these outcomes, whose embeddings are one-hot; p(o) is even."""
    logs = np.log(M * probs).astype(np.float32)
    references, logits = np.tile(np.eye(M), (P, 1, 1)), np.zeros((P, M, K))
    nominal = RigidBodyModel(LABELS, N, 1.0, references, logits, hypotheses=FixedHypotheses(logs[:, 0]), **discounts)
    worlds = logs[:, 1:]
    names = WORLDS[: worlds.shape[1]]
    return SensorHealthModel(
        nominal, FixedWorlds(worlds), names, spread_prior(len(names)) if prior is None else prior, forgetting
    )


def scene_of(model, number, **options):
    return SceneBelief(SearchProblem(LABELS, ("a", "b", "c"), number, "independent"), model, **options)


def felt(pose, outcome):
    return Touch(pose, features=np.eye(M)[outcome])


def session(probs, model, world, rng, objects=12, touches=3, log_bets=0.0):
    """Right answers, and the scene, after touches of objects in one world; ``world`` -1 knows nothing."""
    scene, right = scene_of(model, objects, log_bets=log_bets), []
    for index in range(objects):
        shape, hypothesis = rng.integers(K), rng.integers(N)
        for pose in rng.permutation(P)[:touches]:
            chances = np.full(M, 1 / M) if world < 0 else probs[pose, world, shape, hypothesis]
            scene.update(index, [felt(int(pose), rng.choice(M, p=chances))])
        right.append(scene.marginals()[index].argmax() == shape)
    return np.mean(right), scene


def test_belief_and_health_are_those_of_all_worlds_and_hypotheses_enumerated(rng):
    probs, prior, forgetting = drawn(1.0, rng), np.array([0.5, 0.2, 0.0, 0.2, 0.1]), 0.1
    scene, touches = scene_of(model_of(probs, prior, forgetting), 3), {1: [(0, 3), (2, 1)], 0: [(1, 5), (0, 0)]}
    for step in range(2):  # the objects in turn: object 1 comes first
        for index, some in touches.items():
            scene.update(index, [felt(*some[step])])
    first, second = (
        np.concatenate(
            [np.prod([M * probs[p, :, :, :, o] for p, o in some], axis=0), np.ones((1, K, N))]
        )  # (C, K, N): ratios
        for some in touches.values()
    )
    joint = np.zeros((K, K, W + 2))
    for w, v in product(range(W + 2), repeat=2):
        move = forgetting * prior[v] + (1 - forgetting) * (w == v)
        for k, j in product(range(K), repeat=2):
            joint[k, j, v] += prior[w] * move * first[w, k].mean() * second[v, j].mean()
    joint /= joint.sum()
    np.testing.assert_allclose(scene.marginals()[1], joint.sum(axis=(1, 2)), rtol=1e-5)
    np.testing.assert_allclose(scene.marginals()[0], joint.sum(axis=(0, 2)), rtol=1e-5)
    np.testing.assert_allclose(scene.marginals()[2], 1 / K)
    found = scene.sensor_health.probs
    np.testing.assert_allclose(found, joint.sum(axis=(0, 1)), rtol=1e-5, atol=1e-12)
    odds = found[-1] / found[:-1].sum() / (prior[-1] / prior[:-1].sum())
    assert scene.log_conflict == pytest.approx(np.log(odds))


def test_the_world_is_found_and_read_right_where_the_plain_model_errs_and_the_own_world_costs_nothing(rng):
    probs = drawn(4.0, rng)
    model = model_of(probs)
    for world in range(W + 1):
        found = [session(probs, model, world, np.random.default_rng([7, i])) for i in range(8)]
        plain = [session(probs, model.nominal, world, np.random.default_rng([7, i]))[0] for i in range(8)]
        right, scenes = np.mean([one for one, _ in found]), [scene for _, scene in found]
        assert min(scene.sensor_health.probs[world] for scene in scenes) > 0.95
        assert max(scene.log_conflict for scene in scenes) < 0.0
        assert right > 0.85
        assert abs(right - np.mean(plain)) < 0.02 if world == 0 else right > np.mean(plain) + 0.2
    assert str(scenes[0].sensor_health) == "stuck 1.00"


def test_touches_that_no_world_explains_are_an_alarm_and_leave_the_shape_open(rng):
    probs = drawn(4.0, rng)
    _, scene = session(probs, model_of(probs), -1, rng)
    assert str(scene.sensor_health).startswith("unknown")
    assert scene.log_conflict > np.log(50)
    assert scene.marginals().max() < 0.7


def test_log_bets_carry_a_session_from_search_to_search(rng):
    probs = drawn(1.5, rng)
    model = model_of(probs, forgetting=0.05)
    shown = [[felt(int(rng.integers(P)), int(rng.integers(M))) for _ in range(4)] for _ in range(9)]
    whole, log_bets = scene_of(model, 9), 0.0
    for index, touches in enumerate(shown):
        whole.update(index, touches)
    for first in (0, 2, 5):
        last = {0: 2, 2: 5, 5: 9}[first]
        part = scene_of(model, last - first, log_bets=log_bets)
        for index in range(first, last):
            part.update(index - first, shown[index])
        log_bets = part.log_bets.tolist()  # as a session writes it
    np.testing.assert_allclose(part.log_bets, whole.log_bets, atol=1e-9)
    np.testing.assert_allclose(part.marginals()[-1], whole.marginals()[-1], atol=1e-9)
    assert part.sensor_health.num_touches == 36
    assert scene_of(model, 1, log_bets=log_bets).log_conflict == pytest.approx(whole.log_conflict)
    with pytest.raises(ValueError, match="log_bets must be 6 finite numbers"):
        scene_of(model, 1, log_bets=[0.0, 1.0])


@pytest.mark.parametrize("discounts", [{}, {"correlation": 0.4, "drift": 0.05}])
def test_without_other_worlds_it_is_the_plain_model_to_the_last_bit(discounts, rng):
    probs = drawn(1.0, rng)
    model = model_of(probs[:, :1], np.array([1.0, 0.0]), **discounts)
    doubtful = model_of(probs[:, :1], np.array([1.0 - 1e-12, 1e-12]), **discounts)
    both, third = [scene_of(one, 2) for one in (model, model.nominal)], scene_of(doubtful, 2)
    for _ in range(12):
        index, touch = int(rng.integers(2)), felt(int(rng.integers(P)), int(rng.integers(M)))
        for scene in (*both, third):
            scene.update(index, [touch])
        assert both[0].log_marginals().tobytes() == both[1].log_marginals().tobytes()
        np.testing.assert_allclose(third.marginals(), both[0].marginals(), atol=1e-6)
    assert str(third.sensor_health) == "as described 1.00"


def test_a_world_that_is_the_nominal_one_has_its_evidence_also_where_touches_are_discounted(rng):
    probs = drawn(1.0, rng)
    probs[:, 1:] = probs[:, :1]
    evidence = model_of(probs, correlation=0.3, drift=0.1).start()
    for pose, outcome in ((0, 1), (0, 2), (1, 5), (0, 2)):
        evidence = evidence.update(felt(pose, outcome))
        np.testing.assert_allclose(evidence.log_ratios[:-1], evidence.log_ratios[[0]].repeat(1 + W, 0), atol=1e-5)
        absolute = evidence.log_ratios[:-1] - evidence.log_ratios[-1]
    shares = 3 / (1 + 2 * 0.3), 1.0
    sums = np.log(M * probs[0, 0, :, :, [1, 2, 2]]).mean(axis=0) * shares[0] + np.log(M * probs[1, 0, :, :, 5])
    sums /= 1 + (sum(shares) - 1) * 0.1
    np.testing.assert_allclose(absolute[0], np.log(np.exp(sums).mean(axis=1)), atol=1e-5)


def test_worlds_sleep_once_the_sensor_is_known_and_wake_when_it_changes(rng):
    probs = drawn(4.0, rng)
    model = model_of(probs)
    _, scene = session(probs, model, 0, rng, objects=4)
    assert all(len(scene.evidence(index).awake) == W for index in range(4))
    log_bets, asked, sure = scene.log_bets, [], []
    for _ in range(10):
        _, scene = session(probs, model, 0, rng, objects=5, log_bets=log_bets)
        log_bets = scene.log_bets
        asked += [len(scene.evidence(index).awake) for index in range(5)]
        sure.append(scene.sensor_health.probs[0])
    assert np.median(sure) > 0.99
    assert np.mean(asked) < 0.7 * W
    for _ in range(6):
        right, scene = session(probs, model, 2, rng, objects=5, log_bets=log_bets)
        log_bets = scene.log_bets
    assert scene.sensor_health.probs[2] > 0.9
    assert right >= 0.8


def test_the_largest_numbers_and_worlds_that_are_impossible_give_finite_beliefs(rng):
    probs = drawn(1.0, rng)
    for prior in (spread_prior(W), np.array([0.0, 0.0, 1.0, 0.0, 0.0])):
        for forgetting in (0.0, 0.02, 1.0):
            scene = scene_of(model_of(probs, prior, forgetting), 2)
            for step in range(50):
                scene.update(step % 2, [Touch(step % P, features=rng.choice([-1e30, 1e30, 1e6], size=M))])
            assert np.isfinite(scene.log_bets).all()
            assert np.isfinite(scene.log_conflict)
            np.testing.assert_allclose(scene.marginals().sum(axis=1), 1.0)
            assert scene.sensor_health.probs.sum() == pytest.approx(1.0)


def test_it_is_filed_as_the_nominal_model_and_pickled_with_its_worlds(rng):
    model = model_of(drawn(1.0, rng))
    touches = [felt(0, 1), felt(2, 3)]
    again = pickle.loads(pickle.dumps(model))
    assert again.log_likelihood(touches).tolist() == model.log_likelihood(touches).tolist()
    assert read_observation_model(model.to_json()).to_json() == model.nominal.to_json()
    assert joint_model(model) is model.nominal
    scene = scene_of(model, 1)
    scene.update(0, touches)
    np.testing.assert_allclose(np.ptp(scene.log_likelihoods()[0] - model.log_likelihood(touches)), 0.0, atol=1e-9)
    half = FixedWorlds(model.worlds.table.astype(np.float16))
    single = FixedWorlds(half.table.astype(np.float32))
    halved, exact = (
        SensorHealthModel(model.nominal, some, WORLDS, model.prior).log_likelihood(touches) for some in (half, single)
    )
    assert halved.tolist() == exact.tolist()
    view = pickle.loads(pickle.dumps(scene.view()))
    assert view.sensor_health.probs.tolist() == scene.sensor_health.probs.tolist()


def test_what_does_not_fit_is_refused(rng):
    probs = drawn(1.0, rng)
    model = model_of(probs)
    broken = np.log(probs[:, 1:])
    broken[1, 2, 0, 3, 1] = np.nan
    arguments = model.nominal, model.worlds, WORLDS
    for worlds, expected in (
        (broken, r"must be finite, got nan at \[2, 0, 3, 1\]"),
        (broken[:, 1:], r"must be \(W, K, N', D\) = \(3, 3, 'N', 6\), got \(2, 3, 4, 6\) in 1"),
        (broken[..., 1:], "got"),
    ):
        faulty = SensorHealthModel(model.nominal, SimpleNamespace(in_pose=worlds.__getitem__), WORLDS, model.prior)
        scene = scene_of(faulty, 1)
        with pytest.raises(ValueError, match=expected):
            scene.update(0, [felt(1, 0)])
        assert scene.sensor_health.num_touches == 0
    with pytest.raises(ValueError, match="must be finite, got nan"):
        FixedWorlds(broken)
    with pytest.raises(ValueError, match=r"must be \(P"):
        FixedWorlds(broken[0])
    with pytest.raises(ValueError, match="unknown must be"):
        spread_prior(2, 0.9, 0.2)
    for prior, expected in (
        (spread_prior(2), "prior must be 5 probabilities"),
        ([0.5, 0.5, 0.5, 0.0, 0.0], "prior must be 5"),
        ([0.0, 0.0, 0.0, 0.0, 1.0], "no touch tells anything"),
        ([np.nan, 0.0, 0.0, 0.0, 1.0], "prior"),
    ):
        with pytest.raises(ValueError, match=expected):
            SensorHealthModel(*arguments, prior)
    with pytest.raises(ValueError, match="worlds"):
        SensorHealthModel(*arguments[:2], ("soft", "soft", "unknown"), model.prior)
    with pytest.raises(ValueError, match="forgetting"):
        SensorHealthModel(*arguments, model.prior, 1.5)
    place = Elsewhere((1.0, 0.0), np.zeros((K, N, M)))
    with pytest.raises(ValueError, match=r"embedded in 3 poses only, not at \(1.0, 0.0\)"):
        model.start().update(Touch(0, features=np.eye(M)[0], elsewhere=place))


def test_touches_unlike_all_simulated_ones_leave_shape_and_state_open(rng):
    probs = drawn(2.0, rng)
    plain = model_of(probs, forgetting=0.0)
    usual = np.eye(M)[rng.integers(M, size=400)] + 0.1 * rng.normal(size=(400, M))
    model = replace(plain, simulated=SimulatedTouches.of(usual))
    strange = [Touch(pose, features=3.0 * np.eye(M)[2]) for pose in range(P)]
    scene, before = scene_of(model, 3), scene_of(plain, 3)
    for number, touches in enumerate((strange, strange[:1], strange)):
        for one in (scene, before):
            one.update(number, touches)
        log_e_value = np.log(model.simulated.e_value(strange[0].features))  # the mean of equal ones
        assert scene.log_conflict == pytest.approx((number + 1) * log_e_value)
    assert scene.log_conflict > np.log(50) > before.log_conflict
    assert scene.sensor_health.probs[-1] > 0.8
    assert scene.marginals().max() < 0.5 < 0.9 < before.marginals().max()
    known = scene_of(model, 1)
    known.update(0, [felt(0, 2), felt(1, 3)])
    assert known.log_conflict < 0.0
