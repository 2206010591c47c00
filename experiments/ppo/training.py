"""Training of one policy with Stable-Baselines3, on recorded touches as a reader reads them.

A finished training is read from its file, OUT/trainings/STATE-TARGET-SEED-DIGEST.safetensors, whose digest is of all
that determines it; an interrupted one starts again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.data.dataset import read_split
from activetouch.data.manifest import read_manifest
from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.touch_bank import MANIFEST, TouchBank
from activetouch.envs.touch_source import TargetProb
from activetouch.errors import TrainingDiverged
from activetouch.perception.reader import TactileReader
from belief.files import array_digest, in_file_name
from belief.observation_model.model import ArrayModel
from belief.policy_state import WITH_GAINS
from experiments.ppo.recipe import PPORecipe
from experiments.sensor.scores import readings
from planners.ppo import BadPolicy, Policy, PolicyCard

if TYPE_CHECKING:
    from stable_baselines3 import PPO

TRAINING, TEST = "calibration", "test"
"""Splits of the collection for training and for evaluation of policies."""
ALL = "all"
"""Stands for the target of a policy for all of them."""
_EPISODES = 2000  # per evaluation
_WEIGHED_EPISODES = 500  # the same where every touch is weighed by a joint model


class Score(NamedTuple):
    """Means per test of a policy that acts as :class:`planners.ppo.PPODecider`, the return without shaping."""

    mean_return: float
    success: float
    touches: float


@dataclass(frozen=True, eq=False)
class Training:
    """Training of one policy, for a target or (None) for all; ``test_bank`` has other objects than ``bank``."""

    bank: TouchBank
    test_bank: TouchBank
    model: ArrayModel
    target: str | None
    recipe: PPORecipe
    seed: int
    folder: Path
    tensorboard: Path | None = None

    @property
    def card(self) -> PolicyCard:
        """Card of the policy."""
        labels, summary = (self.bank.shape_labels, self.bank.pose_labels), f"{self.recipe}, seed {self.seed}"
        return PolicyCard(self.recipe.state, self.target or "", *labels, self.recipe.touch_limit, summary)

    @cached_property
    def path(self) -> Path:
        """File of the finished policy."""
        determined = {**asdict(self.recipe), "target": self.target, "seed": self.seed}
        for name, bank in (("bank", self.bank), ("test", self.test_bank)):
            arrays = {"logits": bank.logits, "shapes": bank.shapes}
            if self.recipe.state in WITH_GAINS and bank.features is not None:
                arrays["features"] = bank.features
            determined[name] = array_digest(arrays)
        told = json.dumps(determined, sort_keys=True) + self.model.to_json()
        name = f"{self.recipe.state}-{in_file_name(self.target or ALL, '-')}-{self.seed}"
        return self.folder / f"{name}-{hashlib.sha256(told.encode()).hexdigest()[:8]}.safetensors"

    def run(self) -> tuple[Policy, Score]:
        """Finish the training, and score the policy on the test bank."""
        if not self.path.exists():
            with _global_generators_kept():
                trained = self._train()
            trained.save(self.path)
        try:
            policy = Policy.load(self.path)
        except BadPolicy as error:
            raise BadPolicy(f"{error}; delete it and start again") from error
        tests = self._episodes(self.test_bank, self._evaluated, self.recipe.test_prob)
        return policy, evaluate(policy, tests)

    def _train(self) -> Policy:
        learner = self._learner()
        try:
            learner.learn(self.recipe.steps, tb_log_name=self.path.stem)
        except ValueError as error:
            if not str(error).startswith("Expected parameter logits"):  # of torch, where they are not finite
                raise
            raise TrainingDiverged(
                f"{self.path.stem}: after {learner.num_timesteps} steps the policy's outputs are not finite. Train "
                "with another seed or recipe"
            ) from error
        return policy_of(learner, self.card)

    def mean_return(self, policy: Policy) -> float:
        """Mean return of the finished policy on the objects and priors of its training, to choose among seeds."""
        return evaluate(policy, self._episodes(self.bank, 2 * self._evaluated, self.recipe.target_prob)).mean_return

    @property
    def _evaluated(self) -> int:
        return _WEIGHED_EPISODES if self.recipe.state in WITH_GAINS else _EPISODES

    def _episodes(
        self, bank: TouchBank, num_envs: int, target_prob: TargetProb, beta: float = 0.0, discount: float = 1.0
    ) -> BankEpisodes:
        recipe = self.recipe
        task = (recipe.touch_cost, recipe.touch_limit, target_prob, beta, discount)
        return BankEpisodes(bank, self.model, self.target, num_envs, recipe.state, *task)

    def _learner(self) -> PPO:
        """A new learner."""
        from stable_baselines3 import PPO
        from stable_baselines3.common.logger import Logger

        from activetouch.envs.sb3 import BankVecEnv

        recipe = self.recipe
        episodes = self._episodes(self.bank, recipe.num_envs, recipe.target_prob, recipe.beta, recipe.discount)
        learner = PPO(
            "MlpPolicy",
            BankVecEnv(episodes, seed=[self.seed, 0]),
            n_steps=recipe.rollout,
            batch_size=recipe.batch_size,
            n_epochs=recipe.epochs,
            learning_rate=lambda left: recipe.learning_rate * max(left, 0.0),  # the last steps may be beyond the end
            ent_coef=recipe.entropy,
            gamma=recipe.discount,
            gae_lambda=recipe.gae,
            policy_kwargs={"net_arch": list(recipe.hidden)},
            tensorboard_log=None if self.tensorboard is None else str(self.tensorboard),
            seed=self.seed,
            device="cpu",
        )
        if learner.tensorboard_log is None:
            learner.set_logger(Logger(folder=None, output_formats=[]))  # SB3's default makes a temporary folder
        return learner


def evaluate(policy: Policy, episodes: BankEpisodes, seed: int = 1) -> Score:
    """Score of a policy that takes its most probable action, and must decide at the touch limit."""

    def choose(now: BankEpisodes) -> NDArray[np.int64]:
        return np.where(now.action_masks(), policy.scores(now.observe()), -np.inf).argmax(axis=1)

    return play(choose, episodes, seed)


def play(choose: Callable[[BankEpisodes], NDArray[np.int64]], episodes: BankEpisodes, seed: int = 1) -> Score:
    """Reset B episodes, play them with the actions ``(B,)`` of a function, and return the mean score."""
    rng, rows = np.random.default_rng(seed), np.arange(episodes.num_envs)
    episodes.restart(rows, rng)
    running, returns = np.ones(len(rows), np.bool_), np.zeros(len(rows))
    success, touches = np.zeros(len(rows), np.bool_), np.zeros(len(rows), np.int64)
    while running.any():
        result = episodes.act(choose(episodes))
        returns += np.where(running, result.reward, 0.0)
        success |= running & result.success
        touches = np.where(running, episodes.num_touches, touches)
        running &= ~(result.terminated | result.truncated)
    return Score(float(returns.mean()), float(success.mean()), float(touches.mean()))


def policy_of(learner: PPO, card: PolicyCard) -> Policy:
    """Convert the network of a Stable-Baselines3 learner, an ``MlpPolicy`` of tanh units, to numpy."""
    from torch import nn

    layers = [*learner.policy.mlp_extractor.policy_net, learner.policy.action_net]
    linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
    arrays: list[tuple[NDArray[np.float32], ...]] = [
        tuple(getattr(layer, name).detach().numpy().astype(np.float32).copy() for layer in linear)
        for name in ("weight", "bias")
    ]
    return Policy(card, *arrays)


@contextmanager
def _global_generators_kept() -> Iterator[None]:
    """Restore the global generators, which Stable-Baselines3 seeds and draws from, afterwards."""
    import torch

    before = np.random.get_state()  # noqa: NPY002
    try:
        with torch.random.fork_rng(devices=[]):
            yield
    finally:
        np.random.set_state(before)  # noqa: NPY002


def make_bank(reader: TactileReader, data: Path, split: str) -> TouchBank:
    """Read the touches of a collection with repeated touches.

    Args:
        reader: reader of the touches, which was not trained on these objects.
        data: folder of the collection.
        split: split of the collection, such as :data:`TRAINING`.
    """
    manifest, touches = read_manifest(data), read_split(data, split)
    logits, features = [], []
    for reading in readings(reader, touches.images, f"reading {split} touches"):
        logits.append(reading.logits.astype(np.float32))
        features.append(reading.embeddings.astype(np.float16))
    by_object = (len(np.unique(touches.object_ids)), manifest.plan.repeats, len(manifest.pose_labels), -1)
    return TouchBank(
        np.concatenate(logits).reshape(by_object),
        touches.shapes.reshape(by_object[:3])[:, 0, 0],
        manifest.shape_labels,
        manifest.pose_labels,
        np.concatenate(features).reshape(by_object),
        _source(reader, data, split),
        manifest.scene,
    )


def kept_bank(reader: TactileReader, data: Path, split: str, folder: Path) -> TouchBank:
    """The bank in a folder, made there unless it has the bank of the same collection and reader already."""
    if (folder / MANIFEST).is_file():
        found = TouchBank.open(folder)
        if dict(found.source) == _source(reader, data, split):
            return found
    make_bank(reader, data, split).save(folder)
    return TouchBank.open(folder)


def _source(reader: TactileReader, data: Path, split: str) -> dict[str, Any]:
    return {"collection": read_manifest(data).identity, "split": split, "classifier": reader.card.training}
