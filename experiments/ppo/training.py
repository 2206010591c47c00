"""Training of one policy on a touch bank with Stable-Baselines3.

    FOLDER/policy.safetensors the finished policy, for :mod:`planners.ppo`
    FOLDER/training.json      its settings and learning curve

A finished training is read from its folder; an interrupted one starts again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.priors import TargetProb
from activetouch.envs.touch_bank import TouchBank
from activetouch.errors import TrainingDiverged
from belief.errors import ActiveTouchError, CorruptFile
from belief.files import array_digest, atomic_path, require_regular_file, sealed_json, unsealed_json, write_text
from belief.observation_model.model import ArrayModel
from belief.policy_state import WITH_GAINS
from experiments.ppo.recipe import PPORecipe
from planners.ppo import Policy, PolicyCard

if TYPE_CHECKING:
    from stable_baselines3 import PPO

POLICY, SETTINGS = "policy.safetensors", "training.json"
_EVALUATIONS = 12  # per training
_EPISODES = 2000  # per evaluation
_WEIGHED_EPISODES = 500  # the same where every touch is weighed by a joint model


class OtherTraining(ActiveTouchError, ValueError):
    """A folder holds a training with other settings."""


class Score(NamedTuple):
    """Score of a policy on a bank, with actions chosen as by :class:`planners.ppo.PPODecider`.

    Attributes:
        steps: number of training steps.
        mean_return: mean return per test, without shaping.
        success: fraction of right decisions.
        touches: mean number of touches per test.
    """

    steps: int
    mean_return: float
    success: float
    touches: float


@dataclass(frozen=True, eq=False)
class Training:
    """Training of one policy.

    Attributes:
        bank, test_bank: touches to learn from, and touches of other objects for evaluation.
        model: observation model that updates the belief.
        target: label of the shape sought; None for a policy of all shapes.
        recipe: settings of PPO and of the task.
        seed: seed of weights and episodes.
        folder: folder of the training.
        tensorboard: folder of logs for TensorBoard, each training's under the name of its folder; None for none.
    """

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

    def run(self) -> list[Score]:
        """Finish the training and return the learning curve on the test bank.

        Raises:
            OtherTraining: The folder holds a training with other settings.
            CorruptFile: A file of the folder is damaged.
            TrainingDiverged: Outputs of the policy are not finite.
        """
        curve = self._finished()
        if curve is None:
            with _global_generators_kept():
                curve = self._train()
            write_text(self.folder / SETTINGS, sealed_json({"settings": self._settings(), "curve": curve}) + "\n")
        return curve

    def _train(self) -> list[Score]:
        learner, every = self._learner(), self.recipe.steps / _EVALUATIONS
        curve: list[Score] = []

        def evaluate_now(steps: int) -> None:
            if not curve or steps > curve[-1].steps:
                tests = self._episodes(self.test_bank, self._evaluated, self.recipe.test_prob)
                curve.append(evaluate(policy_of(learner, self.card), tests, steps))

        def report(steps: int) -> None:
            if steps >= len(curve) * every:
                evaluate_now(steps)

        try:
            learner.learn(self.recipe.steps, _callback(report), tb_log_name=self.folder.name)
        except ValueError as error:
            if not str(error).startswith("Expected parameter logits"):  # of torch, where they are not finite
                raise
            raise TrainingDiverged(
                f"{self.folder}: after {learner.num_timesteps} steps the policy's outputs are not finite. Train with "
                "another seed or recipe, into another folder"
            ) from error
        evaluate_now(learner.num_timesteps)
        with atomic_path(self.folder / POLICY) as temporary:
            temporary.write_bytes(policy_of(learner, self.card).to_bytes())
        return curve

    def policy(self) -> Policy:
        """The finished policy."""
        return Policy.from_bytes((self.folder / POLICY).read_bytes())

    def score(self) -> Score:
        """Score of the finished policy on the objects and priors of its training, to choose among seeds."""
        episodes = self._episodes(self.bank, 2 * self._evaluated, self.recipe.target_prob)
        return evaluate(self.policy(), episodes, self.recipe.steps)

    @property
    def _evaluated(self) -> int:
        return _WEIGHED_EPISODES if self.recipe.state in WITH_GAINS else _EPISODES

    def _episodes(self, bank: TouchBank, num_envs: int, target_prob: TargetProb, *shaping: float) -> BankEpisodes:
        recipe = self.recipe
        task = (recipe.touch_cost, recipe.touch_limit, target_prob)
        return BankEpisodes(bank, self.model, self.target, num_envs, recipe.state, *task, *shaping)

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
            learning_rate=lambda left: recipe.learning_rate * left,
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

    def _finished(self) -> list[Score] | None:
        """The learning curve of the finished training in the folder; None if there is none."""
        path, now = self.folder / SETTINGS, self._settings()
        if not path.is_file():
            return None
        try:
            fields = unsealed_json(require_regular_file(path).read_text(encoding="utf-8"))
            settings, curve = fields["settings"], [Score(*point) for point in fields["curve"]]
            policy = self.policy()
        except (CorruptFile, OSError, ValueError, KeyError, TypeError) as error:
            raise CorruptFile(f"{self.folder}: {error}; delete this folder and start again") from error
        if settings != now:
            other = [name for name in {**settings, **now} if settings.get(name) != now.get(name)]
            raise OtherTraining(
                f"{self.folder} holds a training with other settings ({', '.join(other)}): {settings}; name another "
                "--out"
            )
        assert policy.card == self.card, "which follows from the settings"
        return curve

    def _settings(self) -> dict[str, Any]:
        """Everything that policy and curve depend on, as JSON types."""
        settings = {"recipe": asdict(self.recipe), "target": self.target, "seed": self.seed}
        banks = {"bank": self.bank, "test bank": self.test_bank}
        digests = {name: array_digest({"logits": bank.logits, "shapes": bank.shapes}) for name, bank in banks.items()}
        if self.recipe.state in WITH_GAINS:
            features = {name: bank.features for name, bank in banks.items() if bank.features is not None}
            digests["features"] = array_digest(features)
        model = hashlib.sha256(self.model.to_json().encode()).hexdigest()
        return json.loads(json.dumps({**settings, **digests, "observation model": model}))


def evaluate(policy: Policy, episodes: BankEpisodes, steps: int = 0, seed: int = 1) -> Score:
    """Score of a policy that takes its most probable action, and must decide at the touch limit."""

    def choose(now: BankEpisodes) -> NDArray[np.int64]:
        return np.where(now.action_masks(), policy.scores(now.observe()), -np.inf).argmax(axis=1)

    return play(choose, episodes, steps, seed)


def play(
    choose: Callable[[BankEpisodes], NDArray[np.int64]], episodes: BankEpisodes, steps: int = 0, seed: int = 1
) -> Score:
    """Play one episode per row and return the mean score.

    Args:
        choose: function from the episodes to actions ``(B,)``.
        episodes: B episodes; they are reset first.
        steps: number of training steps, for the score.
        seed: seed of the episodes.
    """
    rng, rows = np.random.default_rng(seed), np.arange(episodes.num_envs)
    episodes.reset(rows, rng)
    running, returns = np.ones(len(rows), np.bool_), np.zeros(len(rows))
    success, touches = np.zeros(len(rows), np.bool_), np.zeros(len(rows), np.int64)
    while running.any():
        result = episodes.step(choose(episodes))
        returns += np.where(running, result.reward, 0.0)
        success |= running & result.success
        touches = np.where(running, episodes.num_touches, touches)
        running &= ~(result.terminated | result.truncated)
    return Score(steps, float(returns.mean()), float(success.mean()), float(touches.mean()))


def policy_of(learner: PPO, card: PolicyCard) -> Policy:
    """Convert the policy network of a Stable-Baselines3 learner to numpy.

    Args:
        learner: a PPO with an ``MlpPolicy`` of tanh units.
        card: card of the policy.
    """
    from torch import nn

    layers = [*learner.policy.mlp_extractor.policy_net, learner.policy.action_net]
    linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
    arrays: list[tuple[NDArray[np.float32], ...]] = [
        tuple(getattr(layer, name).detach().numpy().astype(np.float32).copy() for layer in linear)
        for name in ("weight", "bias")
    ]
    return Policy(card, *arrays)


def _callback(report: Callable[[int], None]) -> Any:
    """A callback that reports the finished steps before every rollout, between two updates."""
    from stable_baselines3.common.callbacks import BaseCallback

    class Report(BaseCallback):
        def _on_rollout_start(self) -> None:
            report(self.num_timesteps)

        def _on_step(self) -> bool:
            return True

    return Report()


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
