"""Scenes are classification tasks of ap_gym: its spaces, its loss, its checks. Skipped where it is not installed."""

import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from activetouch import TactileSensor, TouchWorld
from activetouch.envs.object_search import BadAction
from belief.errors import InvalidArgument, UnknownName
from belief.seeding import arrangement_rng, touch_rng

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    ap_gym = pytest.importorskip("ap_gym")

ID = "activetouch.envs.apgym:activetouch/ShapeTouch-v0"


@pytest.fixture(scope="module")
def env():
    return ap_gym.make(ID, scene="coarse", render_mode="rgb_array")


def test_the_checkers_of_ap_gym_and_gymnasium_find_nothing_wrong(env):
    assert isinstance(env.action_space["prediction"], ap_gym.LogitSpace)
    assert isinstance(env.observation_space["sensor_img"], ap_gym.ImageSpace)
    with warnings.catch_warnings():  # all tasks of ap_gym have logits without limits, and Gymnasium warns of them
        warnings.filterwarnings("ignore", message=".*Box action space.*")
        check_env(env.unwrapped)
    assert ap_gym.make_vec(ID, num_envs=2, scene="coarse").reset(seed=0)[0]["sensor_img"].shape == (2, 4, 4, 1)
    assert ap_gym.make("activetouch/ShapeTouch-sparse-v0", scene="coarse").reset(seed=0)


def test_an_episode_presses_the_best_pose_and_pays_the_cross_entropy(env):
    sensor, key = TactileSensor.shipped("coarse"), (0, 3)
    seen, _ = env.reset(options={"seed": key})
    rng = arrangement_rng(key)
    shape = int(rng.integers(4))
    world = TouchWorld.sample(sensor, (shape,), rng)
    uses = np.zeros(6, int)
    uses[np.argmax(seen["sensor_pose"])] += 1
    for step in range(12):
        score = np.linspace(0.0, 1.0, 6, dtype=np.float32)[(np.arange(6) + step) % 6]
        pose, prediction = int(np.argmax(score)), np.arange(4, dtype=np.float32)
        seen, reward, terminated, truncated, info = env.step({"action": score, "prediction": prediction})
        image, _ = world.press(pose, touch_rng(key, 0, pose, int(uses[pose])))
        uses[pose] += 1
        np.testing.assert_allclose(seen["sensor_img"].reshape(image.shape) * 255, image, atol=1e-4)
        loss = (np.log(np.exp(prediction).sum()) - prediction[shape]) / np.log(4)
        assert reward == pytest.approx(-loss - 1e-3 * np.linalg.norm(score), rel=1e-5)
        assert (terminated, truncated, float(seen["time_step"])) == (step == 11, False, pytest.approx((step - 5) / 6))
    assert info["stats"]["scalar"]["final_accuracy"] == (shape == 3)
    assert env.render().shape == (240, 480, 3)


def test_wrong_arguments_are_named(env):
    env.reset(seed=0)
    with pytest.raises(BadAction, match="must be finite"):
        env.step({"action": np.full(6, np.nan, np.float32), "prediction": np.zeros(4, np.float32)})
    with pytest.raises(InvalidArgument, match="step_limit"):
        ap_gym.make(ID, scene="coarse", step_limit=0)
    with pytest.raises(UnknownName, match="human"):
        ap_gym.make(ID, scene="coarse", render_mode="human")
