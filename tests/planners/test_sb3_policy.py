"""A policy that Stable-Baselines3 saved plays as a decider, whatever it observes."""

import pickle
import zipfile

import numpy as np
import pytest

from belief import Belief, Confirm, Probe, Reject, SearchProblem, Touch
from belief.policy_state import NoGains
from planners import InformationState, check_decider, make_decider
from planners.other_agents import SB3Policy, observation
from planners.ppo import BadPolicy, MissingPolicy, UnknownNormalization

pytestmark = pytest.mark.torch
K, P = 4, 3


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Files of untrained policies by what they observe."""
    import gymnasium
    from stable_baselines3 import DQN, PPO

    folder = tmp_path_factory.mktemp("sb3")
    sizes = {"paper": K + P + 3, "posterior": K + P + 2, "gains": K + 2 * P + 2}

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
    with zipfile.ZipFile(folder / "many-names.zip", "w") as file:
        for number in range(20_000):
            file.writestr(f"{number}.data", b"")
    return folder


@pytest.mark.parametrize("name", ["gains-ppo", "gains-goal-ppo"])
def test_a_policy_on_the_gains_plays_with_a_sensor_of_one_rigid_body(name, saved, body, model):
    decider = make_decider(f"sb3:{saved / name}.zip", body.outcome_table())
    assert check_decider(decider, np.random.default_rng(0), body, num_searches=2)
    with pytest.raises(NoGains, match="one rigid body"):
        check_decider(decider, np.random.default_rng(0), model, num_searches=2)
    other = make_decider(f"sb3:{saved / name}.zip(state='posterior')", body.outcome_table())
    with pytest.raises(BadPolicy, match=r"and 9 numbers \(posterior\), 13 with the target, from -1 on, as"):
        check_decider(other, np.random.default_rng(0), body, num_searches=2)


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
        ("many-names", r"no file that Stable-Baselines3 saved: its list of names has \d+ bytes"),
        ("damaged", "cannot be loaded as PPO: .*undamaged PPO, A2C, DQN, MaskablePPO or RecurrentPPO"),
    ],
)
def test_a_file_that_cannot_play_says_why(name, said, saved, model):
    decider = make_decider(f"sb3:{saved / name}.zip", model.outcome_table())
    with pytest.raises(BadPolicy, match=said):
        check_decider(decider, np.random.default_rng(0), model, num_searches=2)


def test_a_policy_that_learned_on_a_bank_plays(tmp_path):
    from stable_baselines3 import PPO

    from activetouch.envs.batched_episodes import BankEpisodes
    from activetouch.envs.sb3 import BankVecEnv
    from activetouch.sensor_files import MODELS, fitted_model

    model = fitted_model(MODELS / "paper-independent").model
    for state in ("paper", "posterior"):
        envs = BankVecEnv(BankEpisodes.shipped("paper", "cone", 2, state=state), seed=(0,))
        PPO("MlpPolicy", envs, seed=0, device="cpu").save(tmp_path / f"{state}.zip")
        decider = make_decider(f"sb3:{tmp_path / state}.zip", model.outcome_table())
        assert check_decider(decider, np.random.default_rng(0), model, num_searches=1)


def test_a_recurrent_policy_sees_all_touches_of_an_object_in_their_order(tmp_path, model):
    contrib = pytest.importorskip("sb3_contrib")
    import gymnasium

    from activetouch.envs.touch_source import SampledTouches

    touches = SampledTouches(model, tuple(f"p{i}" for i in range(P)))
    task = {"touches": touches, "target": "shape_0", "touch_limit": 6}
    env = gymnasium.make("activetouch:activetouch/ObjectTest-v0", **task)
    settings = {"n_steps": 64, "batch_size": 32, "n_epochs": 1, "policy_kwargs": {"lstm_hidden_size": 8}}
    learner = contrib.RecurrentPPO("MlpLstmPolicy", env, seed=0, device="cpu", **settings).learn(64)
    learner.save(tmp_path / "recurrent.zip")
    decider = make_decider(f"sb3:{tmp_path}/recurrent.zip(touch_limit=6)", model.outcome_table())
    assert check_decider(decider, np.random.default_rng(0), model, num_searches=2)

    # An episode of the environment, in which the policy lives, has the same actions.
    rng, different = np.random.default_rng(1), 0
    labels = tuple(model.shape_labels)
    problem = SearchProblem(labels, touches.pose_labels, 1, "independent")
    for _ in range(20):
        history, memory, begins = (), None, np.ones(1, np.bool_)
        for _ in range(5):
            info = InformationState(problem, 0, Belief.uniform(labels), history)
            seen = observation(info, "paper", False, 6)
            action, memory = learner.predict(seen, memory, begins, deterministic=True)
            begins[:] = False
            taken = decider.decide(info, np.random.default_rng(0)).action
            assert taken == [*(Probe(i) for i in range(P)), Confirm(), Reject()][int(action)]
            different += int(action) != int(learner.predict(seen, None, np.ones(1, np.bool_), deterministic=True)[0])
            history = (*history, Touch(int(rng.integers(P)), 9.0 * rng.normal(size=K)))
    assert different  # the memory counts

    gymnasium_env = gymnasium.make("activetouch:activetouch/ObjectTest-v0", **task, state="posterior")
    contrib.RecurrentPPO("MlpLstmPolicy", gymnasium_env, device="cpu").save(tmp_path / "posterior.zip")
    other = make_decider(f"sb3:{tmp_path}/posterior.zip", model.outcome_table())
    with pytest.raises(BadPolicy, match=r"\(9,\) from -1 on .* needs 5 actions and 10 numbers \(paper\), 14 with"):
        check_decider(other, np.random.default_rng(0), model, num_searches=1)


class Short:
    """An environment with observations like the paper's state, whose tests end after so many steps."""

    def __new__(cls, length=3):
        import gymnasium

        class Env(gymnasium.Env):
            observation_space = gymnasium.spaces.Box(0.0, 1.0, (K + P + 3,), np.float32)
            action_space = gymnasium.spaces.Discrete(P + 2)
            steps = 0

            def seen(self):
                shares = np.random.default_rng(self.steps).dirichlet(np.ones(K))
                one_hot = np.arange(P + 2) == self.steps % (P + 2)
                return np.concatenate([shares, one_hot, [self.steps / length]]).astype(np.float32)

            def reset(self, *, seed=None, options=None):
                self.steps = 0
                return self.seen(), {}

            def step(self, action):
                self.steps += 1
                return self.seen(), 0.0, self.steps >= length, False, {}

        return Env()


