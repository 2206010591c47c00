"""Environments by id work at speed on install, and the target of a goal-conditioned one is drawn and observed."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers

from activetouch.envs import BANK_ID, IDS, MOST_STEPS
from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.object_search import STATES, BadOption
from activetouch.envs.touch_bank import TouchBank
from activetouch.envs.touch_source import SampledTouches
from belief.errors import UnknownName

TEST, GOAL = "activetouch/ObjectTest-v0", "activetouch/ObjectTestGoal-v0"


@pytest.fixture
def sampled(model):
    return SampledTouches(model, ("p0", "p1", "p2"))


def test_a_bank_is_small_and_without_features():
    bank = TouchBank.shipped("paper")
    assert bank.logits.shape == (600, 2, 6, 4)
    assert bank.logits.dtype == np.float32
    assert bank.features is None
    with pytest.raises(UnknownName, match="paper"):
        TouchBank.shipped("coarse")


@pytest.mark.parametrize("name", IDS)
def test_an_episode_ends_by_its_touch_limit_before_the_time_limit(name, sampled):
    env = gymnasium.make(name, touches=sampled, touch_limit=20, **({} if name == GOAL else {"target": "shape_0"}))
    assert env.spec.max_episode_steps == MOST_STEPS
    env.reset(seed=0)
    for _ in range(20):
        assert env.step(0)[2:4] == (False, False)
    assert env.step(0)[2:4] == (False, True)


@pytest.mark.parametrize("state", STATES)
def test_the_target_is_drawn_and_observed(state, model, body):
    sampled = SampledTouches(body if state == "gains" else model, ("p0", "p1", "p2"))
    env = gymnasium.make(GOAL, touches=sampled, state=state).unwrapped
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
    "setting", [{"touch_limit": 0}, {"touch_limit": -1}, {"touch_cost": float("nan")}, {"touch_cost": -1.0}]
)
def test_a_bank_refuses_settings_that_a_live_environment_refuses(setting, sampled):
    with pytest.raises(ValueError, match=next(iter(setting))):
        gymnasium.make(TEST, target="a", touches=sampled, **setting)
    with pytest.raises(ValueError, match=next(iter(setting))):
        BankEpisodes.shipped("paper", "cone", 2, **setting)


@pytest.mark.parametrize("setting", [{"beta": float("nan")}, {"beta": -1.0}, {"discount": 2.0}, {"num_envs": 0}])
def test_episodes_of_a_bank_refuse_what_the_shaping_wrapper_refuses(setting):
    with pytest.raises(BadOption, match=next(iter(setting))):
        BankEpisodes.shipped(**{"scene": "paper", "target": "cone", "num_envs": 2} | setting)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_many_tests_on_recorded_touches_restart_as_they_are_asked_to(mode):
    envs = gymnasium.make_vec(BANK_ID, num_envs=8, state="posterior", touch_limit=3, autoreset_mode=mode)
    alone, rng = BankEpisodes.shipped("paper", "cone", 8, state="posterior", touch_limit=3), np.random.default_rng(0)
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(np.zeros(8, int))
    observations, _ = envs.reset(seed=5)
    assert observations in envs.observation_space
    alone.restart(np.arange(8), gymnasium.utils.seeding.np_random(5)[0])
    np.testing.assert_array_equal(observations, alone.observe())
    was_over, ends, chance = np.zeros(8, bool), set(), envs.unwrapped.np_random
    for _ in range(40):
        actions, before = rng.integers(8, size=8), observations
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        assert not (rewards[was_over].any())
        assert not (terminated[was_over].any())
        assert not (infos["is_success"][was_over].any())
        is_new = was_over if mode is AutoresetMode.NEXT_STEP else terminated | truncated
        assert (observations[is_new, -1] == 0.0).all()  # no touch
        np.testing.assert_array_equal(terminated, (actions >= 6) & ~was_over)
        if mode is AutoresetMode.SAME_STEP and is_new.any():
            final = np.stack(infos["final_obs"][is_new])
            np.testing.assert_array_equal(final[:, -1] > before[is_new, -1], np.zeros(is_new.sum()))
            assert infos["final_info"]["num_touches"][is_new] * 1.0 == pytest.approx(3 * final[:, -1])
        ends |= set(zip(terminated.tolist(), truncated.tolist(), strict=True))
        was_over = (terminated | truncated) & (mode is AutoresetMode.NEXT_STEP)
    assert ends == {(False, False), (True, False), (False, True)}
    assert chance is envs.unwrapped.np_random


MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED]


def steps_of(envs, actions):
    """What is seen in the next steps; where nothing starts anew by itself, a mask does it."""
    found = []
    for now in actions:
        seen, *results, infos = envs.step(now)
        ended = results[1] | results[2]
        if envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED and ended.any():
            with pytest.raises(gymnasium.error.ResetNeeded, match=f"rows .*{np.flatnonzero(ended)[-1]}. are over"):
                envs.step(now)
            seen, _ = envs.reset(options={"reset_mask": ended})
        found.append([seen, *results, *(infos[name] for name in ("is_success", "num_touches", "target_prob"))])
    return found


@pytest.mark.parametrize("mode", MODES)
def test_a_list_of_seeds_gives_each_row_the_episodes_that_it_has_alone(mode):
    settings = {"state": "posterior", "touch_limit": 3, "autoreset_mode": mode, "target_prob": (0.1, 0.9)}
    actions, seeds = np.random.default_rng(0).integers(8, size=(20, 4)), [3, 14, 3, 159]
    envs = gymnasium.make_vec(BANK_ID, num_envs=4, **settings)
    first, _ = envs.reset(seed=seeds)
    np.testing.assert_array_equal(first[0], first[2])
    together = steps_of(envs, actions)
    for row, seed in enumerate(seeds):
        alone = gymnasium.make_vec(BANK_ID, num_envs=1, **settings)
        np.testing.assert_array_equal(alone.reset(seed=[seed])[0], first[[row]])
        for seen, own in zip(together, steps_of(alone, actions[:, [row]]), strict=True):
            for one, other in zip(seen, own, strict=True):
                np.testing.assert_array_equal(one[[row]], other)


@pytest.mark.parametrize("mode", MODES)
def test_a_mask_starts_its_rows_anew_and_leaves_the_others(mode):
    envs = gymnasium.make_vec(BANK_ID, num_envs=4, state="posterior", autoreset_mode=mode)
    mask = np.array([True, False, False, True])
    with pytest.raises(gymnasium.error.ResetNeeded, match="without a mask"):
        envs.reset(options={"reset_mask": mask})
    envs.reset(seed=5)
    seen, *_, infos = envs.step(np.array([0, 1, 6, 3]) % (6 if mode is AutoresetMode.SAME_STEP else 8))
    options = {"reset_mask": mask}
    new, after = envs.reset(seed=[7, None, 9, None], options=options)
    assert list(options) == ["reset_mask"]
    np.testing.assert_array_equal(new[1:3], seen[1:3])
    assert after["num_touches"].tolist() == [0, *infos["num_touches"][1:3], 0]
    np.testing.assert_array_equal(new[0], envs.reset(seed=[7] * 4)[0][3])
    by_one, by_list = (envs.reset(seed=seed, options={"reset_mask": mask})[0] for seed in (20, [20, 0, 0, 23]))
    np.testing.assert_array_equal(by_one, by_list)
    again, _ = envs.reset(seed=5)
    np.testing.assert_array_equal(again, envs.reset(seed=5)[0])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"seed": [1, 2]}, "one for each of the 3 rows, got 2"),
        ({"seed": [1, -2, 3]}, "integers ≥ 0, got -2"),
        ({"seed": [1, 2.5, 3]}, "integers ≥ 0, got 2.5"),
        ({"options": {"seed": (0, 1)}}, "one option, 'reset_mask', 3 booleans .*got {'seed'"),
        ({"options": {"reset_mask": [True]}}, "one option"),
        ({"options": {"reset_mask": np.zeros(3, bool)}}, "of which one is true"),
        ({"options": {"reset_mask": np.arange(3)}}, "3 booleans"),
        ({"options": {"reset_mask": np.ones(3, bool), "more": 1}}, "one option"),
    ],
)
def test_seeds_and_masks_that_do_not_fit_the_rows_are_refused(arguments, said):
    envs = gymnasium.make_vec(BANK_ID, num_envs=3)
    envs.reset(seed=0)
    before = envs.unwrapped.observe()
    with pytest.raises(BadOption, match=said):
        envs.reset(**arguments)
    np.testing.assert_array_equal(envs.unwrapped.observe(), before)


def test_the_wrappers_of_gymnasium_take_the_vector_environment():
    envs = gymnasium.make_vec(BANK_ID, num_envs=16, target="cube")
    for wrap in (
        wrappers.RecordEpisodeStatistics,
        wrappers.NormalizeObservation,
        wrappers.NormalizeReward,
        wrappers.FlattenObservation,
        wrappers.DictInfoToList,
    ):
        envs = wrap(envs)
    envs.reset(seed=0)
    returns = [info["episode"]["r"] for _ in range(30) for info in envs.step(np.full(16, 6))[4] if "episode" in info]
    assert set(np.round(returns, 6)) == {-1.0, 1.0}
