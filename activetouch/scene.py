"""A scene: which shapes, poses and pad there are, how a press is made, and what is left to chance.

A :class:`Scene` is a complete, frozen description; ``scene.press(object, pose, rng)`` is one touch of it.
The default is the leanest world in which the search makes sense: a pad and one object, no robot.

    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> scene = Scene(press_model=Quasistatic())
    >>> thing = scene.sample_object(shape_index=3, rng=rng)        # a cone, unknown size and orientation
    >>> contact, image = scene.press(thing, pose=0, rng=rng)
    >>> image.shape, image.dtype, round(contact.force, 1)
    ((128, 128), dtype('uint8'), 2.6)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from activetouch.contact import Contact, surface_gap
from activetouch.pad import Pad
from activetouch.placement import Placement
from activetouch.poses import POSES, Quaternion, multiply, random_orientation
from activetouch.press import Dynamic, Press, Quasistatic
from activetouch.rendering import Imperfection, PressureRenderer, TactileRenderer
from activetouch.shapes import SHAPES, Shape

__all__ = ["Dynamic", "Quasistatic", "Scene", "Variation", "WorldObject"]


@dataclass(frozen=True)
class Variation:
    """What differs from object to object and from press to press; all uniform, in the given half-ranges.

    Attributes:
        size: relative size of an object around nominal.
        offset: of an object's centre from the approach axis, along y and z [m].
        min_force, max_force: range of the force stop [N].
    """

    size: float = 0.10
    offset: float = 0.002
    min_force: float = 1.5
    max_force: float = 3.0


@dataclass(frozen=True, eq=False)
class WorldObject:
    """One physical object: its shape, its size factor, and the orientation it keeps for the episode (``wxyz``)."""

    shape_index: int
    scale: float
    orientation: Quaternion


@dataclass(frozen=True)
class Scene:
    """Everything that decides what touches look like.

    Attributes:
        shapes: the shapes an object may have, by label; their order is the shape index.
        poses: the exploration poses, by label; their order is the pose index.
        pad: the tactile pad.
        press_model: how a press comes to its force, :class:`Dynamic` or :class:`Quasistatic`.
        renderer: from contact to ideal image.
        imperfection: from ideal image to sensor reading.
        variation: nuisances of objects and presses.
    """

    shapes: Mapping[str, Shape] = field(default_factory=lambda: SHAPES)
    poses: Mapping[str, Quaternion] = field(default_factory=lambda: POSES)
    pad: Pad = field(default_factory=Pad)
    press_model: Press = field(default_factory=Dynamic)
    renderer: TactileRenderer = field(default_factory=PressureRenderer)
    imperfection: Imperfection = field(default_factory=Imperfection)
    variation: Variation = field(default_factory=Variation)

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """Names of the shapes, in index order."""
        return tuple(self.shapes)

    @property
    def pose_labels(self) -> tuple[str, ...]:
        """Names of the poses, in index order."""
        return tuple(self.poses)

    def sample_object(self, shape_index: int, rng: np.random.Generator) -> WorldObject:
        """An object of the given shape with random size and uniformly random orientation (``tumbled``)."""
        if not 0 <= shape_index < len(self.shapes):
            raise ValueError(f"shape_index must be in [0, {len(self.shapes)}), got {shape_index}")
        scale = 1.0 + rng.uniform(-self.variation.size, self.variation.size)
        return WorldObject(shape_index, float(scale), random_orientation(rng))

    def press(self, thing: WorldObject, pose: int, rng: np.random.Generator) -> tuple[Contact, NDArray[np.uint8]]:
        """Press an object in a pose: the contact and the sensor's image of it, ``(num_taxels, num_taxels)``.

        Raises:
            UnstablePress: the simulation diverged.
        """
        variation = self.variation
        offset = rng.uniform(-variation.offset, variation.offset, size=2)
        target_force = float(rng.uniform(variation.min_force, variation.max_force))
        shape = self.shapes[self.shape_labels[thing.shape_index]]
        orientation = multiply(self.poses[self.pose_labels[pose]], thing.orientation)
        placement = Placement(shape, thing.scale, orientation, offset)
        gap = surface_gap(self.pad, placement)
        force = self.press_model.force(self.pad, placement, target_force) if np.isfinite(gap).any() else 0.0
        contact = Contact(self.pad, gap, force)
        return contact, self.imperfection(self.renderer(contact), rng)
