"""Training PPO on a bank: from nothing, after an interruption, and what comes of it."""

import json
import tempfile
from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.object_test import ObjectTestEnv
from activetouch.envs.touch_bank import TouchBank
from activetouch.envs.touch_source import SampledTouches
from activetouch.errors import TrainingDiverged
from activetouch.perception.sealed_tensors import write_tensors
from belief.errors import CorruptFile, MissingPackage, UnknownName
from belief.observation_model import SignatureModel
from belief.synthetic import random_model
from experiments.command_line.arguments import BadArgument
from experiments.ppo import state as ppo_state
from experiments.ppo.recipe import PPO_RECIPES, ImpossiblePPO, PPORecipe
from experiments.ppo.reference import reference, thresholds
from experiments.ppo.state import write_state
from experiments.ppo.train_ppo import PPOChanges, TrainPPO
from experiments.ppo.training import LEARNER, POLICY, STATE, OtherTraining, Training, evaluate, play, policy_of
from planners.ppo import Policy, load_ppo_policy

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

    assert PPO.load(tmp_path / LEARNER).num_timesteps == 8192
    assert some.run() == curve  # nothing is left to do


def interrupted(some, monkeypatch, after):
    """Train until the state was written so many times, and no further."""
    written = []

    def write_and_stop(*arguments):
        write_state(*arguments)
        written.append(1)
        if len(written) == after:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(ppo_state, "write_state", write_and_stop)
        with pytest.raises(KeyboardInterrupt):
            some.run()


