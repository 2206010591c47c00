"""A zoo of learning agents for `activetouch benchmark`: each is one policy for all targets, trained by one command.

activetouch collect --scene coarse --plan.train 0 --plan.repeats 6 --out data/coarse-repeats
python zoo.py ppo                     (writes runs/zoo/ppo-0.zip; the extras contrib and train)
activetouch benchmark --task coarse-v1 --agent sb3:runs/zoo/ppo-0.zip --out ppo-0.jsonl.gz

Agents learn from the touches of the first line, which takes two minutes. ppo, maskable_ppo and dqn observe the belief
and the expected information of each pose; recurrent_ppo observes what the classifier says of each touch alone, and its
LSTM remembers; images_frozen, images_tuned and images_new observe images (image_policy.py plays them). These four learn
with the paper's shaping reward, from a belief that they do not see; the sensor of keyed-v1 has no model for that.

python zoo.py ppo --task gel-v1       (writes runs/zoo-gel-v1/ppo-0.zip)

The first line for another task has the name of its scene, as --scene gel and --out data/gel-repeats, and fewer objects,
as many or large images take disk: --plan.calibration 200 --plan.test 100 for gel and paper, 100 and 50 for hard, many
and keyed.

python zoo.py ppo dqn --seeds 0 1     (two of each)
python zoo.py dqn --study 4          (varies settings with Optuna, `pip install optuna`; adds to runs/zoo/study.csv)

`--tensorboard FOLDER` writes logs; for Weights & Biases, give `learn` the callback of `wandb.integration.sb3`.
"""

import argparse
import csv
import os
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # threads wait for each other in matrices so small

import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from image_policy import Encoder, ImageEpisodes
from numpy.typing import NDArray

from activetouch.data.dataset import read_split
from activetouch.data.manifest import read_manifest
from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.sb3 import BankVecEnv
from activetouch.named_scenes import SCENES
from activetouch.scene_description import require_scene, scene_fields
from activetouch.sensor_files import fitted_model
from experiments.command_line.arguments import BadArgument
from experiments.ppo.training import TEST, TRAINING, Score, kept_bank, play
from experiments.search.benchmark.cards import Card

PPO = {"learning_rate": 3e-3, "ent_coef": 0.003, "n_epochs": 10, "n_steps": 16, "batch_size": 512, "gae_lambda": 0.95}
SMALL = {"net_arch": [64, 64]}
NUM_TESTS, TEST_PROB = 1000, 0.3
"""Tests of an agent on other objects than those of its training, and the prior of the target in them."""
STUDIED = {
    "learning_rate": (3e-4, 1e-2),
    "ent_coef": (3e-4, 3e-2),
    "n_epochs": (3, 12),
    "gradient_steps": (16, 128),
    "exploration_fraction": (0.1, 0.6),
    "target_update_interval": (256, 16384),
}
"""Ranges of settings that a study searches, each on a logarithmic scale."""


@dataclass(frozen=True)
class Learner:
    """How one agent learns.

    Attributes:
        algorithm: a class of Stable-Baselines3 or sb3-contrib, with its policy.
        sees: "gains", "paper" or "images".
        steps: of all environments together, in a task of four shapes; one of more has twice as many.
        settings: arguments of the algorithm; a study varies those in :data:`STUDIED`.
        network: the argument ``policy_kwargs``.
        target_prob: prior of the target, or its range; by default a range that fits the task. At 0.3, learners without
            a belief reject untouched objects.
        num_envs: tests at once.
        beta: weight of the paper's shaping reward.
    """

    algorithm: Any
    policy: str
    sees: str
    steps: int
    settings: dict[str, Any]
    network: dict[str, Any] = field(default_factory=lambda: SMALL)
    target_prob: float | tuple[float, float] | None = None
    num_envs: int = 128
    beta: float = 0.0

    def for_task(self, card: Card) -> "Learner":
        """The same, with the steps and the priors for a task.

        Of n objects, each is the target with a probability of 1/n at first. An agent that learned from much higher
        priors would reject the target too often.
        """
        prob, number = self.target_prob, card.num_objects
        steps = self.steps * (2 if card.problem.num_shapes > 4 else 1)
        return replace(self, steps=steps, target_prob=(0.2 / number, 3.8 / number) if prob is None else prob)


