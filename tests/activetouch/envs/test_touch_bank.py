"""Recorded touches are served as they would be felt live, whatever serves them."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import log_softmax

from activetouch import TactileSensor
from activetouch.envs.bank_evidence import WeighedTouches
from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.object_search import BadOption
from activetouch.envs.object_test import ObjectTestEnv
from activetouch.envs.touch_bank import TouchBank
from activetouch.envs.touch_source import LiveTouches, SampledTouches
from activetouch.errors import LabelMismatch
from belief import Touch
from belief.calibration import TemperatureScaling
from belief.errors import CorruptFile, UnknownName
from belief.files import sealed_json, unsealed_json
from belief.observation_model import RatioModel
from belief.observation_model.registry import fits
from belief.policy_state import NoGains, certainty

POSES = ("p0", "p1", "p2")


@pytest.fixture
def bank(model, rng):
    shapes, poses = np.arange(60) % 4, np.tile(np.arange(3), 4)
    logits = [model.sample_batch(int(k), poses[None], rng).logits.reshape(4, 3, 4) for k in shapes]
    logits = np.array(logits, np.float32) + rng.normal(size=(60, 4, 3, 4)).astype(np.float32)
    return TouchBank(logits, shapes, model.shape_labels, POSES, logits[..., :2], {"made by": "a test"}, {"pad": 3})


@pytest.fixture
def ratio(model, bank):
    references = np.moveaxis(bank.logits, 2, 0).reshape(3, -1, 4)
    return RatioModel(model.shape_labels, TemperatureScaling(1.3, "ok"), np.full(4, 0.25), 0.4, references)


def recorded(env, num_objects, num_rounds):
    """The touches that ``env`` makes in the episodes (index, 7), all poses round by round."""
    logits, shapes, features = [], [], []
    for index in range(num_objects):
        env.reset(options={"seed": (index, 7)})
        shapes.append(env.arrangement[0])
        for pose in [*range(env.problem.num_poses)] * num_rounds:
            env.step(pose)
        logits.append([touch.logits for touch in env.history])
        features += [touch.features for touch in env.history if touch.features is not None]
    by_round = (num_objects, num_rounds, env.problem.num_poses, -1)
    labels = (tuple(env.problem.shape_labels), tuple(env.problem.pose_labels))
    read = np.array(features).reshape(by_round) if features else None
    return TouchBank(np.array(logits, np.float32).reshape(by_round), np.array(shapes), *labels, read)


def potential(env):
    """Φ of the shaping reward."""
    return float(abs(certainty(env.belief.log_probs, env.target)))


def test_shaping_sums_to_nothing_but_a_constant(model, bank):
    # With γ = 1 the potentials cancel: an episode that ends in a decision pays -β Φ(start) on top, whatever was done.
    rewards = []
    for beta in (0.0, 0.5):
        episodes = BankEpisodes(bank, model, "shape_0", 60, target_prob=0.2, beta=beta)
        episodes.begin(np.arange(60), np.arange(60))
        actions = [np.where(np.arange(60) % 7 > turn, np.arange(60) % 3, 3) for turn in range(7)]
        rewards.append(np.zeros(60))
        running = np.ones(60, bool)
        for some in actions:
            result = episodes.act(some)
            rewards[-1] += np.where(running, result.reward, 0.0)
            running &= ~result.terminated
    np.testing.assert_allclose(rewards[1] - rewards[0], -0.5 * np.tanh(np.log(4.0) / 4))


def assert_same_episodes(env, target, bank, model, state, **settings):
    """The same actions in the environment, live, and on its own recording: states, rewards and ends agree."""
    episodes = BankEpisodes(bank, model, target, 1, state, **settings)
    rng, num_poses = np.random.default_rng(5), episodes.num_poses
    ends, (beta, discount) = set(), (settings.get(name, 0.0) for name in ("beta", "discount"))
    for index in range(bank.num_objects):
        live, info = env.reset(options={"seed": (index, 7)})
        episodes.begin(np.array([0]), np.array([index]), target_probs=info["target_prob"])
        poses, over = rng.permutation(np.arange(num_poses).repeat(bank.num_rounds)).tolist(), False
        while not over:
            np.testing.assert_allclose(episodes.observe()[0], live, atol=2e-5)
            np.testing.assert_array_equal(episodes.action_masks()[0], env.unwrapped.action_masks())
            action = num_poses + int(rng.integers(2)) if rng.random() < 0.07 else poses.pop()
            before = potential(env)
            live, reward, terminated, truncated, info = env.step(action)
            reward += beta * (discount * (0.0 if terminated else potential(env)) - before)
            result = episodes.act(np.array([action]))
            assert result.reward[0] == pytest.approx(reward, abs=1e-5)
            assert (result.terminated[0], result.truncated[0]) == (terminated, truncated)
            assert result.success[0] == info["is_success"]
            over = terminated or truncated
        ends.add((action if terminated else "truncated", info["is_success"]))
    return ends


@pytest.mark.torch
@pytest.mark.mujoco
def test_the_bank_gives_the_touches_that_live_episodes_of_the_same_seeds_feel():
    touches = LiveTouches(TactileSensor.shipped("paper-independent"))
    recorder = ObjectTestEnv(touches=touches, target="cone", touch_limit=12)
    bank = recorded(recorder, num_objects=20, num_rounds=2)
    env = ObjectTestEnv(touches=touches, target="cone", touch_limit=9)
    assert_same_episodes(env, "cone", bank, touches.model, "paper", touch_limit=9)


@pytest.mark.parametrize(
    ("state", "kind", "target_prob"),
    [("paper", "ratio", 0.5), ("posterior", "confusion", (0.05, 0.95))],
)
def test_episodes_by_arrays_are_those_of_the_environment(state, kind, target_prob, model, ratio):
    used = ratio if kind == "ratio" else model
    task = {"touches": SampledTouches(used, POSES), "target": "shape_0", "target_prob": target_prob}
    bank = recorded(ObjectTestEnv(**task, touch_limit=30), num_objects=24, num_rounds=10)
    env = ObjectTestEnv(**task, state=state)
    ends = assert_same_episodes(env, "shape_0", bank, used, state, target_prob=target_prob, beta=0.3, discount=0.9)
    assert ends == {(3, True), (3, False), (4, True), (4, False), ("truncated", False)}


@pytest.mark.parametrize(("target", "state"), [("shape_1", "gains"), (None, "goal")])
def test_the_gains_of_a_bank_are_those_of_the_environment(target, state, body):
    # The bank weighs many objects at once in single precision; the environment asks the evidence of one.
    task = {"touches": SampledTouches(body, POSES), "target": target, "target_prob": (0.05, 0.95)}
    bank = recorded(ObjectTestEnv(**task, touch_limit=30), num_objects=15, num_rounds=10)
    env, rng = ObjectTestEnv(**task, state="gains"), np.random.default_rng(5)
    episodes = BankEpisodes(bank, body, target, 1, state, target_prob=(0.05, 0.95))
    seen = []
    for index in range(bank.num_objects):
        live, info = env.reset(options={"seed": (index, 7)})
        episodes.targets[:] = env.unwrapped.target
        episodes.begin(np.array([0]), np.array([index]), target_probs=info["target_prob"])
        for pose in rng.integers(3, size=8).tolist():
            assert live.shape == (4 + 2 * 3 + 2 + 4 * (target is None),)
            np.testing.assert_allclose(episodes.observe()[0], live, atol=2e-3)  # a hypothesis at a limit may be drawn
            seen.append(np.abs(episodes.observe()[0] - live).mean())  # or not; seldom
            live, *_ = env.step(pose)
            episodes.act(np.array([pose]))
    assert np.mean(seen) < 1e-5


def test_touches_that_were_forgotten_are_weighed_again(body, monkeypatch):
    bank = recorded(ObjectTestEnv(touches=SampledTouches(body, POSES), target="shape_1", touch_limit=30), 20, 2)
    all_known = WeighedTouches(bank, body)
    monkeypatch.setattr("activetouch.envs.bank_evidence.MOST_BYTES", 2 * all_known.untouched.nbytes)
    few_known = WeighedTouches(bank, body)
    touches = np.arange(6), np.zeros((6, 2), int), np.tile([0, 1], (6, 1))
    for _ in range(2):
        for found, wanted in zip(few_known.of(*touches), all_known.of(*touches), strict=True):
            np.testing.assert_array_equal(found, wanted)
        assert (len(few_known._known), len(all_known._known)) == (2, 6)


def test_a_drawn_target_is_every_shape_and_has_the_prior(body, rng):
    env = ObjectTestEnv(touches=SampledTouches(body, POSES), target="shape_0", touch_limit=30)
    bank = recorded(env, num_objects=60, num_rounds=2)
    episodes = BankEpisodes(bank, body, None, 4000, "goal", target_prob=0.5)
    episodes.restart(np.arange(4000), rng)
    assert np.bincount(episodes.targets).min() > 850
    is_target = np.asarray(bank.shapes)[episodes.objects] == episodes.targets
    assert abs(is_target.mean() - 0.5) < 0.04
    np.testing.assert_allclose(np.exp(episodes.log_probs)[np.arange(4000), episodes.targets], 0.5)
    np.testing.assert_array_equal(episodes.observe()[:, -4:].argmax(axis=1), episodes.targets)


@pytest.mark.parametrize("state", ["paper", "posterior"])
def test_a_drawn_target_follows_the_state_as_in_the_single_environment(state, bank, model, rng):
    episodes = BankEpisodes(bank, model, None, 200, state)
    episodes.restart(np.arange(200), rng)
    single = ObjectTestEnv(touches=SampledTouches(model, bank.pose_labels), target=None, state=state)
    assert episodes.single_observation_space == single.observation_space
    seen = episodes.observe()
    assert set(seen[:, -4:].argmax(axis=1)) == {0, 1, 2, 3}
    np.testing.assert_array_equal(seen[:, -4:], np.eye(4)[episodes.targets])
    for target, label in enumerate(bank.shape_labels):  # the rest is what the state shows with this target
        known = BankEpisodes(bank, model, label, 200, state)
        known.begin(np.arange(200), episodes.objects)
        rows = episodes.targets == target
        np.testing.assert_array_equal(seen[rows, :-4], known.observe()[rows])


def test_gains_without_a_joint_model_and_a_fixed_target_of_the_goal_state_are_refused(bank, model):
    with pytest.raises(NoGains, match="a bank with features"):
        BankEpisodes(bank, model, "shape_0", 2, "gains")
    with pytest.raises(BadOption, match="goes with target=None"):
        BankEpisodes(bank, model, "shape_0", 2, "goal")


# The models that need more of a touch than its logits have tests of their own.
FITS = fits()


def fitted(name, bank):
    touches = [Touch(i % 3, row) for i, row in enumerate(bank.logits.reshape(-1, 4).astype(np.float64))]
    return FITS[name](
        touches, bank.shapes.repeat(12), np.arange(60).repeat(12), shape_labels=bank.shape_labels, num_poses=3
    )


@pytest.mark.parametrize("name", FITS)
def test_the_arrays_evidence_is_the_models_likelihood(name, bank, rng):
    used = fitted(name, bank)
    episodes = BankEpisodes(bank, used, "shape_0", 8, touch_limit=20)
    episodes.restart(np.arange(8), rng)
    touches: list[list[Touch]] = [[] for _ in range(8)]
    for turn in range(30):
        if turn == 15:  # some begin anew, with the others in the middle of theirs
            episodes.restart(np.array([1, 3]), rng)
            touches[1], touches[3] = [], []
        actions = rng.choice([0, 0, 0, 1, 2], size=8)  # many repeats
        for row in np.flatnonzero(episodes.num_touches < 20):
            pose = int(actions[row])
            round_ = (episodes._first_rounds[row, pose] + episodes.uses[row, pose]) % 4
            touches[row].append(Touch(pose, bank.logits[episodes.objects[row], round_, pose].astype(np.float64)))
        episodes.act(actions)
        likelihoods = np.stack([used.log_likelihood(of_row) for of_row in touches])
        expected = log_softmax(np.log(0.5 * np.array([1, 1 / 3, 1 / 3, 1 / 3])) + likelihoods, axis=1)
        np.testing.assert_allclose(episodes.log_probs, expected, rtol=1e-12, atol=1e-9)
    assert len(touches[0]) == 20


def test_episodes_are_drawn_as_the_task_says(bank, model):
    # 4 000 draws; each count is within 5 standard deviations with probability above 1 - 1e-5.
    episodes = BankEpisodes(bank, model, "shape_1", 4000, target_prob=0.3)
    episodes.restart(np.arange(4000), np.random.default_rng(0))
    counts = np.bincount(bank.shapes[episodes.objects], minlength=4)
    assert stats.chisquare(counts, 4000 * np.array([0.7 / 3, 0.3, 0.7 / 3, 0.7 / 3])).pvalue > 1e-4
    for shape in range(4):
        members = episodes.objects[bank.shapes[episodes.objects] == shape]
        assert stats.chisquare(np.unique(members, return_counts=True)[1]).pvalue > 1e-4


def test_priors_of_a_range_are_uniform_and_true_whoever_draws_them(bank, model):
    # Prior and truth of 3 000 tests by arrays and 3 000 of the environment; every p-value is uniform if all is well.
    episodes, rows = BankEpisodes(bank, model, "shape_1", 3000, target_prob=(0.2, 0.9)), np.arange(3000)
    episodes.restart(rows, np.random.default_rng(0))
    env = ObjectTestEnv(touches=SampledTouches(model, POSES), target="shape_1", target_prob=(0.2, 0.9))
    alone = []
    for seed in rows.tolist():
        _, info = env.reset(seed=seed)
        alone.append((info["target_prob"], env.arrangement[0]))
    by_arrays = np.exp(episodes.log_probs[:, 1]), bank.shapes[episodes.objects]
    for prior, shapes in (by_arrays, np.array(alone).T):
        assert stats.kstest(prior, stats.uniform(0.2, 0.7).cdf).pvalue > 1e-4
        is_target = shapes == 1
        expected, chance = prior.sum(), np.sqrt((prior * (1.0 - prior)).sum())
        assert abs(is_target.sum() - expected) < 4 * chance
        assert is_target[prior > 0.7].mean() - is_target[prior < 0.4].mean() > 0.4  # of .5; four standard deviations
        assert stats.chisquare(np.unique(shapes[~is_target], return_counts=True)[1]).pvalue > 1e-4
    np.testing.assert_allclose(np.exp(episodes.log_probs).sum(axis=1), 1.0)
    others = np.delete(np.exp(episodes.log_probs), 1, axis=1)
    np.testing.assert_allclose(others, others[:, :1].repeat(3, axis=1))


def test_an_episode_begun_anew_leaves_the_priors_of_others_alone(bank, model):
    episodes = BankEpisodes(bank, model, "shape_0", 6, "posterior", target_prob=(0.1, 0.9))
    rng = np.random.default_rng(0)
    episodes.restart(np.arange(6), rng)
    episodes.act(np.full(6, 1))
    before = episodes.log_probs.copy()
    episodes.restart(np.array([2, 4]), rng)
    changed = (episodes.log_probs != before).any(axis=1)
    assert changed.tolist() == [False, False, True, False, True, False]
    first = episodes.log_probs[[2, 4]]
    episodes.act(np.array([0, 0, 3, 0, 3, 0]))  # those decide, the others feel something
    np.testing.assert_allclose(episodes.log_probs[[2, 4]], first, atol=1e-12)


def test_rounds_of_a_pose_come_once_each_before_any_comes_again(bank, model):
    episodes = BankEpisodes(bank, model, "shape_0", 40)
    episodes.restart(np.arange(40), np.random.default_rng(0))
    felt = []
    for _ in range(5):
        episodes.act(np.full(40, 2))
        felt.append(episodes.situation().frame_probs.copy())
    np.testing.assert_array_equal(felt[4], felt[0])
    for row in range(40):
        seen = {tuple(frames[row].round(12)) for frames in felt[:4]}
        logits = bank.logits[episodes.objects[row], :, 2].astype(np.float64)
        probs = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
        assert seen == {tuple(row.round(12)) for row in probs}


@pytest.mark.torch
def test_the_sb3_vector_env_plays_the_same_and_reports_ends(bank, model):
    from activetouch.envs.sb3 import BankVecEnv

    episodes = BankEpisodes(bank, model, "shape_0", 16, touch_limit=2)
    envs = BankVecEnv(episodes, seed=(0,))
    observations = envs.reset()
    drawn = episodes.objects.copy()
    BankVecEnv(episodes, seed=0).reset()
    np.testing.assert_array_equal(episodes.objects, drawn)
    assert observations.shape == (16, 10)
    assert np.stack(envs.env_method("action_masks")).all()
    for _ in range(2):
        envs.step(np.full(16, 2))
    assert not np.stack(envs.env_method("action_masks"))[:, :3].any()
    _, rewards, dones, infos = envs.step(np.full(16, 2))
    assert dones.all()
    assert rewards.tolist() == pytest.approx([-0.02] * 16)
    for info in infos:
        assert info["episode"]["r"] == pytest.approx(-0.06)
        assert (info["episode"]["l"], info["is_success"], info["terminal_observation"][-1]) == (3, False, 1.0)
    with pytest.raises(AttributeError, match="no method"):
        envs.env_method("render")
    envs.seed(3)
    first = envs.reset()
    envs.seed(3)
    np.testing.assert_array_equal(envs.reset(), first)
    envs.set_options({"seed": (0, 3, 17)})
    with pytest.raises(BadOption, match=r"no options, got .*17"):
        envs.reset()
    envs.set_options({})
    assert envs.reset().shape == (16, 10)


def test_a_bank_survives_its_folder(bank, tmp_path):
    bank.save(tmp_path / "bank")
    copy = TouchBank.open(str(tmp_path / "bank"))
    np.testing.assert_array_equal(copy.logits, bank.logits)
    np.testing.assert_array_equal(copy.shapes, bank.shapes)
    np.testing.assert_allclose(copy.features, bank.features, atol=1e-2)
    assert (copy.shape_labels, copy.pose_labels, copy.source) == (bank.shape_labels, POSES, {"made by": "a test"})
    assert copy.scene == {"pad": 3}
    assert isinstance(copy.logits, np.memmap)
    assert not copy.logits.flags.writeable


def test_a_damaged_bank_is_refused(bank, tmp_path):
    with pytest.raises(CorruptFile, match="no touch bank"):
        TouchBank.open(tmp_path)
    bank.save(tmp_path)
    logits = (tmp_path / "logits.npy").read_bytes()
    (tmp_path / "logits.npy").write_bytes(logits[:-1] + bytes([logits[-1] ^ 1]))
    with pytest.raises(CorruptFile, match="was changed"):
        TouchBank.open(tmp_path)
    bank.save(tmp_path)
    (tmp_path / "shapes.npy").unlink()
    with pytest.raises(CorruptFile, match="no touch bank"):
        TouchBank.open(tmp_path)
    bank.save(tmp_path)
    text = (tmp_path / "manifest.json").read_text()
    manifest = unsealed_json(text)
    for wrong in ({"format": "other"}, {"pose_labels": ["p0"]}, {"scene": "gel"}, {"arrays": None}):
        (tmp_path / "manifest.json").write_text(sealed_json({**manifest, **wrong}))
        with pytest.raises(CorruptFile):
            TouchBank.open(tmp_path)
    for damaged in ("[]", '{"format": 3}', text.replace("a test", "no test")):
        (tmp_path / "manifest.json").write_text(damaged)
        with pytest.raises(CorruptFile, match="no touch bank"):
            TouchBank.open(tmp_path)


def test_what_does_not_fit_is_refused(bank, model, ratio):
    labels = bank.shape_labels
    with pytest.raises(ValueError, match="every shape"):
        TouchBank(bank.logits, np.zeros(60, np.int64), labels, POSES)
    with pytest.raises(ValueError, match=r"must be \(N, R, 3, 4\)"):
        TouchBank(bank.logits[:, :, :2], bank.shapes, labels, POSES)
    with pytest.raises(ValueError, match="finite"):
        TouchBank(np.full_like(bank.logits, np.nan), bank.shapes, labels, POSES)
    with pytest.raises(ValueError, match="features"):
        TouchBank(bank.logits, bank.shapes, labels, POSES, bank.logits[:5])
    with pytest.raises(ValueError, match="shapes must be"):
        TouchBank(bank.logits, bank.shapes[:5], labels, POSES)
    with pytest.raises(UnknownName, match="target"):
        BankEpisodes(bank, model, "cone", 2)
    with pytest.raises(UnknownName, match="state"):
        BankEpisodes(bank, model, "shape_0", 2, state="images")
    other = RatioModel(("a", "b", "c", "d"), ratio.calibration, ratio.training_prior, 0.4, ratio.references)
    for wrong in ((0.9, 0.1), (0.0, 0.5), (0.1, np.nan), (0.1, 0.2, 0.3), ()):
        with pytest.raises(ValueError, match="target_prob"):
            BankEpisodes(bank, model, "shape_0", 2, target_prob=wrong)
    episodes = BankEpisodes(bank, model, "shape_0", 2)
    for wrong in (0.0, 1.0, np.nan, [0.5, -0.1]):
        with pytest.raises(ValueError, match="must be in"):
            episodes.begin(np.arange(2), np.arange(2), target_probs=wrong)
    with pytest.raises(LabelMismatch, match="'a'"):
        BankEpisodes(bank, other, "shape_0", 2)
