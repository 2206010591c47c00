"""Touches of the same objects under many conditions, read by one classifier.

Each random quantity has its own generator, keyed by (seed, stream, object, quantity, pose), so a condition changes only
what it names. Conditions that differ only in the sensor's faults share their presses.
"""

from __future__ import annotations

import json
from collections.abc import Hashable, Mapping
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
from belief.seeding import keyed_rng
from belief.touch_batch import TouchBatch
from experiments.parallel import run_tasks
from experiments.robustness.conditions import CONDITIONS, DoesNotApply

AS_TRAINED = "as trained"
_PER_TASK = 10  # objects; in six poses they fill a batch of the network


@dataclass(frozen=True)
class ShiftedScene:
    """A scene and the number of objects of every shape to touch in it; each ``stream`` has its own objects."""

    scene: Scene
    num_objects: int
    stream: int = 0

    @property
    def presses(self) -> Hashable:
        """All that determines the presses: equal for scenes that differ only in the sensor's faults."""
        return json.dumps(scene_fields(replace(self.scene, faults=()))), self.num_objects, self.stream


@dataclass(frozen=True, eq=False)
class ClassifierOutputs:
    """Outputs of the classifier for N objects that were touched once in each of P poses.

    Attributes:
        numbers: of the objects, increasing, ``(N,)``; objects whose presses did not settle are missing.
        shapes: index of their shape in the scene, ``(N,)``.
        logits: ``(N, P, K)``.
        features: of the backbone, ``(N, P, F)``.
        embeddings: ``(N, P, D)``, which a joint model reads; None for models that read logits only.
    """

    numbers: NDArray[np.int64]
    shapes: NDArray[np.int64]
    logits: NDArray[np.float64]
    features: NDArray[np.float32]
    embeddings: NDArray[np.float32] | None = None

    def sequences(self, order: NDArray[np.int64]) -> TouchBatch:
        """The touches of each object in an order of its poses, ``(N, n)``, as sequences."""
        rows = np.arange(len(order))[:, None]
        embeddings = None if self.embeddings is None else self.embeddings[rows, order]
        return TouchBatch(order, self.logits[rows, order], embeddings)

    def singles(self) -> TouchBatch:
        """Every touch as a sequence of its own, object after object."""
        num_objects, num_poses, _ = self.logits.shape
        all_poses = self.sequences(np.tile(np.arange(num_poses), (num_objects, 1)))
        return all_poses.reshaped((-1, 1))


def applicable_conditions(scene: Scene, num_objects: int) -> tuple[dict[str, ShiftedScene], dict[str, str]]:
    """The conditions that apply to a scene, the unchanged scene first, and why the others do not.

    Args:
        scene: in which the sensor was trained.
        num_objects: of every shape.
    """
    shifted, left_out = {AS_TRAINED: ShiftedScene(scene, num_objects)}, {}
    for name, change in CONDITIONS.items():
        try:
            changed = change(scene)
        except DoesNotApply as reason:
            left_out[name] = str(reason)
            continue
        if ShiftedScene(changed, 0).presses == ShiftedScene(scene, 0).presses and changed.faults == scene.faults:
            left_out[name] = "the sensor was trained under this condition"
        else:
            shifted[name] = ShiftedScene(changed, num_objects)
    return shifted, left_out


def measure_touches(
    sensor: TactileSensor, shifted: Mapping[str, ShiftedScene], seed: int, jobs: int
) -> dict[str, ClassifierOutputs]:
    """Press all objects in worker processes and classify their images in this one.

    Args:
        sensor: with the classifier.
        shifted: scene and number of objects, by condition.
        seed: of the objects and touches.
        jobs: number of processes that press.

    Raises:
        UnstablePress: no object could be pressed under a condition.
    """
    groups: dict[Hashable, dict[str, ShiftedScene]] = {}
    for name, some in shifted.items():
        groups.setdefault(some.presses, {})[name] = some
    tasks = []
    for group in groups.values():
        first = next(iter(group.values()))
        total, faults = first.num_objects * len(first.scene.shapes), {name: s.scene.faults for name, s in group.items()}
        for start in range(0, total, _PER_TASK):
            numbers = range(start, min(start + _PER_TASK, total))
            tasks.append(partial(_press_some, first.scene, faults, numbers, (seed, first.stream)))
    parts: dict[str, list[tuple[Any, ...]]] = {name: [] for name in shifted}
    for pressed, images in run_tasks(tasks, jobs, "touching objects"):
        for name, seen in images.items():
            if pressed:
                reading = sensor.reader.read(seen.reshape(-1, *seen.shape[2:]))  # as many as one task has
                parts[name].append((pressed, *(read.reshape(*seen.shape[:2], -1) for read in reading)))
    outputs = {}
    for name, of_condition in parts.items():
        if not of_condition:
            raise UnstablePress(f"no object could be pressed under the condition {name!r}")
        columns = zip(*sorted(of_condition, key=lambda part: part[0]), strict=True)
        kept, *read = (np.concatenate(column) for column in columns)
        outputs[name] = ClassifierOutputs(kept, kept % len(shifted[name].scene.shapes), *read)
    return outputs


class Quantity(IntEnum):
    """A random quantity of an object or a touch, with a generator of its own."""

    SIZE, FRICTION, STIFFNESS, ORIENTATION, PLACE, FORCE, FAULTS, MEMBER = range(1, 9)


def quantity_rng(key: tuple[int, int], number: int, quantity: Quantity, pose: int = 0) -> np.random.Generator:
    """The generator of one quantity; no two quantities, poses, objects or keys share one.

    Args:
        key: seed and stream.
        number: of the object.
        quantity: what is drawn.
        pose: of the touch; 0 for a property of the object.
    """
    return keyed_rng([*key, number, quantity, pose])


def _press_some(
    scene: Scene, faults: Mapping[str, tuple[Fault, ...]], numbers: range, key: tuple[int, int]
) -> tuple[list[int], dict[str, NDArray[np.uint8]]]:
    """Numbers of the n objects that could be pressed in all poses, and images ``(n, P, …)`` by condition."""
    without_faults, kept = replace(scene, faults=()), []
    images: dict[str, list[NDArray[np.uint8]]] = {name: [] for name in faults}
    for number in numbers:
        vary, shape = scene.variation, number % len(scene.shapes)
        family = scene.families.get(scene.shape_labels[shape])
        thing = WorldObject(
            shape,
            vary.size.sample(quantity_rng(key, number, Quantity.SIZE)),
            scene.presentation.rest(quantity_rng(key, number, Quantity.ORIENTATION)),
            vary.friction.sample(quantity_rng(key, number, Quantity.FRICTION)),
            vary.stiffness.sample(quantity_rng(key, number, Quantity.STIFFNESS)),
            family.sample(quantity_rng(key, number, Quantity.MEMBER)) if family else None,
        )
        ideal = []
        try:
            for pose in range(len(scene.poses)):
                place = quantity_rng(key, number, Quantity.PLACE, pose)
                force = quantity_rng(key, number, Quantity.FORCE, pose)
                ideal.append(without_faults.press(thing, pose, place, force, attempts=1).ideal)
        except UnstablePress:
            continue
        kept.append(number)
        for name, some in faults.items():
            chances = [quantity_rng(key, number, Quantity.FAULTS, pose) for pose in range(len(ideal))]
            images[name].append(np.stack([read_out(i, some, rng) for i, rng in zip(ideal, chances, strict=True)]))
    return kept, {name: np.stack(some) if some else np.empty(0, np.uint8) for name, some in images.items()}