def _images(steps: int, learning_rate: float, **encoder: bool) -> Learner:
    network = {"features_extractor_class": Encoder, "features_extractor_kwargs": encoder, **SMALL}
    settings = PPO | {"n_epochs": 5, "ent_coef": 0.008, "learning_rate": learning_rate}
    return Learner(stable_baselines3.PPO, "MlpPolicy", "images", steps, settings, network, 0.5, beta=0.2)


ZOO = {
    "ppo": Learner(stable_baselines3.PPO, "MlpPolicy", "gains", 100_000, PPO),
    "maskable_ppo": Learner(sb3_contrib.MaskablePPO, "MlpPolicy", "gains", 100_000, PPO),
    "recurrent_ppo": Learner(
        sb3_contrib.RecurrentPPO,
        "MlpLstmPolicy",
        "paper",
        300_000,
        PPO | {"n_epochs": 5, "n_steps": 32, "batch_size": 1024, "ent_coef": 0.008},
        {"lstm_hidden_size": 64, "net_arch": [64]},
        0.5,
        beta=0.2,
    ),
    "dqn": Learner(
        stable_baselines3.DQN,
        "MlpPolicy",
        "gains",
        100_000,
        {
            "learning_rate": 2e-3,
            "train_freq": 2,
            "gradient_steps": 70,
            "batch_size": 256,
            "buffer_size": 200_000,
            "learning_starts": 5_000,
            "target_update_interval": 2500,
            "exploration_fraction": 0.3,
            "exploration_final_eps": 0.03,
        },
    ),
    "images_frozen": _images(200_000, 2e-3, frozen=True),
    "images_tuned": _images(100_000, 1.5e-3),
    "images_new": _images(100_000, 1.5e-3, new=True),
}


def scene_of(card: Card) -> str:
    """Name of the scene of a task; a task in a tray has none."""
    return str(card.setting.get("choice", {}).get("scene"))


TASKS = {card.name: card for card in Card.every() if scene_of(card) in SCENES}


class Tests:
    """Tests of single objects on the touches of one split of a collection from the scene of a task.

    Raises:
        WrongScene: the collection is of another scene.
        BadArgument: its objects have the seed of the task.
    """

    def __init__(self, card: Card, data: Path, split: str) -> None:
        manifest, sensor = read_manifest(data), card.rules.open_sensor()
        require_scene(f"the collection {data}", manifest.scene, scene_fields(sensor.scene))
        if manifest.plan.seed == card.seed:
            raise BadArgument(
                f"{data} has the seed of {card.name}: collect it with another --plan.seed than {card.seed}"
            )
        self.bank = kept_bank(sensor.reader, data, split, data.parent / f"{scene_of(card)}-zoo-bank" / split)
        self._joint, self.card, self._data, self._split = sensor.model, card, data, split

    def episodes(self, learner: Learner, num_envs: int, **settings: Any) -> BankEpisodes:
        """Many tests at once, of what a learner sees."""
        settings = {"touch_cost": self.card.rules.touch_cost, **settings}
        if learner.sees == "gains":
            return BankEpisodes(self.bank, self._joint, None, num_envs, "goal", **settings)
        single = fitted_model(self.card.rules.sensor_folder, independent=True).model
        task = self.bank, single, None, num_envs, "paper"
        if learner.sees == "paper":
            return BankEpisodes(*task, **settings)
        images = read_split(self._data, self._split).images
        felt = images.reshape(*self.bank.logits.shape[:3], *images.shape[1:]) / np.float32(255.0)
        return ImageEpisodes(felt, *task, **settings)


def train(learner: Learner, tests: Tests, seed: int, tensorboard: str | None = None) -> Any:
    """A trained model."""
    settings, network = dict(learner.settings), dict(learner.network)
    rate = settings.pop("learning_rate")
    if learner.sees == "images":
        network["features_extractor_kwargs"] = {"sensor": scene_of(tests.card), **network["features_extractor_kwargs"]}
    episodes = tests.episodes(learner, learner.num_envs, target_prob=learner.target_prob, beta=learner.beta)
    model = learner.algorithm(
        learner.policy,
        BankVecEnv(episodes, seed),
        learning_rate=lambda left: rate * max(left, 0.0),  # the last rollout may end later than the steps
        gamma=1.0,
        policy_kwargs=network,
        seed=seed,
        device="cpu",
        tensorboard_log=tensorboard,
        **settings,
    )
    if learner.sees == "images":
        model.policy.features_extractor.begin()
    return model.learn(learner.steps)


