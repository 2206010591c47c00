"""Training PPO on a bank, what is kept of it, and what comes of it."""

import json
import tempfile
from dataclasses import replace

import numpy as np
import pytest
import torch

from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.object_test import ObjectTestEnv
from activetouch.envs.touch_bank import TouchBank
from activetouch.envs.touch_source import SampledTouches
from activetouch.errors import TrainingDiverged
from belief.calibration import TemperatureScaling
from belief.errors import CorruptFile, UnknownName
from belief.synthetic import random_model
from experiments.command_line.arguments import BadArgument
from experiments.ppo.recipe import PPORecipe
from experiments.ppo.train_ppo import train_policies
from experiments.ppo.training import ALL, Training, evaluate, policy_of
from planners.ppo import load_ppo_policy, policy_file

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
    learner = some._learner()
    policy = policy_of(learner, some.card)
    states = np.random.default_rng(0).uniform(size=(50, 10)).astype(np.float32)
    with torch.no_grad():
        expected = learner.policy.get_distribution(torch.tensor(states)).distribution.logits.numpy()
    scores = policy.scores(states)
    np.testing.assert_allclose(scores - np.logaddexp.reduce(scores, axis=1, keepdims=True), expected, atol=1e-5)
    np.testing.assert_array_equal(scores.argmax(axis=1), learner.predict(states, deterministic=True)[0])


def test_training_learns_and_leaves_a_policy_and_is_not_repeated(bank, sharp, tmp_path, monkeypatch):
    sizes = {"num_envs": 64, "rollout": 16, "batch_size": 256, "hidden": (16, 16)}
    recipe = PPORecipe(state="posterior", steps=8192, beta=0.0, **sizes)
    some = training(bank, sharp, tmp_path, recipe)
    untrained = evaluate(policy_of(some._learner(), some.card), some._episodes(bank, 500, 0.5))
    policy, score = some.run()
    written = some.path.read_bytes()
    assert score.mean_return > untrained.mean_return + 0.3  # from about -0.1 to about 0.7
    assert policy.card == some.card
    assert evaluate(policy, BankEpisodes(bank, sharp, "shape_0", 2000, "posterior")) == score
    monkeypatch.setattr(Training, "_train", None)
    again, same = some.run()  # nothing is left to do
    assert (some.path.read_bytes(), again.card, same) == (written, policy.card, score)


def test_a_training_that_is_started_again_ends_with_the_same_policy(bank, sharp, tmp_path):
    first, second = (training(bank, sharp, tmp_path / name) for name in ("first", "second"))
    _, score = first.run()
    np.random.seed(1)  # noqa: NPY002  another process has another past
    torch.manual_seed(1)
    assert second.run()[1] == score
    assert second.path.read_bytes() == first.path.read_bytes()


@pytest.fixture
def felt(body, rng):
    """A bank of the joint model's own touches, with their embeddings."""
    shapes, poses = np.arange(40) % 4, np.tile(np.arange(3), 2)
    touches = [body.sample_batch(int(k), poses[None], rng) for k in shapes]
    logits, features = (np.array([getattr(one, name)[0] for one in touches]) for name in ("logits", "features"))
    arrays = logits.reshape(40, 2, 3, 4).astype(np.float32), shapes
    return TouchBank(*arrays, body.shape_labels, POSES, features.reshape(40, 2, 3, 4))


@pytest.mark.parametrize("state", ["gains", "goal"])
def test_a_training_on_the_joint_belief_has_its_state_and_target(state, felt, body, tmp_path):
    recipe = replace(TINY, state=state, beta=0.0, target_prob=(0.1, 0.9))
    found = train_policies(felt, felt, body, tmp_path, [recipe], targets=["shape_0"], seeds=1)
    [(key, policy)] = found.policies.items()
    assert key == (state, ALL if state == "goal" else "shape_0")
    assert (policy.card.state, policy.card.target) == (state, "" if state == "goal" else "shape_0")


def test_a_training_leaves_global_chance_and_the_temporary_folder_alone(bank, sharp, tmp_path, monkeypatch):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    before = np.random.get_state()[1].copy(), torch.get_rng_state()  # noqa: NPY002
    training(bank, sharp, tmp_path / "out").run()
    np.testing.assert_array_equal(np.random.get_state()[1], before[0])  # noqa: NPY002
    assert torch.equal(torch.get_rng_state(), before[1])
    assert list(temporary.iterdir()) == []


