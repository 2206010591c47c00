"""The environments by id at speed: many tests at once on the touches that come with the package."""

from __future__ import annotations

from typing import Any

from gymnasium.vector import SyncVectorEnv, VectorEnv

from activetouch.envs.base import BadOption
from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.object_test import ObjectTestEnv
from activetouch.envs.priors import TargetProb
from activetouch.envs.touch_bank import TouchBank
from activetouch.envs.touch_source import Touches
from activetouch.envs.vector import BankVectorEnv
from activetouch.envs.wrappers import GainState, PosteriorState
from activetouch.sensor_files import INDEPENDENT_SUFFIX, MODELS, load_observation_model
from belief.errors import UnknownName
from belief.policy_state import TOUCH_LIMIT


def bank_episodes(scene: str = "paper", target: str = "cone", num_envs: int = 1, **settings: Any) -> BankEpisodes:
    """Parallel tests on the recorded touches of a scene that come with the package.

    Args:
        scene: name of a scene with a bank.
        target: label of the target shape.
        num_envs: number of parallel tests.
        settings: further arguments of :class:`activetouch.envs.batched_episodes.BankEpisodes`.

    Raises:
        UnknownName: the scene has no bank, or the target is unknown.
    """
    bank = TouchBank.shipped(scene)
    model = load_observation_model(MODELS / f"{scene}{INDEPENDENT_SUFFIX}")
    return BankEpisodes(bank, model, target, num_envs, **settings)


def vector_test(
    num_envs: int = 1,
    scene: str = "paper",
    target: str = "cone",
    touch_cost: float = 0.02,
    touch_limit: int = TOUCH_LIMIT,
    target_prob: TargetProb = 0.5,
    state: str = "paper",
    touches: Touches | None = None,
    render_mode: str | None = None,
    max_episode_steps: int | None = None,
) -> VectorEnv:
    """What ``gymnasium.make_vec("activetouch/ObjectTest-v0", num_envs=...)`` makes: tests on recorded touches.

    The touches were read by the sensor ``paper-independent``, whose belief takes them as independent given the shape.

    Args:
        num_envs: number of parallel tests.
        scene: name of a scene with a bank.
        target: label of the target shape.
        touch_cost: λ.
        touch_limit: T_max.
        target_prob: prior of the target, or a range from which every test draws its own.
        state: ``"paper"`` or ``"posterior"``, the observation; with live touches of one rigid body also ``"gains"``.
        touches: another source of touches; tests are then played one after the other.
        render_mode: None or ``"rgb_array"``, with which presses are live, because recorded touches have no picture.
        max_episode_steps: at least ``touch_limit + 1``; a test ends by itself.

    Raises:
        BadOption: too few steps.
        UnknownName: the scene has no bank, or the target or the state is unknown.
    """
    if max_episode_steps is not None and max_episode_steps <= touch_limit:
        raise BadOption(
            f"max_episode_steps={max_episode_steps} ends tests before touch_limit={touch_limit} does; give "
            f"max_episode_steps={touch_limit + 1} or more"
        )
    if touches is not None or render_mode is not None:
        wrap = {"paper": lambda env: env, "posterior": PosteriorState, "gains": GainState}
        if state not in wrap:
            raise UnknownName("state", state, list(wrap))
        given = (scene, target, touch_cost, touch_limit, target_prob, touches, render_mode)
        return SyncVectorEnv([lambda: wrap[state](ObjectTestEnv(*given))] * num_envs)
    settings = {"touch_cost": touch_cost, "touch_limit": touch_limit, "target_prob": target_prob, "state": state}
    return BankVectorEnv(bank_episodes(scene, target, num_envs, **settings))
