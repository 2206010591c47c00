"""Measure steps per second of processor time of the environments, live and from a bank, and of a trivial one.

Run: python benchmarks/env.py [SCENE] [BANK]     (default: the bank that comes with the package)

Three quarters of the random actions are probes. The trivial environment shows the time of the vectoriser alone.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import DummyVecEnv

from activetouch.envs import BANK_ID
from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.object_test import ObjectTestEnv
from activetouch.envs.sb3 import BankVecEnv
from activetouch.envs.touch_bank import TouchBank
from activetouch.envs.touch_source import LiveTouches, SampledTouches, Touches
from experiments.scene_choice import SceneChoice
from experiments.sensor_choice import independent_sensor, open_sensor

ROUNDS = 5
NEXT_STEP, SAME_STEP = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP
LIBRARIES = {"gymnasium": "gymnasium sync × 256: trivial", "sb3": "sb3 dummy × 256: trivial"}


class Counter(gymnasium.Env):
    """Environment whose episodes have twelve steps."""

    observation_space = gymnasium.spaces.Box(0.0, 1.0, (13,), np.float32)
    action_space = gymnasium.spaces.Discrete(8)

    def reset(self, *, seed=None, options=None):
        """Begin to count."""
        super().reset(seed=seed)
        self._steps = 0
        return np.zeros(13, np.float32), {}

    def step(self, action):
        """Count."""
        self._steps += 1
        return np.zeros(13, np.float32), 0.0, self._steps == 12, False, {}


def main(scene: str, folder: Path | None) -> None:
    torch.set_num_threads(1)
    sensor, bank = open_sensor(independent_sensor(scene), SceneChoice(scene)), bank_of(scene, folder)
    live, sampled = LiveTouches(sensor), SampledTouches(sensor.model, sensor.scene.pose_labels)
    target, model = sensor.scene.shape_labels[-1], sensor.model

    def episodes(num_envs: int, state: str = "paper") -> BankEpisodes:
        return BankEpisodes(bank, model, target, num_envs, state)

    def sync(make: Callable[[], gymnasium.Env], number: int) -> gymnasium.vector.VectorEnv:
        return gymnasium.vector.SyncVectorEnv([make] * number)

    def test_of(touches: Touches) -> Callable[[], gymnasium.Env]:
        return lambda: ObjectTestEnv(touches=touches, target=target)

    def made(number: int, mode: AutoresetMode) -> gymnasium.vector.VectorEnv:
        return gymnasium.make_vec(BANK_ID, num_envs=number, target="cone", autoreset_mode=mode)

    cases = {  # name: environment, how many at once, steps in a round
        "gymnasium sync × 64: trivial": (sync(Counter, 64), 64, 40),
        "gymnasium sync × 256: trivial": (sync(Counter, 256), 256, 20),
        "gymnasium sync × 64: touches from the model": (sync(test_of(sampled), 64), 64, 10),
        "gymnasium sync × 256: touches from the model": (sync(test_of(sampled), 256), 256, 4),
        "gymnasium sync × 64: live": (sync(test_of(live), 64), 64, 2),
        "gymnasium sync × 256: live": (sync(test_of(live), 256), 256, 1),
        "gymnasium × 64: make_vec, NEXT_STEP": (made(64, NEXT_STEP), 64, 200),
        "gymnasium × 256: make_vec, NEXT_STEP": (made(256, NEXT_STEP), 256, 100),
        "gymnasium × 256: make_vec, SAME_STEP": (made(256, SAME_STEP), 256, 100),
        "gymnasium × 1024: make_vec, NEXT_STEP": (made(1024, NEXT_STEP), 1024, 50),
        "sb3 dummy × 256: trivial": (DummyVecEnv([Counter] * 256), 256, 20),
        "sb3 × 64: bank": (BankVecEnv(episodes(64), (0,)), 64, 100),
        "sb3 × 256: bank": (BankVecEnv(episodes(256), (0,)), 256, 100),
        "sb3 × 256: bank, posterior state": (BankVecEnv(episodes(256, "posterior"), (0,)), 256, 100),
        "sb3 × 1024: bank": (BankVecEnv(episodes(1024), (0,)), 1024, 50),
    }
    rng = np.random.default_rng(0)
    seconds: dict[str, list[float]] = {name: [] for name in cases}
    for env, _, _ in cases.values():
        env.reset()
    for round_ in range(ROUNDS + 1):
        for name, (env, number, steps) in cases.items():
            actions = rng.integers(8, size=(steps, number))
            started = time.process_time()
            for row in actions:
                env.step(row)
            if round_ > 0:  # the first round warms up
                seconds[name].append((time.process_time() - started) / (steps * number))
    print(f"scene {scene}, {bank.num_objects} objects, numpy {np.__version__}, one thread")
    for name, times in seconds.items():
        ratio = np.median(seconds[LIBRARIES[name.split()[0]]]) / np.median(times)
        print(f"{name:<45} {1.0 / np.median(times):>10,.0f} steps/s  {ratio:7.2g} × trivial")


def bank_of(scene: str, folder: Path | None) -> TouchBank:
    return TouchBank.shipped(scene) if folder is None else TouchBank.open(folder)


if __name__ == "__main__":
    name = sys.argv[1] if len(sys.argv) > 1 else "paper"
    main(name, Path(sys.argv[2]) if len(sys.argv) > 2 else None)