def test_tensorboard_gets_a_log_of_each_training_where_it_is_asked_for(bank, sharp, tmp_path):
    pytest.importorskip("tensorboard")
    short = replace(TINY, steps=128)
    train_policies(bank, bank, sharp, tmp_path, [short], ["shape_0", "shape_1"], 1, tensorboard=tmp_path / "logs")
    found = sorted(path.parent.name for path in (tmp_path / "logs").glob("*/events.out.tfevents.*"))
    assert [name[:15] for name in found] == ["paper-shape_0-0", "paper-shape_1-0"]
    assert not list((tmp_path / "trainings").glob("*events*"))


def test_a_training_that_diverges_says_so_with_advice(bank, sharp, tmp_path):
    with pytest.raises(TrainingDiverged, match="outputs are not finite"):
        training(bank, sharp, tmp_path, replace(TINY, learning_rate=1e30)).run()


def test_a_training_of_other_settings_has_a_file_of_its_own(bank, sharp, tmp_path):
    others = (
        training(bank, sharp, tmp_path, replace(TINY, steps=1024)),
        training(bank, replace(sharp, calibration=TemperatureScaling(2.0, "ok")), tmp_path),
        training(replace(bank, logits=bank.logits + np.float32(1.0)), sharp, tmp_path),
    )
    assert len({some.path for some in (training(bank, sharp, tmp_path), *others)}) == 4


def test_a_damaged_policy_is_noticed(bank, sharp, tmp_path):
    some = training(bank, sharp, tmp_path)
    some.run()
    whole = some.path.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:-20] + bytes([whole[-20] ^ 4]) + whole[-19:]):
        some.path.write_bytes(damaged)
        with pytest.raises(CorruptFile, match="start again"):
            some.run()


def test_every_target_is_trained_and_the_best_seed_kept(bank, sharp, tmp_path):
    recipes = [TINY, replace(TINY, state="posterior", beta=0.0)]
    found = train_policies(bank, bank, sharp, tmp_path, recipes, targets=("shape_3",), seeds=2)
    found.save(tmp_path)
    scores = json.loads((tmp_path / "scores.json").read_text())
    for state in ("paper", "posterior"):
        load_ppo_policy(tmp_path / "policies", state, "shape_3")
        [chosen] = (tmp_path / "trainings").glob(f"{state}-shape_3-{found.chosen[state, 'shape_3']}-*")
        assert chosen.read_bytes() == (tmp_path / "policies" / policy_file(state, "shape_3")).read_bytes()
        assert len(scores[state]["shape_3"]) == 2
        assert f"{state}, shape_3: return " in str(found)


@pytest.mark.parametrize(
    ("changes", "error", "match"),
    [
        ({"targets": ("cone",)}, UnknownName, "target 'cone'"),
        ({"recipes": [TINY, replace(TINY, steps=1024)]}, BadArgument, "one recipe a state"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_is_trained(changes, error, match, bank, sharp, tmp_path):
    with pytest.raises(error, match=match):
        train_policies(bank, bank, sharp, tmp_path, **{"recipes": [TINY], **changes})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        *[("steps", wrong) for wrong in (0, -1, 1.5, "many", None)],
        *[("learning_rate", wrong) for wrong in (0.0, -1.0, np.nan, np.inf, "much", None)],
        *[("hidden", wrong) for wrong in ((), (0,), (8, -1), 3)],
        *[("discount", wrong) for wrong in (0.0, 1.1)],
        *[("target_prob", wrong) for wrong in (0.0, 1.0, (0.9, 0.1), (0.1, 1.0), (np.nan, 0.5))],
        ("state", "image"),
        ("batch_size", 1),
        ("batch_size", 10_000),
    ],
)
def test_a_setting_out_of_range_is_refused_by_name(name, wrong):
    with pytest.raises(BadArgument, match=f"^{name} must"):
        PPORecipe(**{name: wrong})


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param("DQN", marks=pytest.mark.nightly), "MaskablePPO"])
def test_common_learners_train_on_the_environment(name, sharp):
    import sb3_contrib
    import stable_baselines3
    from stable_baselines3.common.logger import Logger

    kind = getattr(stable_baselines3, name, None) or getattr(sb3_contrib, name)
    policy = "MlpLstmPolicy" if name == "RecurrentPPO" else "MlpPolicy"
    for state in ("paper", "posterior"):
        env = ObjectTestEnv(touches=SampledTouches(sharp, POSES), target="shape_0", state=state)
        settings = {"learning_starts": 100} if name == "DQN" else {"n_steps": 128, "n_epochs": 2}
        learner = kind(policy, env, seed=0, device="cpu", **settings)
        learner.set_logger(Logger(folder=None, output_formats=[]))  # its own makes a folder among temporary files
        learner.learn(256)
        assert learner.num_timesteps >= 256
        action, _ = learner.predict(env.reset(seed=0)[0], deterministic=True)
        assert env.action_space.contains(int(action))
