"""Policy and image encoder trained together, beside frozen features, the posterior and information gain.

    activetouch collect --scene coarse --plan.train 0 --plan.calibration 400 --plan.test 250 --plan.repeats 2 \
        --out build/coarse-repeats
    python benchmarks/ppo_encoder.py --data build/coarse-repeats

PPO of Stable-Baselines3 learns the test of one object (is it the target?) from recorded touches. A policy that sees
images sees the last one of every pose, which poses were used how often, and the time. An encoder of one image, the
same for all poses, is trained with it, or is the shipped reader and frozen. The policy on the posterior sees what
``train-ppo --recipes gains`` gives it. With shaping, β (γ Φ(s') - Φ(s)) is added to the reward of learning, where Φ is
the certainty of the shipped belief. All are tested without it, on objects of another split, half of them targets.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from activetouch.data.dataset import read_split
from activetouch.envs.bank_evidence import BankEvidence
from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.sb3 import BankVecEnv
from activetouch.envs.touch_bank import TouchBank
from activetouch.sensor import TactileSensor
from belief.policy_state import frame_probs
from belief.statistics import wilson_interval
from experiments.ppo.recipe import PPO_RECIPES
from experiments.ppo.training import TEST, TRAINING, make_bank

Floats32 = NDArray[np.float32]
Choose = Callable[[BankEpisodes], NDArray[np.int64]]

RECIPE = PPO_RECIPES["gains"]
SEES = ("images", "embeddings", "logits", "posterior")
CODE, BETA = 32, 0.1  # length of the trained code of one image, weight of the shaping reward


class _NoEvidence(BankEvidence):
    def _compute(self, *_: Any) -> None:
        """Learn nothing: for a learner that neither sees the belief nor is shaped by it; it costs no time."""


class SeenEpisodes(BankEpisodes):
    """Tests in which the policy observes what is ``seen`` of each touch, ``(N, R, P, D)``, instead of the belief."""

    def __init__(self, seen: Floats32, bank: TouchBank, model: Any, target: str, num_envs: int, beta: float) -> None:
        self._seen, self._memory = seen, np.zeros((num_envs, *seen.shape[2:]), np.float32)
        super().__init__(bank, model, target, num_envs, "gains", beta=beta)
        if not beta:
            self._evidence = _NoEvidence(bank, model, num_envs, self.touch_limit)

    def _touch(self, rows: NDArray[np.int64], poses: NDArray[np.int64]) -> None:
        rounds = (self._first_rounds[rows, poses] + self.uses[rows, poses]) % self.bank.num_rounds
        self._memory[rows, poses] = self._seen[self.objects[rows], rounds, poses]
        super()._touch(rows, poses)

    def begin(self, rows: NDArray[np.int64], *given: Any) -> None:
        """See :meth:`BankEpisodes.begin`."""
        self._memory[rows] = 0.0
        super().begin(rows, *given)

    def observe(self) -> Floats32:
        """Memory, uses of the poses n/(n + 1) and time, ``(B, P D + P + 1)``; in [-1, 1]."""
        memory, time = self._memory.reshape(self.num_envs, -1), self._num_touches[:, None] / self.touch_limit
        parts = [memory, self.uses / (1.0 + self.uses), time]
        return np.concatenate(parts, axis=1).astype(np.float32)


class ImageEncoder(BaseFeaturesExtractor):
    """Two dense layers from the image (H, W) of each pose to a code, the same for all; unused poses have the code 0."""

    def __init__(self, space: spaces.Box, image_shape: tuple[int, ...], num_poses: int) -> None:
        super().__init__(space, num_poses * (CODE + 1) + 1)
        layers = nn.Linear(int(np.prod(image_shape)), 64), nn.ReLU(), nn.Linear(64, CODE), nn.Tanh()
        self.network, self._num_poses = nn.Sequential(*layers), num_poses

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Codes, uses and time, ``(B, P (C + 1) + 1)``."""
        images, others = observations[:, : -self._num_poses - 1], observations[:, -self._num_poses - 1 :]
        codes = self.network(images.reshape(len(images), self._num_poses, -1))
        return torch.cat([(codes * (others[:, :-1, None] > 0.0)).flatten(1), others], dim=1)


def seen_in(bank: TouchBank, images: NDArray[np.uint8], sees: str) -> Floats32:
    """What a policy sees of each touch, ``(N, R, P, D)`` in [-1, 1]."""
    if sees == "images":
        return np.sqrt(images.reshape(*bank.logits.shape[:3], -1) / 255.0).astype(np.float32)
    if sees == "logits":
        return frame_probs(bank.logits).astype(np.float32)
    embeddings = np.asarray(bank.features, np.float32)
    return embeddings / np.abs(embeddings).max(axis=-1, keepdims=True)


