"""A policy that Stable-Baselines3 saved plays as a decider, whatever it observes."""

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
        def __init__(self, size, actions=P + 2):
            self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (size,), np.float32)
            self.action_space = gymnasium.spaces.Discrete(actions)

        def reset(self, *, seed=None, options=None):
            return np.zeros(self.observation_space.shape, np.float32), {}

    for name, size in [*sizes.items(), *((f"{name}-goal", size + K) for name, size in sizes.items()), ("other", 5)]:
        for algorithm in (PPO, DQN) if name == "paper" else (PPO,):
            model = algorithm("MlpPolicy", Still(size), seed=0, device="cpu")
            model.save(folder / f"{name}-{algorithm.__name__.lower()}.zip")
    (folder / "nonsense.zip").write_text("nonsense")
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
        ("nonsense", "no file that Stable-Baselines3"),
    ],
)
def test_a_file_that_cannot_play_says_why(name, said, saved, model):
    decider = make_decider(f"sb3:{saved / name}.zip", model.outcome_table())
    with pytest.raises(BadPolicy, match=said):
        check_decider(decider, np.random.default_rng(0), model, num_searches=2)