def normalised(folder, algorithm, **options):
    """Save a policy that learned inside VecNormalize in a folder."""
    import stable_baselines3
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    settings = {"n_steps": 16, "batch_size": 8} if algorithm == "PPO" else {"learning_starts": 8}
    env = VecNormalize(DummyVecEnv([Short]), **options)
    learner = getattr(stable_baselines3, algorithm)("MlpPolicy", env, seed=0, device="cpu", **settings)
    learner.learn(32).save(folder / "policy.zip")
    env.save(folder / "vecnormalize.pkl")
    return learner, env


def first_decision(path, model, decider=None):
    labels = tuple(model.shape_labels)
    problem = SearchProblem(labels, tuple(f"p{i}" for i in range(P)), 1, "independent")
    decider = decider or SB3Policy(str(path))
    return decider.decide(InformationState(problem, 0, Belief.uniform(labels)), np.random.default_rng(0))


@pytest.mark.parametrize("algorithm", ["PPO", "DQN"])
def test_a_policy_that_learned_from_normalised_observations_plays_with_their_normalisation(algorithm, tmp_path, model):
    learner, env = normalised(tmp_path, algorithm)
    path = tmp_path / "policy.zip"
    with pytest.raises(BadPolicy, match=REFUSED):
        first_decision(path, model)
    decider = make_decider(f"sb3:{path}(normalize='{tmp_path}/vecnormalize.pkl')", model.outcome_table())
    assert [file.name for file in decider.files("cone")] == ["policy.zip", "vecnormalize.pkl"]
    learner.observation_space = env.observation_space
    taken = first_decision(path, model, decider).action
    seen = np.array([0.25] * 4 + [0.0] * 6, np.float32)
    action = int(learner.predict(env.normalize_obs(seen), deterministic=True)[0])
    assert taken == [*(Probe(i) for i in range(P)), Confirm(), Reject()][action]
    normalised(tmp_path, algorithm, norm_obs=False)
    assert first_decision(path, model)
    assert first_decision(path, model, decider)


