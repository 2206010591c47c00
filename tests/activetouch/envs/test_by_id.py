"""Environments by id work at speed on install, and the target of a goal-conditioned one is drawn and observed."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from activetouch.envs import IDS, MOST_STEPS
from activetouch.envs.base import BadAction, BadOption
from activetouch.envs.make import bank_episodes
from activetouch.envs.touch_bank import TouchBank
from activetouch.envs.touch_source import SampledTouches
from activetouch.envs.wrappers import BeliefShaping, GainState, PosteriorState
from belief.errors import UnknownName

TEST, GOAL = "activetouch/ObjectTest-v0", "activetouch/ObjectTestGoal-v0"


@pytest.fixture
def sampled(model):
    return SampledTouches(model, ("p0", "p1", "p2"))


def test_the_bank_that_comes_with_the_package_plays():
    envs = gymnasium.make_vec(TEST, num_envs=32, state="posterior")
    observations, _ = envs.reset(seed=0)
    assert observations in envs.observation_space
    rng, returns = np.random.default_rng(0), []
    for _ in range(30):
        observations, reward, *_ = envs.step(rng.integers(8, size=32))
        assert observations in envs.observation_space
        returns.append(reward)
    assert envs.spec.max_episode_steps == MOST_STEPS
    assert {-1.0, 1.0} <= set(np.unique(returns))


def test_a_bank_is_small_and_without_features():
    bank = TouchBank.shipped("paper")
    assert bank.logits.shape == (600, 2, 6, 4)
    assert bank.logits.dtype == np.float32
    assert bank.features is None
    with pytest.raises(UnknownName, match="paper"):
        TouchBank.shipped("coarse")


def test_a_time_limit_that_would_cut_tests_is_refused():
    with pytest.raises(BadOption, match="give max_episode_steps=1001"):
        gymnasium.make_vec(TEST, num_envs=2, scene="paper", touch_limit=1000)
    longer = gymnasium.make_vec(TEST, num_envs=2, scene="paper", touch_limit=1000, max_episode_steps=1001)
    assert longer.reset(seed=0)[0].shape == (2, 13)


@pytest.mark.parametrize(("state", "size"), [("paper", 10), ("posterior", 9)])
def test_other_touches_are_played_one_after_the_other(state, size, sampled):
    envs = gymnasium.make_vec(TEST, num_envs=2, touches=sampled, target="shape_0", state=state)
    assert envs.reset(seed=0)[0].shape == (2, size)
    with pytest.raises(UnknownName, match="posterior"):
        gymnasium.make_vec(TEST, num_envs=2, touches=sampled, target="shape_0", state="posteriour")


@pytest.mark.parametrize("name", IDS)
def test_an_episode_ends_by_its_touch_limit_before_the_time_limit(name, sampled):
    env = gymnasium.make(name, touches=sampled, touch_limit=20, **({} if name == GOAL else {"target": "shape_0"}))
    assert env.spec.max_episode_steps == MOST_STEPS
    env.reset(seed=0)
    for _ in range(20):
        assert env.step(0)[2:4] == (False, False)
    assert env.step(0)[2:4] == (False, True)


@pytest.mark.parametrize(
    "wrap", [lambda env: env, PosteriorState, GainState, lambda env: BeliefShaping(env, 0.1, 0.99)]
)
def test_the_target_is_drawn_and_observed(wrap, model, body):
    sampled = SampledTouches(body if wrap is GainState else model, ("p0", "p1", "p2"))
    env = wrap(gymnasium.make(GOAL, touches=sampled).unwrapped)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*different from the unwrapped version.*")
        check_env(env, skip_render_check=True)
    seen = set()
    for seed in range(30):
        observation, info = env.reset(seed=seed)
        assert observation[-4:].tolist() == [label == info["target"] for label in sampled.model.shape_labels]
        assert info["target_prob"] == pytest.approx(0.5)
        unwrapped = env.unwrapped
        is_target = unwrapped.arrangement[0] == unwrapped.target
        assert env.step(unwrapped.confirm)[4]["is_success"] == is_target
        seen.add((info["target"], is_target))
    assert len(seen) == 8


@pytest.mark.parametrize(
    ("actions", "words"),
    [
        ([-1, 0], r"in \[0, 7\], got \(2,\): \[-1  0\]"),
        ([0, 8], r"in \[0, 7\]"),
        ([0], "must be 2 integers"),
        ([[0], [1]], "must be 2 integers"),
        ([0.5, 1.0], "must be integers, got float64"),
    ],
)
def test_a_bank_refuses_actions_that_a_live_environment_refuses(actions, words):
    envs = gymnasium.make_vec(TEST, num_envs=2, scene="paper")
    with pytest.raises(ResetNeeded):
        envs.step(np.zeros(2, np.int64))
    envs.reset(seed=0)
    with pytest.raises(BadAction, match=words):
        envs.step(np.array(actions))


@pytest.mark.parametrize(
    "setting", [{"touch_limit": 0}, {"touch_limit": -1}, {"touch_cost": float("nan")}, {"touch_cost": -1.0}]
)
def test_a_bank_refuses_settings_that_a_live_environment_refuses(setting, sampled):
    with pytest.raises(ValueError, match=next(iter(setting))):
        gymnasium.make(TEST, target="a", touches=sampled, **setting)
    with pytest.raises(ValueError, match=next(iter(setting))):
        gymnasium.make_vec(TEST, num_envs=2, scene="paper", **setting)


@pytest.mark.parametrize("setting", [{"beta": float("nan")}, {"beta": -1.0}, {"discount": 2.0}, {"num_envs": 0}])
def test_episodes_of_a_bank_refuse_what_the_shaping_wrapper_refuses(setting):
    with pytest.raises(BadOption, match=next(iter(setting))):
        bank_episodes("paper", "cone", **setting)


def test_the_last_information_of_an_episode_is_where_gymnasium_has_it():
    envs = gymnasium.make_vec(TEST, num_envs=4, scene="paper")
    envs.reset(seed=0)
    _, _, terminated, _, infos = envs.step(np.array([0, 6, 7, 1]))
    np.testing.assert_array_equal(infos["_final_info"], terminated)
    for name in ("is_success", "num_touches", "target_prob"):
        np.testing.assert_array_equal(infos["final_info"][name], infos[name])
        np.testing.assert_array_equal(infos["final_info"][f"_{name}"], terminated)
    *_, infos = envs.step(np.zeros(4, np.int64))
    assert "final_info" not in infos


def test_recorded_touches_give_the_information_of_live_ones(sampled):
    settings = {"target_prob": 0.3, "state": "posterior"}
    live = gymnasium.make_vec(TEST, num_envs=3, touches=sampled, target="shape_1", **settings)
    bank = gymnasium.make_vec(TEST, num_envs=3, scene="paper", target="cube", **settings)
    for envs in (live, bank):
        _, infos = envs.reset(seed=0)
        assert (infos["is_success"].any(), infos["num_touches"].tolist()) == (False, [0, 0, 0])
        np.testing.assert_allclose(infos["target_prob"], 0.3)
        observations, *_, infos = envs.step(np.array([0, 1, 2]))
        np.testing.assert_allclose(infos["target_prob"], observations[:, 1], atol=1e-6)
