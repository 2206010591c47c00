"""The environments keep Gymnasium's contract, and play the searches that everything else plays."""

import subprocess
import sys
import warnings
from dataclasses import replace

import gymnasium
import matplotlib
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

from activetouch import SCENES, TactileSensor, TouchWorld
from activetouch.envs import IDS, drawing
from activetouch.envs.object_search import BadAction, BadOption, ObjectSearchEnv
from activetouch.envs.object_test import ObjectTestEnv
from activetouch.envs.touch_source import LiveTouches, SampledTouches
from activetouch.perception.reader import HypothesisTable
from activetouch.poses import aimed
from belief import Confirm, Probe, Reject, SceneBelief, Unsure
from belief.errors import InvalidArgument, UnknownName
from belief.observation_model.rigid_body import RigidBodyModel
from belief.policy_state import NoGains
from belief.seeding import arrangement_rng
from belief.synthetic import SyntheticWorld
from planners import Decision, InformationState, Outcome, make_decider, search

pytestmark = pytest.mark.torch
every_id = pytest.mark.parametrize("name", [name for name in IDS if "Goal" not in name])


@pytest.fixture(scope="module")
def coarse():
    return LiveTouches(TactileSensor.shipped("coarse"))


@pytest.fixture
def sampled(model):
    return SampledTouches(model, ("p0", "p1", "p2"))


@every_id
@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"sed": 3}, "'seed'; got {'sed': 3}"),
        ({"seed": (1,), "target": 2}, "'seed'; got .*'target'"),
        ({"seed": 3}, "got 3"),
        ({"seed": "abc"}, "got 'abc'"),
        ({"seed": ()}, r"got \(\)"),
        ({"seed": (0, -1)}, "-1"),
        ({"seed": (0, 1.5)}, "1.5"),
        ({"seed": (0, None)}, "None"),
        (["seed"], "'seed'; got .*'seed'"),
    ],
)
def test_options_that_there_are_not_are_refused(name, options, named, sampled):
    env = gymnasium.make(name, touches=sampled, target="shape_1").unwrapped
    with pytest.raises(BadOption, match=named):
        env.reset(options=options)


@pytest.mark.parametrize(
    ("name", "state"),
    [
        ("activetouch/ObjectTest-v0", "paper"),
        ("activetouch/ObjectTest-v0", "gains"),
        ("activetouch/ObjectSearch-v0", "posterior"),
    ],
)
def test_gymnasium_and_sb3_find_nothing_wrong(name, state):
    env = gymnasium.make(name, scene="coarse", target="cone", render_mode="rgb_array", state=state).unwrapped
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message=".*different from the unwrapped version.*"
        )  # as a wrapper is meant to
        check_env(env)
    check_env_for_sb3(env, skip_render_check=False)


