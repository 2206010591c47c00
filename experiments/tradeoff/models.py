"""Observation models that no shipped sensor has, fitted to recorded calibration touches."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from activetouch.data.dataset import TouchSet, read_shard
from activetouch.named_scenes import SCENES
from activetouch.perception.card import ClassifierCard
from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.perception.reader import TactileReader
from belief import Touch
from belief.errors import CorruptFile
from belief.files import require_regular_file, write_text
from belief.observation_model import ArrayModel, read_observation_model
from belief.observation_model.registry import fit_named
from experiments.scene_choice import repeats_folder
from experiments.sensor.scores import read_touches
from experiments.sensor_choice import open_collection, require_collection
from experiments.tradeoff.configuration import JOINT, Configuration, Network

_SPLIT = "calibration"
_OBJECTS = 75  # objects per shape, from the first of the split
_ROUNDS = 3  # rounds per object, from the first; at least two are needed to estimate the correlation of repeats


def observation_model(configuration: Configuration, folder: Path) -> ArrayModel:
    """The fitted observation model of a configuration; it is fitted once and cached in ``folder``.

    Raises:
        CorruptFile: The cached file is damaged.
    """
    network, name = configuration.network, configuration.observation_model
    scene, reader = SCENES[network.scene].scene, TactileReader.load(network.path)
    table = None if reader.hypotheses is None else HypothesisTable(reader, scene)
    path = (
        folder
        / f"{network.scene}-{network.sha256[:12]}-{name.replace(' ', '')}{configuration.num_hypotheses or ''}.json"
    )
    if not path.exists():
        read, truth = _readings(network)
        options: dict[str, Any] = {"shape_labels": scene.shape_labels, "num_poses": len(scene.poses)}
        if name == JOINT:
            options |= {"embed": table, "num_hypotheses": configuration.num_hypotheses}
        fitted = fit_named(name)(read, truth.shapes, truth.object_ids, **options)
        write_text(path, fitted.to_json() + "\n")
    try:
        model = read_observation_model(require_regular_file(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise CorruptFile(f"{path} is not an observation model: {error}. Delete it, then it is fitted again") from error
    return model if table is None else model.with_hypotheses(table)


@lru_cache(maxsize=1)
def _readings(network: Network) -> tuple[list[Touch], TouchSet]:
    """A network's readings of the calibration touches, and these touches."""
    reader = TactileReader.load(network.path)
    touches = _first_objects(network.scene, reader.card)
    read = read_touches(reader, touches, f"{network.scene}, {network.label}: calibration")
    return read.sequence(0), touches


def _first_objects(scene: str, card: ClassifierCard) -> TouchSet:
    """First rounds of the first objects of the calibration split; other shards are not read."""
    folder = repeats_folder(scene)
    manifest = open_collection(folder, scene, repeats=True)
    require_collection(folder, manifest, card, scene, repeats=True)
    wanted, parts = _OBJECTS * len(manifest.shape_labels), []
    for name, shard, objects in manifest.shards():
        if name == _SPLIT and objects.start < wanted:
            touches, _ = read_shard(folder, manifest, _SPLIT, shard, objects)
            each = manifest.touches_per_object
            kept = np.arange(len(touches.images)) % each < _ROUNDS * len(manifest.pose_labels)
            parts.append(touches.select(kept & (touches.object_ids < wanted)))
    return TouchSet.join(parts)
