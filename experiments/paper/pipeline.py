"""A sensor for the paper's scene and its PPO policies: collect, train, collect repeats, calibrate, train PPO.

A finished stage leaves a file and is skipped afterwards. An interrupted stage continues as its own command does.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from activetouch.data.manifest import CollectionPlan
from activetouch.perception.reader import TactileReader
from activetouch.perception.recipe import RECIPES
from activetouch.sensor_files import OBSERVATION_FILE, POLICIES, READER_FILE, load_observation_model
from experiments.ppo.recipe import PPO_RECIPES
from experiments.ppo.touch_bank import TEST, TRAINING, kept_bank
from experiments.ppo.train_ppo import train_policies
from experiments.scene_choice import SceneChoice
from experiments.sensor.calibrate import calibrate
from experiments.sensor.collect import collect
from experiments.sensor.train import train_reader

TOUCHES, REPEATS = CollectionPlan(train=1500), CollectionPlan(train=0, repeats=6)
"""Objects of each shape for the classifier; for the observation model and the policies."""


def make_sensor_with_policies(scene: str, folder: Path, jobs: int) -> Path:
    """Make a sensor that reads shapes only, and its policies; return the sensor's folder.

    Args:
        scene: name of the scene.
        folder: folder for the sensor and all intermediate files.
        jobs: number of processes.
    """
    choice, sensor, trained = SceneChoice(scene), folder / "sensor", folder / "trained"
    if (trained / READER_FILE).exists():
        reader = TactileReader.load(trained / READER_FILE)
    else:
        collect(choice, TOUCHES, folder / "touches", jobs)
        recipe = replace(RECIPES["large"], epochs=6, batch_size=128)
        reader = train_reader(folder / "touches", trained, recipe, "atto", choice.named.input_size, jobs=jobs)
    if not (sensor / OBSERVATION_FILE).exists():
        collect(choice, REPEATS, folder / "repeats", jobs)
        calibrate(reader, folder / "repeats", choice.named.scene).save(sensor)
    if not (sensor / POLICIES).exists():
        bank, test_bank = (kept_bank(reader, folder / "repeats", s, folder / "bank" / s) for s in (TRAINING, TEST))
        recipes = [PPO_RECIPES["paper"], PPO_RECIPES["posterior"]]
        model = load_observation_model(sensor)
        train_policies(bank, test_bank, model, folder / "ppo", recipes, jobs=jobs).save(sensor)
    return sensor
