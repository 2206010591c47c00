"""Train one policy on a touch bank with Stable-Baselines3, in a folder from which it goes on after an interruption.

    FOLDER/checkpoint.zip     the learner as SB3 saves it: ``PPO.load`` reads it, and trusts it as any pickle
    FOLDER/progress.json      settings, steps done, learning curve
    FOLDER/policy.safetensors once finished, what :mod:`planners.ppo` reads

Going on reads weights only, and runs no code from the checkpoint. Its chance is keyed by the steps done, so an
interrupted training ends with another policy than one in a single piece would.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.envs.bank import TouchBank
from activetouch.envs.episodes import BankEpisodes
from activetouch.envs.priors import TargetProb
from activetouch.errors import MissingPackage
from belief.errors import ActiveTouchError, CorruptFile
from belief.files import atomic_path, write_text
from belief.observation_model import ArrayModel
from experiments.ppo_recipe import PPORecipe
from planners.ppo import Policy, PolicyCard

if TYPE_CHECKING:
    from stable_baselines3 import PPO

CHECKPOINT, PROGRESS, POLICY = "checkpoint.zip", "progress.json", "policy.safetensors"
_EVALUATIONS = 12  # of a training
_EPISODES = 2000  # of an evaluation


class OtherTraining(ActiveTouchError, ValueError):
    """A folder holds a training with other settings."""


class Score(NamedTuple):
    """How good a policy is on a bank, deciding as :class:`planners.ppo.PPODecider` does.

    Attributes:
        steps: of training.
        mean_return: of a test, without shaping.
        success: share of right decisions.
        touches: of a test.
    """

    steps: int
    mean_return: float
    success: float
    touches: float


@dataclass(frozen=True, eq=False)
class Training:
    """One policy to be trained.

    Attributes:
        bank, test_bank: touches to learn from, and of other objects to be measured on.
        model: turns touches into evidence.
        target: label of the shape sought.
        recipe: how.
        seed: of weights and episodes.
        folder: where it is kept.
    """

    bank: TouchBank
    test_bank: TouchBank
    model: ArrayModel
    target: str
    recipe: PPORecipe
    seed: int
    folder: Path

    @property
    def card(self) -> PolicyCard:
        """Of the policy."""
        labels, summary = (self.bank.shape_labels, self.bank.pose_labels), f"{self.recipe}, seed {self.seed}"
        return PolicyCard(self.recipe.state, self.target, *labels, self.recipe.touch_limit, summary)

    def run(self) -> list[Score]:
        """Train what is left and return the learning curve on the test bank."""
        done, curve = self._read_progress()
        if (self.folder / POLICY).is_file() and done >= self.recipe.steps:
            return curve
        learner = self._learner(done)
        every = self.recipe.steps / _EVALUATIONS

        def report(steps: int) -> None:
            if not curve or (steps > curve[-1].steps and steps >= len(curve) * every):
                policy = policy_of(learner, self.card)
                curve.append(evaluate(policy, self._episodes(self.test_bank, _EPISODES, self.recipe.test_prob), steps))
                with atomic_path(self.folder / CHECKPOINT) as temporary:
                    learner.save(temporary)
                self._write_progress(steps, curve)

        learner.learn(self.recipe.steps - done, _callback(report), reset_num_timesteps=False, tb_log_name=self.target)
        every = 0.0  # the last point is always on the curve
        report(learner.num_timesteps)
        with atomic_path(self.folder / POLICY) as temporary:
            temporary.write_bytes(policy_of(learner, self.card).to_bytes())
        return curve

    def score(self) -> Score:
        """Of the finished policy on the objects and priors that it learned from: to choose among seeds."""
        policy = Policy.from_bytes((self.folder / POLICY).read_bytes())
        return evaluate(policy, self._episodes(self.bank, 2 * _EPISODES, self.recipe.target_prob), self.recipe.steps)

    def _episodes(self, bank: TouchBank, num_envs: int, target_prob: TargetProb) -> BankEpisodes:
        recipe = self.recipe
        task = (recipe.touch_cost, recipe.touch_limit, target_prob)
        return BankEpisodes(bank, self.model, self.target, num_envs, recipe.state, *task)

    def _learner(self, done: int) -> PPO:
        """The learner, new or as it was after so many steps."""
        from activetouch.envs.sb3 import BankVecEnv

        recipe = self.recipe
        kind = _learner_class(recipe.masked)
        task = (recipe.touch_cost, recipe.touch_limit, recipe.target_prob)
        episodes = BankEpisodes(
            self.bank, self.model, self.target, recipe.num_envs, recipe.state, *task, recipe.beta, recipe.discount
        )
        learner = kind(
            "MlpPolicy",
            BankVecEnv(episodes, seed=[self.seed, done]),
            n_steps=recipe.rollout,
            batch_size=recipe.batch_size,
            n_epochs=recipe.epochs,
            learning_rate=lambda left: recipe.learning_rate * left,
            ent_coef=recipe.entropy,
            gamma=recipe.discount,
            gae_lambda=recipe.gae,
            policy_kwargs={"net_arch": list(recipe.hidden)},
            tensorboard_log=str(self.folder / "tensorboard") if _has_tensorboard() else None,
            seed=self.seed,
            device="cpu",
        )
        if done:
            learner.set_parameters(str(self.folder / CHECKPOINT))
            learner.num_timesteps = done
        return learner

    def _read_progress(self) -> tuple[int, list[Score]]:
        path = self.folder / PROGRESS
        if not path.is_file():
            return 0, []
        try:
            progress = json.loads(path.read_text())
            settings, curve = progress["settings"], [Score(*point) for point in progress["curve"]]
            steps = int(progress["steps"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise CorruptFile(f"{path} is damaged ({error}); delete {self.folder} and start again") from error
        if settings != self._settings():
            raise OtherTraining(f"{self.folder} holds a training with other settings: {settings}; name another --out")
        return steps, curve

    def _write_progress(self, steps: int, curve: list[Score]) -> None:
        progress = {"settings": self._settings(), "steps": steps, "curve": curve}
        write_text(self.folder / PROGRESS, json.dumps(progress, indent=1) + "\n")

    def _settings(self) -> dict[str, Any]:
        """All that decides the policy, as JSON types."""
        settings = {"recipe": asdict(self.recipe), "target": self.target, "seed": self.seed}
        return json.loads(json.dumps({**settings, "bank": dict(self.bank.source)}))


def evaluate(policy: Policy, episodes: BankEpisodes, steps: int = 0, seed: int = 1) -> Score:
    """:func:`play` a policy that does what it finds best, and has to decide at the touch limit."""

    def choose(now: BankEpisodes) -> NDArray[np.int64]:
        return np.where(now.action_masks(), policy.scores(now.observe()), -np.inf).argmax(axis=1)

    return play(choose, episodes, steps, seed)


def play(
    choose: Callable[[BankEpisodes], NDArray[np.int64]], episodes: BankEpisodes, steps: int = 0, seed: int = 1
) -> Score:
    """Play one episode in every row, the actions ``(B,)`` chosen by a function of them all."""
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
    """The policy network of a learner of Stable-Baselines3, for numpy.

    Args:
        learner: a PPO or MaskablePPO with an ``MlpPolicy`` of tanh units; to take one from a file, ``PPO.load`` it.
        card: what it was trained for.
    """
    from torch import nn

    layers = [*learner.policy.mlp_extractor.policy_net, learner.policy.action_net]
    linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
    arrays: list[tuple[NDArray[np.float32], ...]] = [
        tuple(getattr(layer, name).detach().numpy().astype(np.float32).copy() for layer in linear)
        for name in ("weight", "bias")
    ]
    return Policy(card, *arrays)


def _learner_class(masked: bool) -> type[PPO]:
    if not masked:
        from stable_baselines3 import PPO

        return PPO
    try:
        from sb3_contrib import MaskablePPO
    except ImportError as error:
        raise MissingPackage("masked recipes need sb3-contrib: pip install activetouch[contrib]") from error
    return MaskablePPO


def _callback(report: Callable[[int], None]) -> Any:
    """A callback that reports the steps done before every rollout, when weights and optimiser are settled."""
    from stable_baselines3.common.callbacks import BaseCallback

    class Report(BaseCallback):
        def _on_rollout_start(self) -> None:
            report(self.num_timesteps)

        def _on_step(self) -> bool:
            return True

    return Report()


def _has_tensorboard() -> bool:
    from importlib.util import find_spec

    return find_spec("tensorboard") is not None
