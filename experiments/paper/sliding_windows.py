"""The paper's data set: images of a window that slides over the force log of a press (paper §5.3 to §5.6).

The object has a new orientation in every press. The images of one press share most of their readings, so they are near
copies of each other, and the meaning of a classifier's accuracy depends on how the data set is split.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from activetouch.data.dataset import TouchSet
from activetouch.orientations import Resampled
from activetouch.rendering import ForcePatchRenderer, read_out
from activetouch.scene import Scene
from belief.seeding import keyed_rng
from experiments.parallel import run_tasks


@dataclass(frozen=True)
class WindowPlan:
    """Size of the data set; the default has 700 images of each shape, about as many as the paper."""

    objects: int = 35
    """Number of objects of each shape, of different sizes."""
    presses: int = 2
    """Number of presses of each object, each in a new random orientation."""
    images: int = 10
    """Number of images of each press, evenly spread over the time of contact."""
    seed: int = 0
    """Seed of all random numbers."""


def record_windows(scene: Scene, plan: WindowPlan, stream: int, jobs: int) -> TouchSet:
    """Press the objects of a plan, and render the windows, on several processes.

    Different numbers of the stream give independent data sets. Images are ordered by object, shapes in turn; ``poses``
    numbers the presses of an object. An object that misses the pad has no images.
    """
    scene = replace(scene, presentation=Resampled())
    tasks = [partial(_press, scene, plan, stream, number) for number in range(plan.objects * len(scene.shapes))]
    parts = [part for part in run_tasks(tasks, jobs, "sliding windows over presses") if len(part.images)]
    return TouchSet.join(sorted(parts, key=lambda part: part.object_ids[0]))


def _press(scene: Scene, plan: WindowPlan, stream: int, number: int) -> TouchSet:
    renderer = scene.renderer
    assert isinstance(renderer, ForcePatchRenderer), "the caller chose a scene with force patches"
    rng = keyed_rng([plan.seed, stream, number], is_fixed_length=True)
    body = scene.sample_object(number % len(scene.shapes), rng)
    images: list[NDArray[np.uint8]] = []
    rows: list[Sequence[float]] = []
    for press in range(plan.presses):
        contact = scene.contact(scene.place(body, 0, rng), rng)
        assert contact.trace is not None, "guarded moves are always traced"
        in_contact = contact.trace.time[contact.trace.force.any(axis=1)]
        windows = list(renderer.windows(contact, np.ptp(in_contact) / plan.images)) if in_contact.size else []
        for index in np.linspace(0, len(windows) - 1, plan.images).round().astype(int) if windows else ():
            images.append(read_out(windows[index], scene.faults, rng))
            rows.append((body.shape_index, number, press, contact.force, contact.depth))
    shapes, object_ids, presses, forces, depths = np.reshape(rows, (-1, 5)).T
    taken = np.reshape(images, (-1, *scene.image_shape)).astype(np.uint8)
    return TouchSet(taken, shapes.astype(int), object_ids.astype(int), presses.astype(int), forces, depths)


def split_by_image(touches: TouchSet, share: float, rng: np.random.Generator) -> tuple[TouchSet, TouchSet]:
    """A random ``share`` of the images, and the others. Near copies are in both parts."""
    order = rng.permutation(len(touches.images))
    cut = round(share * len(order))
    return touches.select(np.sort(order[:cut])), touches.select(np.sort(order[cut:]))


def split_by_object(touches: TouchSet, share: float, rng: np.random.Generator) -> tuple[TouchSet, TouchSet]:
    """The images of a random ``share`` of each shape's objects, and those of the others."""
    first: list[NDArray[np.int64]] = []
    for shape in np.unique(touches.shapes):
        objects = rng.permutation(np.unique(touches.object_ids[touches.shapes == shape]))
        first.append(objects[: round(share * len(objects))])
    chosen = np.isin(touches.object_ids, np.concatenate(first))
    return touches.select(chosen), touches.select(~chosen)
