"""A policy that Stable-Baselines3 saved plays as a decider, whatever it observes."""

import zipfile

import numpy as np
import pytest

from planners import check_decider, make_decider
from planners.ppo import BadPolicy, MissingPolicy

pytestmark = pytest.mark.torch
K, P = 4, 3


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Files of untrained policies by what they observe."""
    import gymnasium
    from stable_baselines3 import DQN, PPO

    folder, sizes = tmp_path_factory.mktemp("sb3"), {"paper": K + P + 3, "posterior": K + P + 2}

    class Still(gymnasium.Env):
        def __init__(self, size, low, actions=P + 2):
            self.observation_space = gymnasium.spaces.Box(low, 1.0, (size,), np.float32)
            self.action_space = gymnasium.spaces.Discrete(actions)

        def reset(self, *, seed=None, options=None):
            return np.zeros(self.observation_space.shape, np.float32), {}

    for name, size in [*sizes.items(), *((f"{name}-goal", size + K) for name, size in sizes.items()), ("other", 5)]:
        for algorithm in (PPO, DQN) if name == "paper" else (PPO,):
            model = algorithm("MlpPolicy", Still(size, 0.0 if "paper" in name else -1.0), seed=0, device="cpu")
            model.save(folder / f"{name}-{algorithm.__name__.lower()}.zip")
    # The posterior and the fraction of objects left.
    PPO("MlpPolicy", Still(K + P + 3, -1.0), seed=0, device="cpu").save(folder / "posterior-of-a-search.zip")
    (folder / "nonsense.zip").write_text("nonsense")
    with zipfile.ZipFile(folder / "paper-ppo.zip") as whole:
        data = whole.read("data")
    for name, content in {"damaged": data, "list": b"[]"}.items():
        with zipfile.ZipFile(folder / f"{name}.zip", "w") as file:
            file.writestr("data", content)
    return folder


@pytest.mark.parametrize("name", ["paper-ppo", "paper-dqn", "posterior-ppo", "paper-goal-ppo", "posterior-goal-ppo"])
def test_a_saved_policy_keeps_the_contract_of_deciders(name, saved, model):
    decider = make_decider(f"sb3:{saved / name}.zip", model.outcome_table())
    assert check_decider(decider, np.random.default_rng(0), model, num_searches=2)


def test_a_file_for_each_target_is_found_by_its_name(saved, model):
    decider = make_decider(f"sb3:{saved}/{{target}}-ppo.zip", model.outcome_table())
    assert [path.name for path in decider.files("paper")] == ["paper-ppo.zip"]
    with pytest.raises(MissingPolicy, match=r"there is no file .*cone-ppo\.zip"):
        decider.files("cone")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("other-ppo", r"\(5,\).*10 numbers \(paper\), 14 with the target"),
        ("posterior-of-a-search", r"\(10,\) from -1 on .*10 numbers \(paper\), .* from 0 on.*train it there"),
        ("nonsense", "no file that Stable-Baselines3"),
        ("list", "no file that Stable-Baselines3"),
        ("damaged", "cannot be loaded as PPO: .*undamaged PPO, A2C, DQN or MaskablePPO"),
    ],
)
def test_a_file_that_cannot_play_says_why(name, said, saved, model):
    decider = make_decider(f"sb3:{saved / name}.zip", model.outcome_table())
    with pytest.raises(BadPolicy, match=said):
        check_decider(decider, np.random.default_rng(0), model, num_searches=2)


def test_a_policy_that_learned_on_a_bank_plays(tmp_path):
    from stable_baselines3 import PPO

    from activetouch.envs.make import bank_episodes
    from activetouch.envs.sb3 import BankVecEnv
    from activetouch.sensor_files import MODELS, load_observation_model

    model = load_observation_model(MODELS / "coarse-independent")
    for state in ("paper", "posterior"):
        envs = BankVecEnv(bank_episodes("coarse", "cone", 2, state=state), seed=(0,))
        PPO("MlpPolicy", envs, seed=0, device="cpu").save(tmp_path / f"{state}.zip")
        decider = make_decider(f"sb3:{tmp_path / state}.zip", model.outcome_table())
        assert check_decider(decider, np.random.default_rng(0), model, num_searches=1)


def test_a_recurrent_policy_is_refused(tmp_path, model):
    contrib = pytest.importorskip("sb3_contrib")
    import gymnasium

    from activetouch.envs.touch_source import SampledTouches

    touches = SampledTouches(model, ("p0", "p1", "p2"))
    env = gymnasium.make("activetouch:activetouch/ObjectTest-v0", touches=touches, target="shape_0")
    contrib.RecurrentPPO("MlpLstmPolicy", env, device="cpu").save(tmp_path / "recurrent.zip")
    decider = make_decider(f"sb3:{tmp_path}/recurrent.zip", model.outcome_table())
    with pytest.raises(BadPolicy, match="cannot be loaded as MaskablePPO"):
        check_decider(decider, np.random.default_rng(0), model, num_searches=1)
