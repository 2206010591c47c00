"""Touches of the same objects under many conditions, read by one classifier.

Each random quantity has its own generator, keyed by (seed, object, quantity, pose), so a condition changes only what it
names. Conditions that differ only in the sensor's faults share their presses.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import UnstablePress
from activetouch.rendering import Fault, read_out
from activetouch.scene import Scene, WorldObject
from activetouch.scene_description import scene_fields
from activetouch.sensor import TactileSensor
from belief.errors import UnknownName
from belief.seeding import keyed_rng
from belief.touch_batch import TouchBatch
from experiments.parallel import run_tasks
from experiments.robustness.conditions import CONDITIONS, DoesNotApply

AS_TRAINED = "as trained"
_PER_TASK = 10  # objects; in six poses they fill a batch of the network


@dataclass(frozen=True, eq=False)
class ClassifierOutputs:
    """Outputs of the classifier for N objects that were touched once in each of P poses.

    Attributes:
        numbers: of the objects, increasing, ``(N,)``; objects whose presses did not settle are missing.
        shapes: index of their shape in the scene, ``(N,)``.
        logits: ``(N, P, K)``.
        embeddings: ``(N, P, D)``, which a joint model reads; None for models that read logits only.
    """

    numbers: NDArray[np.int64]
    shapes: NDArray[np.int64]
    logits: NDArray[np.float64]
    embeddings: NDArray[np.float32] | None = None

    def shuffled(self, seed: int) -> TouchBatch:
        """The touches of each object in a random order of its poses, as sequences."""
        num_objects, num_poses, _ = self.logits.shape
        poses = np.tile(np.arange(num_poses), (num_objects, 1))
        return self._sequences(np.random.default_rng(seed).permuted(poses, axis=1))

    def singles(self) -> TouchBatch:
        """Every touch as a sequence of its own, object after object."""
        num_objects, num_poses, _ = self.logits.shape
        return self._sequences(np.tile(np.arange(num_poses), (num_objects, 1))).reshaped((-1, 1))

    def _sequences(self, order: NDArray[np.int64]) -> TouchBatch:
        rows = np.arange(len(order))[:, None]
        embeddings = None if self.embeddings is None else self.embeddings[rows, order]
        return TouchBatch(order, self.logits[rows, order], embeddings)


def applicable_conditions(scene: Scene, names: Sequence[str] = ()) -> tuple[dict[str, Scene], dict[str, str]]:
    """The scenes of the conditions that apply, the unchanged scene first, and why the others do not apply.

    Args:
        scene: in which the sensor was trained.
        names: of the conditions to choose from; all by default.

    Raises:
        UnknownName: there is no such condition.
    """
    for name in names:
        if name not in CONDITIONS:
            raise UnknownName("condition", name, list(CONDITIONS))
    scenes, left_out = {AS_TRAINED: scene}, {}
    for name in (name for name in CONDITIONS if name in names or not names):
        try:
            changed = CONDITIONS[name](scene)
        except DoesNotApply as reason:
            left_out[name] = str(reason)
            continue
        if _presses(changed) == _presses(scene) and changed.faults == scene.faults:
            left_out[name] = "the sensor was trained under this condition"
        else:
            scenes[name] = changed
    return scenes, left_out


def measure_touches(
    sensor: TactileSensor, scenes: Mapping[str, Scene], num_objects: int, seed: int, jobs: int
) -> dict[str, ClassifierOutputs]:
    """Press all objects in worker processes and classify their images in this one.

    Args:
        sensor: with the classifier.
        scenes: by condition.
        num_objects: of every shape.
        seed: of the objects and touches.
        jobs: number of processes that press.

    Raises:
        UnstablePress: no object could be pressed under a condition.
    """
    groups: dict[str, list[str]] = {}
    for name, scene in scenes.items():
        groups.setdefault(_presses(scene), []).append(name)
    tasks = []
    for group in groups.values():
        first, faults = scenes[group[0]], {name: scenes[name].faults for name in group}
        numbers = range(num_objects * len(first.shapes))
        batches = (numbers[start : start + _PER_TASK] for start in numbers[::_PER_TASK])
        tasks += [partial(_press_some, first, faults, part, seed) for part in batches]
    found: dict[str, list[tuple[Any, ...]]] = {name: [] for name in scenes}
    for pressed, images in run_tasks(tasks, jobs, "touching objects"):
        for name, seen in images.items():
            if pressed:
                reading = sensor.reader.read(seen.reshape(-1, *seen.shape[2:]))  # as many as one task has
                parts = reading.logits, reading.embeddings
                found[name].append((pressed, *(part.reshape(*seen.shape[:2], -1) for part in parts)))
    outputs = {}
    for name, of_condition in found.items():
        if not of_condition:
            raise UnstablePress(f"no object could be pressed under the condition {name!r}")
        columns = zip(*sorted(of_condition, key=lambda part: part[0]), strict=True)
        numbered, *read = (np.concatenate(column) for column in columns)
        outputs[name] = ClassifierOutputs(numbered, numbered % len(scenes[name].shapes), *read)
    return outputs


def _presses(scene: Scene) -> str:
    """All that determines the presses: equal for scenes that differ only in the sensor's faults."""
    return json.dumps(scene_fields(replace(scene, faults=())))


class Quantity(IntEnum):
    """A random quantity of an object or a touch, with a generator of its own."""

    SIZE, FRICTION, STIFFNESS, ORIENTATION, PLACE, FORCE, FAULTS, MEMBER = range(1, 9)


def quantity_rng(seed: int, number: int, quantity: Quantity, pose: int = 0) -> np.random.Generator:
    """The generator of one quantity; no two quantities, poses, objects or seeds share one.

    Args:
        seed: of all.
        number: of the object.
        quantity: what is drawn.
        pose: of the touch; 0 for a property of the object.
    """
    return keyed_rng([seed, 0, number, quantity, pose])


def _press_some(
    scene: Scene, faults: Mapping[str, tuple[Fault, ...]], numbers: Sequence[int], seed: int
) -> tuple[list[int], dict[str, NDArray[np.uint8]]]:
    """Numbers of the n objects that could be pressed in all poses, and images ``(n, P, …)`` by condition."""
    without_faults, pressed = replace(scene, faults=()), []
    images: dict[str, list[NDArray[np.uint8]]] = {name: [] for name in faults}
    for number in numbers:
        rng, vary, shape = partial(quantity_rng, seed, number), scene.variation, number % len(scene.shapes)
        family = scene.families.get(scene.shape_labels[shape])
        touched = WorldObject(
            shape,
            vary.size.sample(rng(Quantity.SIZE)),
            scene.presentation.rest(rng(Quantity.ORIENTATION)),
            vary.friction.sample(rng(Quantity.FRICTION)),
            vary.stiffness.sample(rng(Quantity.STIFFNESS)),
            family.sample(rng(Quantity.MEMBER)) if family else None,
        )
        ideal = []
        try:
            for pose in range(len(scene.poses)):
                chances = rng(Quantity.PLACE, pose), rng(Quantity.FORCE, pose)
                ideal.append(without_faults.press(touched, pose, *chances, attempts=1).ideal)
        except UnstablePress:
            continue
        pressed.append(number)
        for name, own in faults.items():
            seen = [read_out(image, own, rng(Quantity.FAULTS, pose)) for pose, image in enumerate(ideal)]
            images[name].append(np.stack(seen))
    return pressed, {name: np.stack(seen) if seen else np.empty(0, np.uint8) for name, seen in images.items()}