# One that sums evidence, one that keeps every touch, one with masks, and an optimiser's first and later steps.
KINDS = {
    "paper": TINY,
    "posterior": replace(TINY, state="posterior", beta=0.0, target_prob=(0.1, 0.9)),
    "masked": replace(TINY, state="posterior", masked=True, touch_limit=3),
    "steps that do not divide": replace(TINY, steps=500, rollout=7, num_envs=13, batch_size=91),
}


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("signature", [False, True])
def test_a_training_killed_and_started_again_ends_as_one_left_alone(
    name, signature, bank, sharp, tmp_path, monkeypatch
):
    model = SignatureModel(sharp, 0.4) if signature else sharp
    whole, parts = (training(bank, model, tmp_path / folder, KINDS[name]) for folder in ("whole", "parts"))
    curve = whole.run()
    for after in (1, 1, 2):  # before the first update; then after one and three; each in what is left
        np.random.seed(after)  # noqa: NPY002  another process has another past
        torch.manual_seed(after)
        interrupted(parts, monkeypatch, after)
        assert not (tmp_path / "parts" / POLICY).exists()
    assert parts.run() == curve
    for file in (POLICY, STATE):
        assert (tmp_path / "parts" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()


@pytest.fixture
def felt(body, rng):
    """A bank of the joint model's own touches, with their embeddings."""
    shapes, poses = np.arange(40) % 4, np.tile(np.arange(3), 2)
    touches = [body.sample_batch(int(k), poses[None], rng) for k in shapes]
    logits, features = (np.array([getattr(one, name)[0] for one in touches]) for name in ("logits", "features"))
    arrays = logits.reshape(40, 2, 3, 4).astype(np.float32), shapes
    return TouchBank(*arrays, body.shape_labels, POSES, features.reshape(40, 2, 3, 4))


@pytest.mark.parametrize("state", ["gains", "goal"])
def test_a_training_on_the_joint_belief_goes_on_where_it_was_stopped(state, felt, body, tmp_path, monkeypatch):
    recipe, target = (
        replace(TINY, state=state, beta=0.0, target_prob=(0.1, 0.9)),
        None if state == "goal" else "shape_0",
    )
    whole, parts = (Training(felt, felt, body, target, recipe, 0, tmp_path / folder) for folder in ("whole", "parts"))
    curve = whole.run()
    interrupted(parts, monkeypatch, 2)
    assert parts.run() == curve
    assert (tmp_path / "parts" / POLICY).read_bytes() == (tmp_path / "whole" / POLICY).read_bytes()
    card = Policy.from_bytes((tmp_path / "whole" / POLICY).read_bytes()).card
    assert (card.state, card.target) == (state, target or "")


def test_a_training_leaves_global_chance_and_the_temporary_folder_alone(bank, sharp, tmp_path, monkeypatch):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    before = np.random.get_state()[1].copy(), torch.get_rng_state()  # noqa: NPY002
    training(bank, sharp, tmp_path / "out").run()
    np.testing.assert_array_equal(np.random.get_state()[1], before[0])  # noqa: NPY002
    assert torch.equal(torch.get_rng_state(), before[1])
    assert list(temporary.iterdir()) == []


def test_a_training_that_diverges_says_so_with_advice(bank, sharp, tmp_path):
    with pytest.raises(TrainingDiverged, match=r"outputs are not finite.*--change\.learning-rate"):
        training(bank, sharp, tmp_path, replace(TINY, learning_rate=1e30)).run()


def test_a_folder_of_another_training_is_refused(bank, sharp, tmp_path):
    training(bank, sharp, tmp_path).run()
    with pytest.raises(OtherTraining, match=r"other settings \(recipe\)"):
        training(bank, sharp, tmp_path, PPORecipe(steps=1024, num_envs=16, rollout=8, batch_size=64)).run()
    with pytest.raises(OtherTraining, match=r"\(observation model\)"):
        training(bank, SignatureModel(sharp, 0.4), tmp_path).run()
    other = replace(bank, logits=bank.logits + np.float32(1.0))
    with pytest.raises(OtherTraining, match=r"\(bank, test bank\)"):
        training(other, sharp, tmp_path).run()


def test_a_folder_of_a_training_of_another_kind_is_refused(bank, sharp, tmp_path):
    write_tensors(tmp_path / STATE, {}, {"task": {}, "reports": []})
    with pytest.raises(OtherTraining, match=r"state\.safetensors is the state of no PPO training"):
        training(bank, sharp, tmp_path).run()


def test_every_damage_to_a_state_is_noticed(bank, sharp, tmp_path):
    some = training(bank, sharp, tmp_path)
    some.run()
    (tmp_path / POLICY).unlink()
    whole = (tmp_path / STATE).read_bytes()
    rng = np.random.default_rng(0)
    places = [3, 20, len(whole) - 1, *rng.integers(len(whole), size=40).tolist()]
    for place in places:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        (tmp_path / STATE).write_bytes(damaged)
        with pytest.raises(CorruptFile, match="start again"):
            some.run()
    for cut in (0, 7, len(whole) // 2):
        (tmp_path / STATE).write_bytes(whole[:cut])
        with pytest.raises(CorruptFile, match="start again"):
            some.run()


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
            policy = load_ppo_policy(tmp_path / "out" / "policies", state, target)
            seeds = [(tmp_path / "out" / f"{state}-{target}-{seed}" / POLICY).read_bytes() for seed in range(2)]
            assert policy.to_bytes() in seeds
            assert len(found[state][target]) == 2
    assert (tmp_path / "out" / "curves.svg").stat().st_size > 1000


@pytest.mark.parametrize(("is_joint", "names"), [(True, ["gains", "goal"]), (False, ["paper", "posterior"])])
def test_recipes_follow_from_the_sensor_unless_they_are_named(is_joint, names):
    assert list(TrainPPO()._recipes(is_joint)) == names
    assert list(TrainPPO(recipes=("goal",))._recipes(is_joint)) == ["goal"]


@pytest.mark.parametrize(
    ("changes", "error", "match"),
    [
        ({"targets": ("cone",)}, UnknownName, "target 'cone'"),
        ({"seeds": 0}, BadArgument, "--seeds"),
        ({"recipes": ("posterior", "posterior_masked")}, ImpossiblePPO, "one recipe a state"),
        ({"scene": "gell"}, UnknownName, "scene 'gell'"),
        ({"jobs": 0}, BadArgument, "--jobs"),
        ({"change": PPOChanges(steps=0)}, BadArgument, r"--change\.steps must .* got 0"),
        ({"change": PPOChanges(learning_rate=np.inf)}, BadArgument, r"--change\.learning-rate must .* got inf"),
        ({"change": PPOChanges(entropy=np.nan)}, BadArgument, r"--change\.entropy must .* got nan"),
        ({"change": PPOChanges(touch_cost=np.nan)}, BadArgument, r"--change\.touch-cost must .* got nan"),
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


COUNTS = ("steps", "num_envs", "rollout", "batch_size", "epochs", "touch_limit")
NUMBERS = ("learning_rate", "entropy", "discount", "gae", "beta", "touch_cost", "target_prob")


def test_every_setting_has_its_range():
    assert {*COUNTS, *NUMBERS, "hidden", "state", "masked"} == {field.name for field in fields(PPORecipe)}


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        *[(name, wrong) for name in COUNTS for wrong in (0, -1, 1.5, np.nan, "many", None)],
        *[(name, wrong) for name in NUMBERS for wrong in (-1.0, np.nan, np.inf, -np.inf, "much", None)],
        *[("hidden", wrong) for wrong in ((), (0,), (8, -1), (np.nan,), 3)],
        *[(name, wrong) for name in ("discount", "gae") for wrong in (0.0, 1.1)],
        *[("target_prob", wrong) for wrong in (0.0, 1.0, (0.9, 0.1), (0.1, 1.0), (0.1, 0.2, 0.3), (), (np.nan, 0.5))],
        ("state", "image"),
        ("learning_rate", 0.0),
        ("batch_size", 1),
        ("batch_size", 10_000),
    ],
)
def test_a_setting_out_of_range_is_refused_by_name(name, wrong):
    with pytest.raises(ImpossiblePPO, match=f"^{name} must be"):
        PPORecipe(**{name: wrong})


def test_changes_change_what_they_name():
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


@pytest.mark.slow
def test_maskable_ppo_trains_on_the_bank_and_never_probes_beyond_the_limit(bank, sharp, tmp_path):
    recipe = PPORecipe("posterior", True, 4096, num_envs=32, rollout=16, batch_size=128, touch_limit=2, hidden=(8, 8))
    some = training(bank, sharp, tmp_path, recipe)
    some.run()
    envs = some._learner().get_env()
    envs.reset()
    for _ in range(2):
        envs.step(np.zeros(32, np.int64))
    assert not np.stack(envs.env_method("action_masks"))[:, :3].any()
    policy = Policy.from_bytes((tmp_path / POLICY).read_bytes())
    score = evaluate(policy, BankEpisodes(bank, sharp, "shape_0", 500, "posterior", touch_limit=2))
    assert score.touches <= 2.0
    assert score.success > 0.6
