"""Training PPO on a bank: from nothing, after an interruption, and what comes of it."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from activetouch.envs.bank import TouchBank
from activetouch.envs.episodes import BankEpisodes
from activetouch.envs.object_test import ObjectTestEnv
from activetouch.envs.touches import SampledTouches
from activetouch.envs.wrappers import PosteriorState
from activetouch.errors import MissingPackage
from belief.errors import CorruptFile, UnknownName
from belief.synthetic import random_model
from experiments.ppo_recipe import PPO_RECIPES, ImpossiblePPO, PPORecipe
from experiments.ppo_reference import reference, thresholds
from experiments.ppo_training import CHECKPOINT, POLICY, PROGRESS, OtherTraining, Training, evaluate, play, policy_of
from experiments.train_ppo import PPOChanges, TrainPPO
from planners.ppo import Policy, load_policy

pytestmark = pytest.mark.torch
POSES = ("p0", "p1", "p2")
TINY = PPORecipe(steps=512, num_envs=16, rollout=8, batch_size=64, epochs=2, hidden=(8, 8))


@pytest.fixture(scope="module")
def sharp():
    return random_model(np.random.default_rng(0), sharpness=4.0)


@pytest.fixture(scope="module")
def bank(sharp):
    shapes, poses = np.arange(200) % 4, np.tile(np.arange(3), 4)
    rng = np.random.default_rng(1)
    logits = [sharp.sample_batch(int(k), poses[None], rng).logits.reshape(4, 3, 4) for k in shapes]
    return TouchBank(np.array(logits, np.float32), shapes, sharp.shape_labels, POSES)


def training(bank, model, folder, recipe=TINY):
    return Training(bank, bank, model, "shape_0", recipe, 0, folder)


def test_a_policy_for_numpy_does_what_sb3s_does(bank, sharp, tmp_path):
    some = training(bank, sharp, tmp_path)
    learner = some._learner(0)
    policy = policy_of(learner, some.card)
    states = np.random.default_rng(0).uniform(size=(50, 10)).astype(np.float32)
    with torch.no_grad():
        expected = learner.policy.get_distribution(torch.tensor(states)).distribution.logits.numpy()
    scores = policy.scores(states)
    np.testing.assert_allclose(scores - np.logaddexp.reduce(scores, axis=1, keepdims=True), expected, atol=1e-5)
    np.testing.assert_array_equal(scores.argmax(axis=1), learner.predict(states, deterministic=True)[0])


def test_training_learns_and_leaves_a_policy_a_curve_and_a_checkpoint(bank, sharp, tmp_path):
    sizes = {"num_envs": 64, "rollout": 16, "batch_size": 256, "hidden": (16, 16)}
    recipe = PPORecipe(state="posterior", steps=8192, beta=0.0, **sizes)
    some = training(bank, sharp, tmp_path, recipe)
    curve = some.run()
    assert curve[0].steps == 0
    assert curve[-1].steps == 8192
    assert curve[-1].mean_return > curve[0].mean_return + 0.3  # from about -0.1 to about 0.7
    policy = Policy.from_bytes((tmp_path / POLICY).read_bytes())
    assert policy.card == some.card
    again = evaluate(policy, BankEpisodes(bank, sharp, "shape_0", 2000, "posterior"))
    assert again.mean_return == curve[-1].mean_return
    from stable_baselines3 import PPO

    assert PPO.load(tmp_path / CHECKPOINT).num_timesteps == 8192
    assert some.run() == curve  # nothing is left to do


def test_an_interrupted_training_goes_on_from_its_last_checkpoint(bank, sharp, tmp_path, monkeypatch):
    some = training(bank, sharp, tmp_path)
    steps = []
    original = Training._write_progress

    def interrupt(self, done, curve):
        original(self, done, curve)
        steps.append(done)
        if done == 256:
            raise KeyboardInterrupt

    monkeypatch.setattr(Training, "_write_progress", interrupt)
    with pytest.raises(KeyboardInterrupt):
        some.run()
    assert not (tmp_path / POLICY).exists()
    monkeypatch.undo()
    curve = some.run()
    assert [point.steps for point in curve] == [0, 128, 256, 384, 512]
    assert (tmp_path / POLICY).exists()


def test_a_folder_of_another_training_is_refused(bank, sharp, tmp_path):
    training(bank, sharp, tmp_path).run()
    with pytest.raises(OtherTraining, match="other settings"):
        training(bank, sharp, tmp_path, PPORecipe(steps=1024, num_envs=16, rollout=8, batch_size=64)).run()
    (tmp_path / PROGRESS).write_text("{")
    with pytest.raises(CorruptFile, match="start again"):
        training(bank, sharp, tmp_path).run()


def test_the_command_trains_every_target_and_keeps_the_best_seed(bank, sharp, tmp_path):
    for split in ("calibration", "test"):
        bank.save(tmp_path / "bank" / split)
    (tmp_path / "sensor").mkdir()
    (tmp_path / "sensor" / "observation_model.json").write_text(sharp.to_json())
    command = TrainPPO(
        bank=tmp_path / "bank",
        sensor=tmp_path / "sensor",
        out=tmp_path / "out",
        targets=("shape_1", "shape_3"),
        change=PPOChanges(steps=4096),
        seeds=2,
        jobs=1,
    )
    command.run()
    found = json.loads((tmp_path / "out" / "curves.json").read_text())
    for state in ("paper", "posterior"):
        for target in ("shape_1", "shape_3"):
            policy = load_policy(tmp_path / "out" / "policies", state, target)
            seeds = [(tmp_path / "out" / f"{state}-{target}-{seed}" / POLICY).read_bytes() for seed in range(2)]
            assert policy.to_bytes() in seeds
            assert len(found[state][target]) == 2
    assert (tmp_path / "out" / "curves.svg").stat().st_size > 1000


@pytest.mark.parametrize(
    ("changes", "error", "match"),
    [
        ({"targets": ("cone",)}, UnknownName, "target 'cone'"),
        ({"seeds": 0}, ImpossiblePPO, "--seeds"),
        ({"recipes": ("posterior", "posterior_masked")}, ImpossiblePPO, "one recipe a state"),
        ({"scene": "gell"}, UnknownName, "scene 'gell'"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_is_trained(changes, error, match, bank, sharp, tmp_path):
    for split in ("calibration", "test"):
        bank.save(tmp_path / "bank" / split)
    (tmp_path / "sensor").mkdir()
    (tmp_path / "sensor" / "observation_model.json").write_text(sharp.to_json())
    folders = {"bank": tmp_path / "bank", "sensor": tmp_path / "sensor", "out": tmp_path / "out"}
    with pytest.raises(error, match=match):
        TrainPPO(**(folders | changes)).run()
    assert not (tmp_path / "out").exists()


def test_settings_out_of_range_are_refused():
    for wrong in ({"steps": 0}, {"batch_size": 10_000}, {"hidden": ()}, {"discount": 1.1}, {"beta": -1.0}):
        with pytest.raises(ImpossiblePPO):
            PPORecipe(**wrong)
    for prob in (0.0, 1.0, np.nan, (0.9, 0.1), (0.1, 1.0)):
        with pytest.raises(ImpossiblePPO, match="target_prob"):
            PPORecipe(target_prob=prob)
    assert PPOChanges(steps=7, beta=0.5).of(PPO_RECIPES["paper"]).steps == 7


def test_a_policy_of_many_priors_is_measured_at_the_middle_one(bank, sharp, tmp_path):
    assert PPORecipe(target_prob=0.3).test_prob == 0.3
    recipe = replace(TINY, state="posterior", target_prob=(0.2, 0.6))
    some = training(bank, sharp, tmp_path, recipe)
    last = some.run()[-1]
    policy = Policy.from_bytes((tmp_path / POLICY).read_bytes())
    assert evaluate(policy, BankEpisodes(bank, sharp, "shape_0", 2000, "posterior", target_prob=0.4), 512) == last
    chosen_by = BankEpisodes(bank, sharp, "shape_0", 4000, "posterior", target_prob=(0.2, 0.6))
    assert evaluate(policy, chosen_by, 512) == some.score()
    with pytest.raises(OtherTraining):  # of one prior, in the same folder
        training(bank, sharp, tmp_path, replace(recipe, target_prob=0.4)).run()


def test_references_lie_between_one_touch_and_all_of_them_for_nothing(bank, sharp):
    recipe = PPORecipe(state="posterior", target_prob=(0.2, 0.8), touch_limit=6)
    found = reference(bank, bank, sharp, "shape_2", recipe)
    tests = BankEpisodes(bank, sharp, "shape_2", 2000, "posterior", touch_limit=1)
    once = play(thresholds(np.inf, -np.inf), tests)
    assert once.touches == 1.0
    assert once.mean_return < found.score.mean_return < found.free <= 1.0
    assert 1.0 < found.score.touches < 6.0
    assert found.score.mean_return - 0.05 < found.optimum < 1.0  # 0.05: of 2 000 tests


def test_masks_need_a_package_and_say_which(bank, sharp, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "sb3_contrib", None)
    with pytest.raises(MissingPackage, match=r"activetouch\[contrib\]"):
        training(bank, sharp, tmp_path, PPO_RECIPES["posterior_masked"]).run()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["PPO", "DQN", "MaskablePPO", "RecurrentPPO"])
def test_common_learners_train_on_the_environment(name, sharp):
    import sb3_contrib
    import stable_baselines3

    kind = getattr(stable_baselines3, name, None) or getattr(sb3_contrib, name)
    policy = "MlpLstmPolicy" if name == "RecurrentPPO" else "MlpPolicy"
    for wrapper in (lambda env: env, PosteriorState):
        env = wrapper(ObjectTestEnv(touches=SampledTouches(sharp, POSES), target="shape_0"))
        settings = {"learning_starts": 100} if name == "DQN" else {"n_steps": 256, "n_epochs": 2}
        learner = kind(policy, env, seed=0, device="cpu", **settings)
        learner.learn(2048)
        assert learner.num_timesteps >= 2048
        action, _ = learner.predict(env.reset(seed=0)[0], deterministic=True)
        assert env.action_space.contains(int(action))


@pytest.mark.slow
def test_maskable_ppo_trains_on_the_bank_and_never_probes_beyond_the_limit(bank, sharp, tmp_path):
    recipe = PPORecipe("posterior", True, 4096, num_envs=32, rollout=16, batch_size=128, touch_limit=2, hidden=(8, 8))
    some = training(bank, sharp, tmp_path, recipe)
    some.run()
    envs = some._learner(4096).get_env()
    envs.reset()
    for _ in range(2):
        envs.step(np.zeros(32, np.int64))
    assert not np.stack(envs.env_method("action_masks"))[:, :3].any()
    policy = Policy.from_bytes((tmp_path / POLICY).read_bytes())
    score = evaluate(policy, BankEpisodes(bank, sharp, "shape_0", 500, "posterior", touch_limit=2))
    assert score.touches <= 2.0
    assert score.success > 0.6
