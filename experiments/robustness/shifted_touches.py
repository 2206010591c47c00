"""Touches of the same objects in many conditions, read by one classifier.

Each property of an object and each part of a touch draws from its own generator, keyed by (seed, object, pose, part):
so a condition changes what it names and nothing else. Conditions that differ in the sensor's faults alone share their
presses.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import UnstablePress
from activetouch.rendering import Fault, read_out
from activetouch.scene import Scene, WorldObject
from activetouch.world import TactileSensor
from belief.seeding import keyed_rng
from experiments.parallel import run_tasks
from experiments.robustness.conditions import CONDITIONS, MeansNothing

AS_TRAINED = "as trained"
_PER_TASK = 10  # objects; in six poses they fill a batch of the network


@dataclass(frozen=True)
class Series:
    """Objects to touch, ``num_objects`` of every shape of a scene; those of another ``stream`` are others."""

    scene: Scene
    num_objects: int
    stream: int = 0

    @property
    def presses(self) -> Hashable:
        """What its presses follow from: equal for series that differ in the sensor's faults alone."""
        how = (self.scene.press_model, self.scene.variation, self.scene.presentation, self.scene.shape_labels)
        return (*how, self.num_objects, self.stream)


@dataclass(frozen=True, eq=False)
class Felt:
    """What the classifier read of N objects that were touched once in each of P poses.

    Attributes:
        numbers: of the objects, rising, ``(N,)``; some are missing where the simulation of a press diverged.
        shapes: index of their shape in the series' scene, ``(N,)``.
        logits: ``(N, P, K)``.
        features: ``(N, P, D)``.
    """

    numbers: NDArray[np.int64]
    shapes: NDArray[np.int64]
    logits: NDArray[np.float64]
    features: NDArray[np.float32]


def choose(scene: Scene, num_objects: int, num_deformable: int = 0) -> tuple[dict[str, Series], dict[str, str]]:
    """What to touch in every condition, and of those left out, why; as trained comes first."""
    series, left_out = {AS_TRAINED: Series(scene, num_objects)}, {}
    for name, change in CONDITIONS.items():
        try:
            changed = change(scene)
        except MeansNothing as reason:
            left_out[name] = str(reason)
            continue
        is_slow = changed.press_model.is_slow and not scene.press_model.is_slow
        if Series(changed, 0).presses == Series(scene, 0).presses and changed.faults == scene.faults:
            left_out[name] = "it was trained so"
        elif is_slow and not num_deformable:
            left_out[name] = "a press takes seconds; --deformable says how many objects to press so"
        else:
            series[name] = Series(changed, min(num_deformable, num_objects) if is_slow else num_objects)
    return series, left_out


def feel(sensor: TactileSensor, series: Mapping[str, Series], seed: int, jobs: int) -> dict[str, Felt]:
    """Press all objects in worker processes and read their images here.

    Raises:
        UnstablePress: no object of a series could be pressed.
    """
    groups: dict[Hashable, dict[str, Series]] = {}
    for name, some in series.items():
        groups.setdefault(some.presses, {})[name] = some
    tasks = []
    for group in groups.values():
        first = next(iter(group.values()))
        total, faults = first.num_objects * len(first.scene.shapes), {name: s.scene.faults for name, s in group.items()}
        for start in range(0, total, _PER_TASK):
            numbers = range(start, min(start + _PER_TASK, total))
            tasks.append(partial(_press_some, first.scene, faults, numbers, (seed, first.stream)))
    parts: dict[str, list[tuple]] = {name: [] for name in series}
    for numbers, images in run_tasks(tasks, jobs, "touching objects"):
        for name, some in images.items():
            if numbers:
                logits, features = sensor.classifier.read(some.reshape(-1, *some.shape[2:]))  # as many as one task has
                shape = (len(numbers), some.shape[1], -1)
                parts[name].append((numbers, logits.reshape(shape), features.reshape(shape)))
    felt = {}
    for name, some in parts.items():
        if not some:
            raise UnstablePress(f"not one object could be pressed in the condition {name!r}")
        columns = zip(*sorted(some, key=lambda part: part[0]), strict=True)
        numbers, logits, features = (np.concatenate(column) for column in columns)
        felt[name] = Felt(numbers, numbers % len(series[name].scene.shapes), logits, features)
    return felt


class Part(IntEnum):
    """A property of an object, or a part of a touch, that draws from a generator of its own."""

    SIZE, FRICTION, STIFFNESS, ORIENTATION, PLACE, FORCE, FAULTS = range(1, 8)


def part_rng(key: tuple[int, int], number: int, part: Part, pose: int = 0) -> np.random.Generator:
    """Source of chance of one part; no two parts, poses, objects or keys share one.

    Args:
        key: seed and stream.
        number: of the object.
        part: what draws.
        pose: of the touch; 0 for a property of the object.
    """
    return keyed_rng([*key, number, part, pose])


def _press_some(
    scene: Scene, faults: Mapping[str, tuple[Fault, ...]], numbers: range, key: tuple[int, int]
) -> tuple[list[int], dict[str, NDArray[np.uint8]]]:
    """Objects that could be pressed in all poses, n of them, and their images by name of the faults, ``(n, P, …)``."""
    without_faults, kept, images = replace(scene, faults=()), [], {name: [] for name in faults}
    for number in numbers:
        vary = scene.variation
        thing = WorldObject(
            number % len(scene.shapes),
            vary.size.sample(part_rng(key, number, Part.SIZE)),
            scene.presentation.rest(part_rng(key, number, Part.ORIENTATION)),
            vary.friction.sample(part_rng(key, number, Part.FRICTION)),
            vary.stiffness.sample(part_rng(key, number, Part.STIFFNESS)),
        )
        ideal = []
        try:
            for pose in range(len(scene.poses)):
                place, force = (part_rng(key, number, part, pose) for part in (Part.PLACE, Part.FORCE))
                ideal.append(without_faults.press(thing, pose, place, force, attempts=1).ideal)
        except UnstablePress:
            continue
        kept.append(number)
        for name, some in faults.items():
            chances = [part_rng(key, number, Part.FAULTS, pose) for pose in range(len(ideal))]
            images[name].append(np.stack([read_out(i, some, rng) for i, rng in zip(ideal, chances, strict=True)]))
    return kept, {name: np.stack(some) if some else np.empty(0, np.uint8) for name, some in images.items()}
