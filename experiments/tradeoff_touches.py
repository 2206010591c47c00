"""Recorded touches as a world: objects that were touched in every pose in several rounds, read by a network once.

A search in this world is the one search loop with real readings. What is left out is pressing anew: the n-th touch of
an object in a pose is one of its recorded rounds, in an order of the episode's own, so that all configurations that
touch alike feel alike.
"""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from activetouch.atomic import atomic_path, write_text
from activetouch.dataset import TouchSet, read_manifest, read_shard
from activetouch.world import MODELS, OBSERVATION_FILE
from belief import SearchProblem, Touch
from belief.chance import arrangement_rng
from belief.observation_model import ArrayModel, read_observation_model
from belief.selection import OBSERVATION_MODELS
from belief.synthetic import sample_arrangement
from experiments.scene_choice import repeats_folder
from experiments.scores import read_logits
from experiments.sequences import Rounds
from experiments.tradeoff_configuration import SHIPPED, Configuration, Network

_OBJECTS = {"calibration": 200, "test": 300}  # of a split, to read
_ROUNDS = 3  # of every object; a search seldom touches one more often in a pose


class RecordedWorld:
    """Recorded objects, one after the other.

    Args:
        rounds: the recording.
        objects: which of its objects lie on the table, in order of visit.
        rng: for the order of every object's rounds.
    """

    def __init__(self, rounds: Rounds, objects: Sequence[int], rng: np.random.Generator) -> None:
        self._logits = rounds.logits[list(objects)]  # (N, R, P, K)
        self.arrangement = tuple(int(shape) for shape in rounds.shapes[list(objects)])
        size = (len(objects), rounds.num_poses, rounds.num_rounds)
        self._order = rng.permuted(np.broadcast_to(np.arange(rounds.num_rounds), size), axis=2)
        self.reset()

    @classmethod
    def sample(cls, rounds: Rounds, problem: SearchProblem, seed: Sequence[int]) -> RecordedWorld:
        """The table of the episode with this seed: no object lies on it twice."""
        rng = arrangement_rng(seed)
        shapes = np.array(sample_arrangement(problem, rng))
        objects = np.empty(len(shapes), int)
        for shape in np.unique(shapes):
            places = shapes == shape
            objects[places] = rng.choice(np.flatnonzero(rounds.shapes == shape), places.sum(), replace=False)
        return cls(rounds, objects.tolist(), rng)

    def touch(self, pose: int, rng: np.random.Generator) -> Touch:
        """What was felt; after the last round in a pose the first comes again."""
        order = self._order[self._current, pose]
        turn = order[self._uses[self._current, pose] % len(order)]
        self._uses[self._current, pose] += 1
        return Touch(pose, self._logits[self._current, turn, pose])

    def advance(self) -> None:
        """Bring the next object."""
        self._current += 1

    def reset(self) -> None:
        """Bring the first object, untouched."""
        self._current = 0
        self._uses: Counter[tuple[int, int]] = Counter()


def read_rounds(network: Network, precision: str, split: str, folder: Path) -> Rounds:
    """What a network reads of the first objects of a split; read once, and kept in a folder."""
    stem = f"{network.scene}-{network.sha256[:12]}-{precision}"
    path = folder / f"{stem}-{split}-{_OBJECTS[split]}.npz"
    if not path.exists():
        from activetouch.classifier import TouchClassifier  # loads torch

        classifier = TouchClassifier.load(network.path)
        classifier = classifier.to_bfloat16() if precision == "bf16" else classifier
        manifest = read_manifest(repeats_folder(network.scene))
        classifier.require_labels(manifest.shape_labels, manifest.pose_labels)
        touches = _first_objects(network.scene, split)
        logits = read_logits(classifier, touches.images, f"{network.scene}, {network.label} {precision}, {split}")
        rounds = Rounds.of(touches, logits, len(manifest.pose_labels))
        content = io.BytesIO()
        np.savez(content, logits=rounds.logits, shapes=rounds.shapes)
        with atomic_path(path) as temporary:
            temporary.write_bytes(content.getvalue())
    with np.load(path, allow_pickle=False) as found:
        return Rounds(found["logits"], found["shapes"])


def _first_objects(scene: str, split: str) -> TouchSet:
    """The first objects of a split and their first rounds, without reading the other shards."""
    folder = repeats_folder(scene)
    manifest = read_manifest(folder)
    parts = []
    for name, shard, objects in manifest.shards():
        if name == split and objects.start < _OBJECTS[split]:
            touches, _ = read_shard(folder, manifest, split, shard, objects)
            each = manifest.touches_per_object
            kept = np.arange(len(touches.images)) % each < _ROUNDS * len(manifest.pose_labels)
            parts.append(touches.select(kept & (touches.object_ids < _OBJECTS[split])))
    return TouchSet.join(parts)


def observation_model(configuration: Configuration, folder: Path) -> ArrayModel:
    """The observation model of a configuration: the shipped one, or one fitted to recorded calibration touches."""
    network, name = configuration.network, configuration.observation_model
    if name == SHIPPED:
        return read_observation_model((MODELS / network.scene / OBSERVATION_FILE).read_text())
    stem = f"{network.scene}-{network.sha256[:12]}-{configuration.precision}"
    path = folder / f"{stem}-{name.replace(' ', '')}.json"
    if not path.exists():
        rounds = read_rounds(network, configuration.precision, "calibration", folder)
        touches, shapes, ids = _as_touches(rounds)
        labels = read_manifest(repeats_folder(network.scene)).shape_labels
        fitted = OBSERVATION_MODELS[name](touches, shapes, ids, shape_labels=labels, num_poses=rounds.num_poses)
        write_text(path, fitted.to_json() + "\n")
    return read_observation_model(path.read_text())


def _as_touches(rounds: Rounds) -> tuple[list[Touch], NDArray[np.int64], NDArray[np.int64]]:
    """Touches one by one, with shape and object of each."""
    num_objects, num_rounds, num_poses, num_shapes = rounds.logits.shape
    poses = np.tile(np.arange(num_poses), num_objects * num_rounds)
    rows = rounds.logits.reshape(-1, num_shapes)
    touches = [Touch(int(pose), row) for pose, row in zip(poses, rows, strict=True)]
    ids = np.arange(num_objects).repeat(num_rounds * num_poses)
    return touches, rounds.shapes[ids], ids