def played(choose: Choose, episodes: BankEpisodes) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Success and touches ``(B,)`` of the tests of as many targets as others, each object once."""
    shapes, rows = episodes.bank.shapes, np.arange(episodes.num_envs)
    targets, others = (np.flatnonzero(mask) for mask in (shapes == episodes.targets[0], shapes != episodes.targets[0]))
    others = np.random.default_rng(0).permutation(others)[: len(targets)]
    episodes.begin(rows, np.concatenate([targets, others]))
    running, success, touches = np.ones(len(rows), np.bool_), np.zeros(len(rows), np.bool_), np.zeros(len(rows), int)
    while running.any():
        result = episodes.act(choose(episodes))
        success |= running & result.success
        touches = np.where(running, episodes.num_touches, touches)
        running &= ~(result.terminated | result.truncated)
    return success, touches


def information_gain(episodes: BankEpisodes) -> NDArray[np.int64]:
    """The rule of the shipped decider at a prior of one half: thresholds 0.99 and 0.01, the pose of most gain."""
    prob = np.exp(episodes.log_probs[:, episodes.targets[0]])
    has_to = episodes.num_touches >= episodes.touch_limit
    actions = np.asarray(episodes.situation().gains).argmax(axis=1)
    actions = np.where((prob <= 0.01) | (has_to & (prob < 0.5)), episodes.num_poses + 1, actions)
    return np.where((prob >= 0.99) | (has_to & (prob >= 0.5)), episodes.num_poses, actions)


def report(name: str, found: list[tuple[NDArray[np.bool_], NDArray[np.int64]]]) -> None:
    """Print one line: success of each seed with its interval, touches and return with its 95 % interval."""
    cells = []
    for success, touches in found:
        low, high = wilson_interval(int(success.sum()), len(success))
        returns = 2.0 * success - 1.0 - RECIPE.touch_cost * touches
        error = returns.std() / np.sqrt(len(returns))
        cells.append(f"success {success.mean():.3f} [{low:.3f}, {high:.3f}], {touches.mean():.2f} touches, ")
        cells[-1] += f"return {returns.mean():.3f} ± {1.96 * error:.3f}"
    for file in (sys.stdout, sys.stderr):  # the second tells of progress where the first is kept for a record
        print(f"{name}: {' | '.join(cells)}", file=file, flush=True)


def main(data: Path, target: str, steps: int, seeds: int) -> None:
    """Train and test all policies."""
    torch.set_num_threads(1)
    sensor = TactileSensor.shipped("coarse")
    banks = {split: make_bank(sensor.reader, data, split) for split in (TRAINING, TEST)}
    images = {split: read_split(data, split).images for split in banks}
    number = 2 * int((banks[TEST].shapes == banks[TEST].shape_labels.index(target)).sum())
    print(f"{banks[TRAINING].num_objects} objects to learn from, {number} tests, {target}, {steps} steps, β = {BETA}")

    def episodes_of(sees: str, split: str, num_envs: int, beta: float) -> BankEpisodes:
        if sees == "posterior":
            return BankEpisodes(banks[split], sensor.model, target, num_envs, "gains", beta=beta)
        seen = seen_in(banks[split], images[split], sees)
        return SeenEpisodes(seen, banks[split], sensor.model, target, num_envs, beta)

    untouched = episodes_of("logits", TEST, number, 0.0)
    report("no touch, always CONFIRM", [played(lambda now: np.full(number, now.num_poses), untouched)])
    report("information_gain", [played(information_gain, episodes_of("posterior", TEST, number, 0.0))])
    for sees in SEES:
        for weight in (0.0, BETA):
            found = []
            for seed in range(seeds):
                episodes = episodes_of(sees, TRAINING, RECIPE.num_envs, weight)
                learner = _learner(sees, episodes, seed, sensor.scene.image_shape).learn(steps)
                found.append(played(_choice(learner), episodes_of(sees, TEST, number, 0.0)))
            report(f"{sees}, {'shaped' if weight else 'not shaped'}", found)


def _learner(sees: str, episodes: BankEpisodes, seed: int, image_shape: tuple[int, ...]) -> PPO:
    network: dict[str, Any] = {"net_arch": list(RECIPE.hidden)}
    if sees == "images":
        network["features_extractor_class"] = ImageEncoder
        network["features_extractor_kwargs"] = {"image_shape": image_shape, "num_poses": episodes.num_poses}
    settings: dict[str, Any] = {"n_steps": RECIPE.rollout, "batch_size": RECIPE.batch_size, "n_epochs": RECIPE.epochs}
    settings |= {"ent_coef": RECIPE.entropy, "gamma": RECIPE.discount, "gae_lambda": RECIPE.gae}
    rate, envs = (lambda left: RECIPE.learning_rate * left), BankVecEnv(episodes, seed=[seed, 0])
    learner = PPO("MlpPolicy", envs, rate, policy_kwargs=network, seed=seed, device="cpu", **settings)
    learner.set_logger(Logger(folder=None, output_formats=[]))
    return learner


def _choice(learner: PPO) -> Choose:
    def choose(episodes: BankEpisodes) -> NDArray[np.int64]:
        with torch.no_grad():
            found: Any = learner.policy.get_distribution(torch.as_tensor(episodes.observe())).distribution
        return np.where(episodes.action_masks(), found.logits.numpy(), -np.inf).argmax(axis=1)

    return choose


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("build/coarse-repeats"))
    parser.add_argument("--target", default="cone")
    parser.add_argument("--steps", type=int, default=61_440, help="of each training, all environments together")
    parser.add_argument("--seeds", type=int, default=2)
    given = parser.parse_args()
    main(given.data, given.target, given.steps, given.seeds)
