"""A scene's sensor and its PPO policies from nothing: press, train, press again and again, calibrate, train policies.

Each stage leaves a file when it is done and is not begun again; a stage that was killed goes on where its own command
does: after the last shard, the last epoch, the last training of a policy.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from activetouch.envs.touch_bank import MANIFEST
from activetouch.world import CLASSIFIER_FILE, OBSERVATION_FILE, POLICIES
from experiments.command_line.arguments import Count
from experiments.command_line.collection_arguments import PlanArguments
from experiments.ppo.touch_bank import TEST, MakeTouchBank
from experiments.ppo.train_ppo import PPOChanges, TrainPPO
from experiments.scene_choice import SceneChoice
from experiments.sensor.calibrate import Calibrate
from experiments.sensor.collect import collect
from experiments.sensor.train import Changes, Train


@dataclass(frozen=True)
class Effort:
    """How much goes into a sensor and its policies."""

    touches: PlanArguments = field(default_factory=lambda: PlanArguments(train=1500))
    """Objects of each shape that the classifier learns from."""
    repeats: PlanArguments = field(default_factory=lambda: PlanArguments(train=0, repeats=6))
    """Objects that the observation model and the policies learn from."""
    change: Changes = field(default_factory=lambda: Changes(epochs=6, batch_size=128))
    """What to change about the recipe ``large`` of the classifier."""
    ppo: PPOChanges = field(default_factory=PPOChanges)
    """What to change about the recipes of PPO."""
    ppo_seeds: Count = 3
    """Trainings of each policy, of which the best is kept."""


def sensor_from_nothing(scene: str, effort: Effort, folder: Path, jobs: int) -> Path:
    """The folder of a sensor with its policies, made as far as it is not there.

    Args:
        scene: name of the scene.
        effort: how much.
        folder: for all that is made on the way.
        jobs: processes.
    """
    choice, sensor, trained, bank = SceneChoice(scene), folder / "sensor", folder / "trained", folder / "bank"
    repeats, policies = folder / "repeats", sensor / POLICIES
    stages: list[tuple[Path, Callable[[], object]]] = [
        (trained / CLASSIFIER_FILE, lambda: _train(choice, effort, folder / "touches", trained, jobs)),
        (
            sensor / OBSERVATION_FILE,
            lambda: _calibrate(choice, effort, repeats, trained / CLASSIFIER_FILE, sensor, jobs),
        ),
        (bank / TEST / MANIFEST, MakeTouchBank(scene, repeats, sensor, bank).run),
        (policies, lambda: _train_policies(scene, effort, bank, sensor, folder / "ppo", jobs)),
    ]
    for done, make in stages:
        if not done.exists():
            make()
    return sensor


def _train(choice: SceneChoice, effort: Effort, data: Path, out: Path, jobs: int) -> None:
    collect(choice, effort.touches.plan, data, jobs)
    Train(choice.scene, data, out, recipe="large", change=effort.change, threads=jobs).run()


def _calibrate(choice: SceneChoice, effort: Effort, data: Path, classifier: Path, out: Path, jobs: int) -> None:
    collect(choice, effort.repeats.plan, data, jobs)
    Calibrate(choice.scene, classifier, data, out).run()


def _train_policies(scene: str, effort: Effort, bank: Path, sensor: Path, out: Path, jobs: int) -> None:
    TrainPPO(scene, bank, sensor, out, change=effort.ppo, seeds=effort.ppo_seeds, jobs=jobs).run()
    half = sensor / f".{POLICIES}"
    shutil.copytree(out / POLICIES, half, dirs_exist_ok=True)
    half.rename(sensor / POLICIES)  # whole or not at all
