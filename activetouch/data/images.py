"""Touches as PNG files in folders by split and shape, as torchvision's ``ImageFolder`` reads them (paper §5.6).

The objects are those of a collection with the same plan, each in one split only. A press gives one image; where
renderer and press simulate time, it gives several, from a window that slides over the time of contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from activetouch.data.dataset import touch_object
from activetouch.data.manifest import CollectionPlan
from activetouch.pressing.contact import Contact
from activetouch.rendering import ForcePatchRenderer, read_out
from activetouch.scene import Scene, WorldObject
from belief.files import atomic_path, in_file_name

WINDOWS = 10
"""Images of a press that simulates time."""


def window_images(scene: Scene, contact: Contact, number: int, rng: np.random.Generator) -> list[NDArray[np.uint8]]:
    """Images ``(H, W, 3)`` of a window that slides over a traced press, evenly spread; none for a miss."""
    assert isinstance(scene.renderer, ForcePatchRenderer), "the caller chose a scene with force patches"
    assert contact.trace is not None, "the press is traced"
    in_contact = contact.trace.time[contact.trace.force.any(axis=1)]
    if not in_contact.size:
        return []
    windows = list(scene.renderer.windows(contact, np.ptp(in_contact) / number))
    chosen = np.linspace(0, len(windows) - 1, number).round().astype(int)
    return [read_out(windows[index], scene.faults, rng) for index in chosen]


def image_path(folder: Path, scene: Scene, split: str, number: int, index: int = 0) -> Path:
    """The path of an image of an object; its first one is written last."""
    label = scene.shape_labels[number % len(scene.shapes)]
    return folder / split / in_file_name(label, "-") / f"{number:06d}-{index:03d}.png"


def images_of(scene: Scene, plan: CollectionPlan, split: str, number: int) -> list[NDArray[np.uint8]]:
    """The images of one object of a plan; row 0 is the lowest z of the pad. They depend on scene and plan only."""
    return [image for touch in touch_object(scene, plan, split, number, _images) for image in touch]


def write_images(images: Sequence[NDArray[np.uint8]], folder: Path, scene: Scene, split: str, number: int) -> None:
    """Write the images of an object as ``SPLIT/SHAPE/OBJECT-IMAGE.png``."""
    image_path(folder, scene, split, number).parent.mkdir(parents=True, exist_ok=True)
    for index in reversed(range(len(images))):
        with atomic_path(image_path(folder, scene, split, number, index)) as temporary:
            Image.fromarray(images[index]).save(temporary)


def _images(
    scene: Scene, obj: WorldObject, number: int, pose: int, rng: np.random.Generator
) -> list[NDArray[np.uint8]]:
    """The images of one touch."""
    pressed = scene.press(obj, pose, rng, attempts=1)
    if isinstance(scene.renderer, ForcePatchRenderer) and pressed.contact.trace is not None:
        return window_images(scene, pressed.contact, WINDOWS, rng)
    return [pressed.image]
