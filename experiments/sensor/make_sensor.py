"""``activetouch.make_sensor``: from a scene to a sensor, in one call."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from activetouch import Scene, TactileSensor
from activetouch.data.manifest import CollectionPlan, Manifest
from activetouch.errors import LabelMismatch
from activetouch.extras import require_extra
from activetouch.named_scenes import NamedScene, as_named
from activetouch.perception.card import read_card
from activetouch.perception.recipe import RECIPES
from activetouch.sensor_files import READER_FILE
from experiments.parallel import default_jobs
from experiments.scene_choice import named_scene
from experiments.sensor.calibrate import calibrate, require_enough
from experiments.sensor.collect import record
from experiments.sensor.train import in_safe_precision, require_input_size, train_reader


def make_sensor(
    scene: str | Scene | NamedScene,
    out: str | Path,
    *,
    train: int = 400,
    calibration: int = 60,
    test: int = 60,
    repeats: int = 3,
    seed: int = 0,
    jobs: int | None = None,
    **change: Any,
) -> TactileSensor:
    """Record touches in a scene, train a classifier on them, and fit an observation model to touches it has not seen.

    It does what the commands ``collect``, ``train`` and ``calibrate`` do. The same call goes on after an interruption,
    and only loads the sensor once it is finished. The sizes by default make a usable sensor of a scene of four shapes
    within minutes; the sensors that come with the package were made from several times as many touches.

    Args:
        scene: to be sensed; its name, or an object.
        out: folder of the sensor, for ``TactileSensor.load`` and ``--sensor``; touches and training are kept in it.
        train: objects of each shape that the classifier learns from, each touched once in every pose.
        calibration: objects of each shape to fit the observation model to.
        test: objects of each shape on which ``evaluation.json`` in the folder reports.
        repeats: how often each of these is touched in every pose.
        seed: of the touches.
        jobs: processes for touches and threads for training; all cores by default.
        change: settings of the training (:class:`activetouch.perception.recipe.TrainingRecipe`), such as ``epochs=20``.

    Returns:
        The sensor in this scene.

    Raises:
        BadArgument: the network cannot read images of this size.
        LabelMismatch: the folder holds the touches of another scene, or of other sizes, or another training.
        MissingPackage: the extra ``train`` is not installed.
        TooFewObjects: ``calibration`` or ``test`` is too small, or the scene has one shape.
    """
    require_extra("train")
    if isinstance(scene, str):
        named = named_scene(scene)
    else:
        named = scene if isinstance(scene, NamedScene) else as_named(scene)
    folder, jobs = Path(out), jobs if jobs is not None else default_jobs()
    touches, repeated = folder / "touches", folder / "repeats"
    plan = CollectionPlan(train=train, calibration=calibration, test=0, seed=seed)
    repeated_plan = CollectionPlan(train=0, calibration=calibration, test=test, seed=seed, repeats=repeats)
    recipe = in_safe_precision(replace(RECIPES["large"], **{"seed": seed, **change}), named.input_size)
    require_input_size(named.input_size, named.scene.image_shape[0], named.backbone)
    require_enough(Manifest.of(named.scene, repeated_plan), repeated)
    made = (folder / "evaluation.json").exists()  # which is written last
    if made:
        card = read_card(folder / READER_FILE)
        found = card.backbone, card.input_size, card.training.partition(";")[0]
        if found != (wanted := (named.backbone, named.input_size, recipe.words)):
            raise LabelMismatch(
                f"the reader in {folder} was trained with other settings: {found}; asked for is {wanted}. Choose "
                "another folder"
            )
    record(named.scene, plan, touches, jobs)
    record(named.scene, repeated_plan, repeated, jobs)
    if not made:
        reader = train_reader(touches, folder / "training", recipe, named.backbone, named.input_size, jobs=jobs)
        calibrate(reader, repeated, named.scene, seed=seed).save(folder)
    return TactileSensor.load(folder, named.scene)