def score(model: Any, episodes: BankEpisodes) -> Score:
    """Mean score of a model that must decide at the touch limit, by the belief."""
    memory, begins = None, np.ones(episodes.num_envs, np.bool_)

    def choose(now: BankEpisodes) -> NDArray[np.int64]:
        nonlocal memory
        actions, memory = model.predict(now.observe(), memory, begins, deterministic=True)
        begins[:] = False
        answers = np.where(now.infos(begins)["target_prob"] < 0.5, now.num_poses + 1, now.num_poses)
        return np.where(now.action_masks()[np.arange(len(actions)), actions], actions, answers)

    return play(choose, episodes)


def study(name: str, learner: Learner, tests: Tests, others: Tests, given: argparse.Namespace) -> None:
    """Let Optuna vary the settings of a learner in shorter trainings; add a row for each to a CSV file."""
    import optuna

    log = given.out / "study.csv"
    varied = [setting for setting in STUDIED if setting in learner.settings]

    def trial_return(trial: Any) -> float:
        started = time.process_time()
        found = {}
        for setting in varied:
            low, high = STUDIED[setting]
            suggest = trial.suggest_int if isinstance(low, int) else trial.suggest_float
            found[setting] = suggest(setting, low, high, log=True)
        short = replace(learner, settings=learner.settings | found, steps=int(given.share * learner.steps))
        reached = score(train(short, tests, 0), others.episodes(learner, NUM_TESTS, target_prob=TEST_PROB))
        row = [name, trial.number, short.steps, f"{time.process_time() - started:.0f}", f"{reached.mean_return:.4f}"]
        cells = [f"{found[setting]:.4g}" if setting in found else "" for setting in STUDIED]
        begun = log.exists()
        with log.open("a", newline="", encoding="utf-8") as file:
            if not begun:
                csv.writer(file).writerow(["agent", "trial", "steps", "seconds", "return", *STUDIED])
            csv.writer(file).writerow(row + cells)
        return reached.mean_return

    found = optuna.create_study(direction="maximize", sampler=optuna.samplers.TPESampler(seed=0, n_startup_trials=4))
    found.enqueue_trial({setting: learner.settings[setting] for setting in varied})
    found.optimize(trial_return, given.study)
    print(found.best_value, found.best_params)


def main() -> None:
    """Train agents, or search for the settings of one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", choices=ZOO, metavar="NAME", help=", ".join(ZOO))
    parser.add_argument("--task", choices=TASKS, default="coarse-v1")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--steps", type=int, help="of all environments together, in place of the agent's own")
    parser.add_argument("--data", type=Path, help="data/SCENE-repeats by default")
    parser.add_argument("--out", type=Path, help="runs/zoo by default, and runs/zoo-TASK for another task")
    parser.add_argument("--tensorboard")
    parser.add_argument("--study", type=int, metavar="TRIALS", help="search for settings, in so many trainings")
    parser.add_argument("--share", type=float, default=0.3, help="length of such a training")
    given = parser.parse_args()
    torch.set_num_threads(1)
    card = TASKS[given.task]
    if card.seed in given.seeds:
        parser.error(f"--seeds: {card.seed} is the seed of {card.name}")
    data = given.data or Path("data", f"{scene_of(card)}-repeats")
    given.out = given.out or Path("runs", "zoo" if given.task == parser.get_default("task") else f"zoo-{given.task}")
    tests, others = Tests(card, data, TRAINING), Tests(card, data, TEST)
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.names:
        learner = ZOO[name].for_task(card)
        learner = replace(learner, steps=given.steps or learner.steps)
        if given.study:
            study(name, learner, tests, others, given)
            continue
        for seed in given.seeds:
            started = time.process_time()
            model = train(learner, tests, seed, given.tensorboard)
            minutes, path = (time.process_time() - started) / 60.0, given.out / f"{name}-{seed}.zip"
            model.save(path)
            found = score(model, others.episodes(learner, NUM_TESTS, target_prob=TEST_PROB))
            numbers = f"return {found.mean_return:.3f}, success {found.success:.3f}, {found.touches:.2f} touches"
            print(f"{path}: {numbers} on test objects; {minutes:.1f} minutes of processor time", flush=True)


if __name__ == "__main__":
    main()