REFUSED = r"VecNormalize changed; name the file .*normalize='vecnormalize.pkl'"


@pytest.mark.parametrize("algorithm", ["PPO", "DQN"])
@pytest.mark.parametrize("last", [np.zeros((1, K + P + 3)), np.full((1, K + P + 3), 0.5), np.eye(3, K + P + 3) * 0.9])
def test_normalised_observations_are_known_as_such_where_they_keep_the_range(last, algorithm, tmp_path, model):
    learner, _ = normalised(tmp_path, algorithm)
    learner._last_obs = last.astype(np.float32)
    learner.save(tmp_path / "within.zip")
    with pytest.raises(BadPolicy, match=REFUSED):
        first_decision(tmp_path / "within.zip", model)


def test_a_policy_that_learned_in_one_normalised_environment_is_refused(tmp_path):
    """Its last observation is in the range of the state."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    from activetouch.envs.batched_episodes import BankEpisodes
    from activetouch.envs.sb3 import BankVecEnv
    from activetouch.sensor_files import MODELS, fitted_model

    model = fitted_model(MODELS / "paper-independent").model
    envs = VecNormalize(BankVecEnv(BankEpisodes.shipped("paper", "cone", 1, state="posterior"), seed=0))
    learner = PPO("MlpPolicy", envs, n_steps=32, batch_size=32, n_epochs=1, seed=0, device="cpu").learn(64)
    envs.obs_rms.var[:] = 1e4  # so that all are small
    learner._last_obs = envs.normalize_obs(envs.get_original_obs())
    learner.save(tmp_path / "one.zip")
    decider = make_decider(f"sb3:{tmp_path}/one.zip", model.outcome_table())
    with pytest.raises(BadPolicy, match=REFUSED):
        check_decider(decider, np.random.default_rng(0), model, num_searches=1)


@pytest.mark.parametrize("algorithm", ["PPO", "DQN"])
def test_it_is_said_where_nothing_tells_whether_observations_were_normalised(algorithm, tmp_path, model):
    learner, _ = normalised(tmp_path, algorithm)
    path = tmp_path / "policy.zip"
    learner.save(path, exclude=["_last_obs"])
    with pytest.warns(UnknownNormalization, match=r"keeps no observation of its training.*name the file"):
        first_decision(path, model)
    assert first_decision(path, model, SB3Policy(str(path), normalize=str(tmp_path / "vecnormalize.pkl")))


@pytest.mark.parametrize(("content", "said"), [(b"nonsense", "no VecNormalize"), (pickle.dumps(3), "no VecNormalize")])
def test_a_normalisation_that_is_none_is_refused(content, said, tmp_path, model):
    normalised(tmp_path, "PPO")
    decider = SB3Policy(str(tmp_path / "policy.zip"), normalize=str(tmp_path / "other.pkl"))
    with pytest.raises(MissingPolicy, match=r"there is no file .*other\.pkl"):
        first_decision(None, model, decider)
    (tmp_path / "other.pkl").write_bytes(content)
    with pytest.raises(BadPolicy, match=said):
        first_decision(None, model, decider)


def test_a_policy_that_learned_in_longer_tests_names_their_touch_limit(tmp_path, model):
    from stable_baselines3 import PPO

    PPO("MlpPolicy", Short(25), seed=0, device="cpu", n_steps=64, batch_size=32).learn(64).save(tmp_path / "long.zip")
    with pytest.raises(BadPolicy, match=r"up to 25 steps.*touch limit of 12.*touch_limit=24"):
        first_decision(tmp_path / "long.zip", model)
    decider = make_decider(f"sb3:{tmp_path / 'long.zip'}(touch_limit=24)", model.outcome_table())
    assert first_decision(tmp_path / "long.zip", model, decider)