def printed(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_naming_the_package_in_the_id_is_enough():
    id_ = "activetouch:activetouch/ObjectTest-v0"
    code = f"import gymnasium; print(gymnasium.make({id_!r}, scene='coarse').reset(seed=0)[0].shape)"
    assert printed(code) == "(13,)\n"


def test_importing_the_package_registers_the_environments_and_loads_neither_torch_nor_mujoco():
    code = "import sys, activetouch, gymnasium; print('activetouch/ObjectTest-v0' in gymnasium.registry, "
    assert printed(code + "'torch' in sys.modules, 'mujoco' in sys.modules)") == "True False False\n"


@every_id
def test_many_environments_are_made_at_once(name, sampled):
    envs = gymnasium.make_vec(name, num_envs=3, touches=sampled, target="shape_1")
    observations, _ = envs.reset(seed=0)
    assert observations.shape[0] == 3
    assert envs.step(np.zeros(3, np.int64))[1].tolist() == pytest.approx([-0.02] * 3)
    envs.close()


@pytest.mark.parametrize("decision", ["confirm", "reject"])
def test_a_test_pays_the_papers_reward(decision, sampled):
    env = ObjectTestEnv(touches=sampled, target="shape_2", touch_cost=0.03)
    rights = 0
    for seed in range(40):
        env.reset(seed=seed)
        _, cost, terminated, truncated, _ = env.step(1)
        assert (cost, terminated, truncated) == (-0.03, False, False)
        _, reward, terminated, _, info = env.step(getattr(env, decision))
        is_target = env.arrangement == (2,)
        assert info["is_success"] == (is_target == (decision == "confirm")) == (reward == 1.0)
        assert terminated
        rights += info["is_success"]
    assert 8 <= rights <= 32  # a fair coin, 40 times: outside with probability 1e-4


def test_the_probe_beyond_the_limit_feels_nothing_and_truncates(sampled):
    env = ObjectTestEnv(touches=sampled, target="shape_2", touch_limit=2)
    env.reset(seed=0)
    for _ in range(2):
        assert env.action_masks().all()
        state, *_ = env.step(0)
    assert env.action_masks().tolist() == [False] * 3 + [True] * 2
    after, reward, terminated, truncated, info = env.step(1)
    np.testing.assert_array_equal(after, state)
    assert (reward, terminated, truncated, info["is_success"]) == (-0.02, False, True, False)
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step(0)


def actions_of(episode, env):
    for step in episode.steps:
        match step.decision.action:
            case Probe(pose):
                yield pose
            case Confirm():
                yield env.confirm
            case Reject():
                yield env.reject
            case Unsure():
                yield env.unsure


class Shy:
    """Confirms or rejects like another decider, but is unsure once it has touched five times in all."""

    def __init__(self, decider):
        self.decider = decider

    def decide(self, info, rng):
        touches = sum(len(info.scene.touches(index)) for index in range(info.scene.num_objects))
        return Decision(Unsure()) if touches == 5 else self.decider.decide(info, rng)


@pytest.mark.parametrize("unsure_reward", [None, 0.0, -0.75])
@pytest.mark.parametrize("composition", ["distinct", "independent"])
def test_a_search_in_the_environment_is_the_search_of_the_loop(composition, unsure_reward, sampled, model):
    env = ObjectSearchEnv(
        touches=sampled, target="shape_0", composition=composition, touch_limit=9, unsure_reward=unsure_reward
    )
    num_unsure = 0
    for number in range(30):
        key = (0, 0, number)
        env.reset(options={"seed": key})
        world = SyntheticWorld(model, env.arrangement)
        decider = make_decider(("information_gain", "threshold", "random_confirm")[number % 3], model.outcome_table())
        decider = decider if unsure_reward is None else Shy(decider)
        episode = search(world, decider, env.problem, 0, model, key)
        total = 0.0
        for action, step in zip(actions_of(episode, env), episode.steps, strict=True):
            np.testing.assert_allclose(env.belief.probs, step.belief.probs, atol=1e-12)
            _, reward, terminated, truncated, info = env.step(action)
            total += reward
        assert terminated or truncated
        assert env.action_space.n == len(env.action_masks()) == env.problem.num_poses + 2 + (unsure_reward is not None)
        assert info["is_success"] == episode.success
        assert total == pytest.approx(episode.reward(env.problem))
        is_unsure = episode.outcome is Outcome.UNSURE
        assert info.get("is_unsure") == (None if unsure_reward is None else is_unsure)
        num_unsure += is_unsure
    assert (num_unsure > 2) == (unsure_reward is not None)


def test_being_unsure_ends_an_episode_and_is_no_action_by_default(sampled):
    env = ObjectSearchEnv(touches=sampled, target="shape_0", unsure_reward=0.25)
    env.reset(seed=0)
    before, *_ = env.step(1)
    state, reward, terminated, truncated, info = env.step(env.unsure)
    np.testing.assert_array_equal(state, before)
    assert (reward, terminated, truncated) == (0.25, True, False)
    assert (info["is_success"], info["is_unsure"]) == (False, True)
    _, info = env.reset(seed=0)
    assert info["is_unsure"] is False
    check_env_for_sb3(env)
    bare = ObjectSearchEnv(touches=sampled, target="shape_0")
    bare.reset(seed=0)
    assert bare.unsure is None
    with pytest.raises(BadAction, match="4"):
        bare.step(5)


def test_live_touches_are_those_of_the_world_that_compare_plays(coarse):
    env = ObjectSearchEnv(touches=coarse, target="cone")
    env.reset(options={"seed": (0, 3, 17)})
    rng = arrangement_rng((0, 3, 17))
    assert len(env._sample_arrangement(rng)) == 4
    world = TouchWorld.sample(coarse.sensor, env.arrangement, rng)
    episode = search(
        world, make_decider("information_gain", coarse.model.outcome_table()), env.problem, 3, coarse.model, (0, 3, 17)
    )
    for action in actions_of(episode, env):
        env.step(action)
    np.testing.assert_array_equal(env.belief.probs, episode.steps[-1].belief.probs)


def test_observations_say_what_they_are_documented_to(sampled):
    env = ObjectTestEnv(touches=sampled, target="shape_3")
    state, info = env.reset(seed=3)
    np.testing.assert_allclose(state, [0.25] * 4 + [0.0] * 5 + [0.0])
    assert info == {"is_success": False, "num_touches": 0, "target_prob": pytest.approx(0.5)}
    env.step(2)
    state, *_ = env.step(2)
    np.testing.assert_allclose(state[4:], [0, 0, 1, 0, 0, 2 / 12], atol=1e-7)
    env = ObjectTestEnv(touches=sampled, target="shape_3", state="posterior")
    env.reset(seed=3)
    env.step(2)
    posterior, *_ = env.step(2)
    np.testing.assert_allclose(posterior[:4], env.belief.probs, atol=1e-7)
    odds = env.belief.probs[3] / (1.0 - env.belief.probs[3])
    np.testing.assert_allclose(posterior[4:], [np.tanh(np.log(odds) / 4), 0, 0, 2 / 3, 2 / 12], atol=1e-6)


def test_a_frame_shows_touch_and_belief(coarse):
    env = ObjectTestEnv(touches=coarse, render_mode="rgb_array")
    env.reset(seed=0)
    blank = env.render()
    env.step(0)
    frame = env.render()
    assert frame.shape == blank.shape == (240, 480, 3)
    for panel in range(2):
        assert (frame[:, 240 * panel : 240 * (panel + 1)] != blank[:, 240 * panel : 240 * (panel + 1)]).any()


def test_a_window_follows_the_episode_and_passes_the_checker(sampled, monkeypatch):
    matplotlib.use("agg")
    shown = []
    monkeypatch.setattr(
        drawing.Window, "show", lambda self, frame, show=drawing.Window.show: shown.append(frame) or show(self, frame)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make("activetouch/ObjectTest-v0", touches=sampled, target="shape_0", render_mode="human")
        assert env.metadata["render_modes"] == ["human", "rgb_array"]
        env.reset(seed=0)
        env.step(0)
        assert env.render() is None
        assert len(shown) == 3
        assert (shown[1] != shown[0]).any()
        assert (shown[2] == shown[1]).all()
        check_env(env.unwrapped)
        env.close()
    assert not matplotlib.pyplot.get_fignums()


@pytest.mark.parametrize("mode", list(gymnasium.vector.AutoresetMode))
def test_every_way_to_restart_episodes_and_the_wrappers_that_need_the_next_step_work(mode, sampled):
    envs = gymnasium.make_vec(
        "activetouch/ObjectTest-v0",
        num_envs=2,
        touches=sampled,
        target="shape_1",
        vector_kwargs={"autoreset_mode": mode},
    )
    if mode is gymnasium.vector.AutoresetMode.NEXT_STEP:  # others are refused by these
        envs = gymnasium.wrappers.vector.NormalizeObservation(gymnasium.wrappers.vector.RecordEpisodeStatistics(envs))
    envs.reset(seed=0)
    _, _, ended, _, _ = envs.step(np.array([sampled.model.outcome_table().num_poses, 0]))
    assert ended.tolist() == [True, False]
    if mode is gymnasium.vector.AutoresetMode.DISABLED:
        envs.reset(options={"reset_mask": np.array([True, False])})
    _, rewards, ended, _, _ = envs.step(np.zeros(2, np.int64))
    assert not ended.any()
    assert rewards.tolist() == [0.0 if mode is gymnasium.vector.AutoresetMode.NEXT_STEP else -0.02, -0.02]
    envs.close()


def test_what_cannot_be_is_refused_by_name(sampled):
    with pytest.raises(UnknownName, match="cone"):
        ObjectTestEnv(touches=sampled, target="cone")
    with pytest.raises(UnknownName, match=r"unknown scene 'gell'\. Did you mean 'gel'"):
        ObjectTestEnv(scene="gell")
    with pytest.raises(InvalidArgument, match=r"name of a scene, got Scene.*give touches=LiveTouches\(sensor\)"):
        ObjectTestEnv(scene=SCENES["gel"].scene)
    with pytest.raises(UnknownName, match="render mode"):
        ObjectTestEnv(touches=sampled, target="shape_0", render_mode="ansi")
    for wrong in (1.0, 0.0, np.nan, (0.5, 0.4), (0.5, 1.0), (0.1, 0.2, 0.3)):
        with pytest.raises(ValueError, match="target_prob"):
            ObjectTestEnv(touches=sampled, target="shape_0", target_prob=wrong)
    with pytest.raises(NoGains, match="independent touches"):
        ObjectTestEnv(touches=sampled, target="shape_0", state="gains")
    with pytest.raises(UnknownName, match="posterior"):
        ObjectTestEnv(touches=sampled, target="shape_0", state="posteriour")
    env = ObjectTestEnv(touches=sampled, target="shape_0", render_mode="rgb_array")
    for asked in (lambda: env.step(0), env.render, lambda: env.belief):
        with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
            asked()
    env.reset(seed=0)
    with pytest.raises(BadAction, match="5"):
        env.step(5)


def test_a_search_with_26_places_and_one_with_104_are_environments():
    keyed = TactileSensor.shipped("keyed")
    poses, aims = aimed(keyed.scene.rotations, [(0.0, 0.0), (0.006, 0.0), (0.0, 0.006), (-0.006, 0.0)])
    many = replace(keyed.scene, poses=poses, aims=aims)
    for scene in (keyed.scene, many):
        table = HypothesisTable(keyed.reader, scene)
        model = keyed.model.with_hypotheses(table, 16)
        assert isinstance(model, RigidBodyModel)
        several = replace(
            model,
            groups=table.groups,
            references=np.repeat(model.references, max(table.groups) + 1, axis=0),
            reference_logits=np.repeat(model.reference_logits, max(table.groups) + 1, axis=0),
        )
        touches = LiveTouches(TactileSensor(scene, keyed.reader, several))
        env = gymnasium.make("activetouch/ObjectSearch-v0", scene="keyed", target="cube_cut", touches=touches)
        assert env.action_space.n == len(scene.poses) + 2
        check_env(env.unwrapped, skip_render_check=True)
        check_env_for_sb3(env.unwrapped)
        decider = make_decider("shape_information_gain", several.outcome_table(), several)
        problem = env.unwrapped.problem
        state = InformationState.of(problem, 1, SceneBelief(problem, several), 0)
        assert 0 <= decider.decide(state, np.random.default_rng(0)).action.pose < len(scene.poses)


def test_the_last_observation_shows_the_action_that_ended_the_episode(sampled):
    env = ObjectTestEnv(touches=sampled, target="shape_0")
    for last in (env.confirm, env.reject):
        env.reset(seed=0)
        for action in (2, last):
            observation, *_ = env.step(action)
            np.testing.assert_array_equal(observation[4:9], np.arange(5) == action)
