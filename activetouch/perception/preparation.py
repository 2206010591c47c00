"""What a reader of any object needs for the objects of a scene: simulated touches of them, and a fitted model.

Nothing is trained. A few hundred presses in simulation fit the temperature and the conflict test; both are kept in the
cache (:mod:`activetouch.perception.cached_arrays`).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from activetouch.errors import AlikeShapes, warn_of
from activetouch.orientations import Inexact
from activetouch.perception.cached_arrays import cached, counted, require_name
from activetouch.perception.contacts.hypotheses import num_hypotheses
from activetouch.perception.reader import HypothesisTable, TactileReader, of_grasps
from activetouch.scene import Scene
from activetouch.scene_description import SURROUNDINGS, scene_fields
from belief.errors import CorruptFile
from belief.files import require_regular_file, write_text
from belief.observation_model.model import ArrayModel
from belief.observation_model.registry import read_observation_model, read_origin
from belief.observation_model.rigid_body import FittedRigidBody, RigidBodyModel
from belief.problem import Touch
from belief.touch_batch import TouchBatch

_TOUCHES = 1200  # simulated, in all
_LEAST, _MOST = 12, 48  # objects of each shape
_ENOUGH = 0.9  # share of objects that must be named rightly after a touch in every pose


def prepared(reader: TactileReader, scene: Scene, seed: int = 0) -> ArrayModel:
    """The observation model of a reader for the objects of a scene, from simulated touches; warns of alike shapes."""
    if isinstance(scene.presentation, Inexact):
        from activetouch.perception.moving import in_exact_poses  # others do not need it

        scene = in_exact_poses(scene, hypotheses_of(reader, scene))
    described = {name: value for name, value in scene_fields(scene).items() if name not in SURROUNDINGS}
    made_by = [reader.digest, reader.card.imaging, version("activetouch")]
    key = {"reader": made_by, "scene": described, "hypotheses": hypotheses_of(reader, scene)}
    key |= {"touches": _TOUCHES, "seed": seed}
    make = partial(_fitted, reader, scene, np.random.default_rng([seed, 0xF17]))
    model, alike = cached(key, ".json", make, _read, _write)
    if alike:
        warn_of(alike, AlikeShapes)
    return model


def hypotheses_of(reader: TactileReader, scene: Scene) -> int:
    """Number of hypotheses of each shape with which :func:`prepared` fits a model."""
    grasps = of_grasps(reader.hypotheses)
    return num_hypotheses(scene) if grasps is None else grasps.number


def _read(path: Path) -> tuple[ArrayModel, str]:
    text = require_regular_file(path).read_text(encoding="utf-8")
    model = read_observation_model(text)
    if model.reads != "embeddings":
        raise CorruptFile(f"{path} holds another model")
    origin = read_origin(text) or {}
    require_name(path, origin.get("name"))
    return model, origin["alike"]


def _write(path: Path, fitted: tuple[ArrayModel, str]) -> None:
    model, alike = fitted
    write_text(path, model.to_json({"alike": alike, "name": path.stem}) + "\n")


def _fitted(reader: TactileReader, scene: Scene, rng: np.random.Generator) -> tuple[FittedRigidBody, str]:
    """The model, and in words which shapes are mistaken for each other; empty if they rarely are."""
    num_shapes, num_poses = len(scene.shapes), len(scene.poses)
    number = int(np.clip(_TOUCHES // (num_shapes * num_poses), _LEAST, _MOST))
    truth = np.repeat(np.arange(num_shapes), number)
    images = []
    for shape in counted(truth.tolist(), "objects"):
        obj = scene.sample_object(shape, rng)
        images += [scene.press(obj, pose, rng).image for pose in range(num_poses)]
    read = reader.read(np.stack(images))
    poses = np.tile(np.arange(num_poses), len(truth))
    touches = [Touch(*touch) for touch in zip(poses.tolist(), read.logits, read.embeddings, strict=True)]
    ids = np.repeat(np.arange(len(truth)), num_poses)
    labels: Mapping[str, Any] = {"shape_labels": scene.shape_labels, "num_poses": num_poses}
    table = HypothesisTable(reader, scene)
    model = RigidBodyModel.fit(
        touches, truth[ids], ids, embed=table, num_hypotheses=hypotheses_of(reader, scene), **labels
    )
    order = np.array([rng.permutation(num_poses) for _ in truth]) + np.arange(len(truth))[:, None] * num_poses
    batch = TouchBatch(poses[order], read.logits[order], read.embeddings[order])
    found = model.log_likelihood_batch(batch).argmax(axis=1)
    return model, _alike(scene, truth, found)


def _alike(scene: Scene, truth: np.ndarray, found: np.ndarray) -> str:
    right = float((found == truth).mean())
    if right >= _ENOUGH:
        return ""
    pairs, counts = np.unique(np.stack([truth, found])[:, found != truth], axis=1, return_counts=True)
    labels = scene.shape_labels
    worst = [f"{labels[pairs[0, i]]} for {labels[pairs[1, i]]}" for i in np.argsort(-counts)[:3]]
    return (
        f"in simulation, a touch in each of {len(scene.poses)} poses names {right:.0%} of the objects rightly; most "
        f"often mistaken: {', '.join(worst)}. activetouch explain says which shapes feel alike, and more "
        "poses (directions26) help"
    )
