"""Make a sensor and its PPO policies without any existing file: collect, train, collect repeats, calibrate, train PPO.

A finished stage leaves a file and is skipped afterwards. An interrupted stage continues as its own command does: after
the last shard, epoch or policy.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from pathlib import Path

from activetouch.envs.touch_bank import MANIFEST
from activetouch.sensor_files import OBSERVATION_FILE, POLICIES, READER_FILE
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
    """Size of the data sets and length of the training of a sensor and its policies."""

    touches: PlanArguments = field(default_factory=lambda: PlanArguments(train=1500))
    """Objects of each shape for the classifier."""
    repeats: PlanArguments = field(default_factory=lambda: PlanArguments(train=0, repeats=6))
    """Objects of each shape for the observation model and the policies."""
    change: Changes = field(default_factory=lambda: Changes(epochs=6, batch_size=128))
    """Changes to the recipe "large" of the classifier."""
    ppo: PPOChanges = field(default_factory=PPOChanges)
    """Changes to the recipes of PPO."""
    ppo_seeds: Count = 3
    """Number of trainings of each policy; the best is kept."""


def sensor_from_nothing(scene: str, effort: Effort, folder: Path, jobs: int) -> Path:
    """Make a sensor with its policies, and return its folder; finished stages are skipped.

    Args:
        scene: name of the scene.
        effort: size of the data sets and length of the training.
        folder: folder for the sensor and all intermediate files.
        jobs: number of processes.
    """
    choice, sensor, trained, bank = SceneChoice(scene), folder / "sensor", folder / "trained", folder / "bank"
    touches, repeats, ppo, policies = folder / "touches", folder / "repeats", folder / "ppo", sensor / POLICIES
    if not (trained / READER_FILE).exists():
        collect(choice, effort.touches.plan, touches, jobs)
        Train(scene, touches, trained, recipe="large", change=effort.change, threads=jobs).run()
    if not (sensor / OBSERVATION_FILE).exists():
        collect(choice, effort.repeats.plan, repeats, jobs)
        Calibrate(scene, trained / READER_FILE, repeats, sensor).run()
    if not (bank / TEST / MANIFEST).exists():
        MakeTouchBank(scene, repeats, sensor, bank).run()
    if not policies.exists():
        TrainPPO(scene, bank, sensor, ppo, change=effort.ppo, seeds=effort.ppo_seeds, jobs=jobs).run()
        unfinished = sensor / f".{POLICIES}"
        shutil.copytree(ppo / POLICIES, unfinished, dirs_exist_ok=True)
        unfinished.rename(policies)  # so that the folder is complete as soon as it exists
    return sensor
