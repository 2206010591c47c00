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
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Constant, Distribution, Uniform
from activetouch.errors import BadMesh, UnstablePress
from activetouch.orientations import Presentation, Tumbled
from activetouch.placement import Placement
from activetouch.poses import POSES, Quaternion
from activetouch.pressing.contact import Contact
from activetouch.pressing.dynamic import Dynamic
from activetouch.pressing.pad import Pad
from activetouch.pressing.press import Press, Quasistatic
from activetouch.pressing.robot import ROBOTS, Robot
from activetouch.pressing.setup import Stage
from activetouch.rendering import Fault, Gain, Noise, PressureRenderer, TactileRenderer, read_out
from activetouch.rendering.renderer import require_image, require_renderer
from activetouch.shapes import SHAPES, Mesh, Shape
from belief.errors import UnknownName

__all__ = ["Dynamic", "Quasistatic", "Scene", "Symmetry", "Variation", "WorldObject"]

_MOST_PRESSES = 10  # for one touch


class Symmetry(StrEnum):
    """Which changes of an image leave it exactly as likely, for every shape."""

    NONE = "none"
    ROTATIONS = "rotations"
    ROTATIONS_AND_MIRROR = "rotations and mirror"


@dataclass(frozen=True)
class Variation:
    """What differs from object to object (size, friction, stiffness) and from press to press (offset, force).

    Attributes:
        size: factor on an object's nominal size.
        offset: of an object's centre from the approach axis, along y and along z [m].
        force: at which the motion stops [N].
        friction: coefficient between an object and the pad.
        stiffness: of the pad's layer together with an object's skin, relative to the pad's alone.
    """

    size: Distribution = field(default_factory=lambda: Uniform(0.9, 1.1))
    offset: Distribution = field(default_factory=lambda: Uniform(-0.002, 0.002))
    force: Distribution = field(default_factory=lambda: Uniform(1.5, 3.0))
    friction: Distribution = field(default_factory=lambda: Constant(1.0))
    stiffness: Distribution = field(default_factory=lambda: Constant(1.0))

    def sample_offset(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Displacement of one press, along y and along z [m], ``(2,)``."""
        return np.array([self.offset.sample(rng) for _ in range(2)])


@dataclass(frozen=True, eq=False)
class WorldObject:
    """One physical object, as it is for a whole episode.

    Attributes:
        shape_index: what it is.
        scale: its size factor.
        orientation: in which it was put on its guide, ``wxyz``.
        friction: coefficient of its surface.
        stiffness: of its skin together with the pad's layer, relative to the layer's alone.
    """

    shape_index: int
    scale: float
    orientation: Quaternion
    friction: float = 1.0
    stiffness: float = 1.0


@dataclass(frozen=True)
class Scene:
    """Everything that decides what touches look like.

    Attributes:
        shapes: the shapes an object may have, by label; their order is the shape index. A path, or its text, stands
            for the solid in that mesh file.
        poses: the exploration poses, by label; their order is the pose index.
        pad: the tactile pad.
        press_model: how a press comes to its force (:mod:`activetouch.pressing.press`).
        renderer: from contact to ideal image, by the rule of :class:`activetouch.rendering.TactileRenderer`.
        faults: from ideal image to sensor reading, in turn.
        variation: nuisances of objects and presses.
        presentation: how objects lie before a pose turns them.
        height: of the pad above the floor [m].
        finger: whether to model the finger that carries the pad.
        parking: whether to load all objects at once, and park those that are not pressed.
        robot: that stands behind the pad, by name or in detail; none by default.
    """

    shapes: Mapping[str, Shape | Path | str] = field(default_factory=lambda: SHAPES)
    poses: Mapping[str, Quaternion] = field(default_factory=lambda: POSES)
    pad: Pad = field(default_factory=Pad)
    press_model: Press = field(default_factory=Dynamic)
    renderer: TactileRenderer = field(default_factory=PressureRenderer)
    faults: tuple[Fault, ...] = (Gain(0.10), Noise(0.02))
    variation: Variation = field(default_factory=Variation)
    presentation: Presentation = field(default_factory=Tumbled)
    height: float = 0.0
    finger: bool = False
    parking: bool = False
    robot: Robot | str | None = None

    def __post_init__(self) -> None:
        if not self.shapes or not self.poses:
            raise ValueError("a scene needs at least one shape and one pose")
        object.__setattr__(self, "poses", dict(self.poses))  # plain, so that a scene can be sent to another process
        solids = {k: Mesh.from_file(v) if isinstance(v, Path | str) else v for k, v in self.shapes.items()}
        for label, solid in solids.items():
            if not all(hasattr(solid, member) for member in ("bounding_radius", "geom", "entry_distance")):
                raise BadMesh(
                    f"the shape {label!r} is {solid!r}; a shape is a solid such as Sphere(0.02), or the path of a mesh "
                    "file (STL, OBJ, PLY, OFF) in metres; Mesh.from_file(path, scale=0.001) reads one in millimetres"
                )
        object.__setattr__(self, "shapes", solids)
        require_renderer(self.renderer)
        if isinstance(self.robot, str):
            if self.robot not in ROBOTS:
                raise UnknownName("robot", self.robot, list(ROBOTS))
            object.__setattr__(self, "robot", ROBOTS[self.robot])

    @property
    def stage(self) -> Stage:
        """What a press takes place in."""
        loaded = tuple(self.shapes.values()) if self.parking else ()
        return Stage(self.pad, self.height, self.finger, loaded, self.robot)

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """Names of the shapes, in index order."""
        return tuple(self.shapes)

    @property
    def pose_labels(self) -> tuple[str, ...]:
        """Names of the poses, in index order."""
        return tuple(self.poses)

    @property
    def image_shape(self) -> tuple[int, ...]:
        """Of one image, ``(H, W)`` or ``(H, W, 3)``: that of an object which misses the pad."""
        nothing = np.zeros((self.pad.num_taxels, self.pad.num_taxels))
        return self.image(Contact(self.pad, np.full_like(nothing, np.inf), 0.0, nothing, nothing)).shape

    def image(self, contact: Contact) -> NDArray[np.floating]:
        """The ideal image of a contact.

        Raises:
            WrongRenderer: the renderer gave something that is no image.
        """
        return require_image(self.renderer(contact), self.renderer)

    @property
    def symmetry(self) -> Symmetry:
        """How its images may be turned by quarters and mirrored without becoming less likely.

        Nothing may be turned where up and down differ (objects stand upright) or the sensor has a direction (coloured
        lights, broken taxels); nothing mirrored that may not be its own mirror image, as a user's mesh.
        """
        if not all(part.isotropic for part in (self.presentation, self.renderer, *self.faults)):
            return Symmetry.NONE
        if any(isinstance(shape, Mesh) for shape in self.shapes.values()):
            return Symmetry.ROTATIONS
        return Symmetry.ROTATIONS_AND_MIRROR

    def sample_object(self, shape_index: int, rng: np.random.Generator) -> WorldObject:
        """An object of the given shape with random size, surface and orientation."""
        if not 0 <= shape_index < len(self.shapes):
            raise ValueError(f"shape_index must be in [0, {len(self.shapes)}), got {shape_index}")
        vary = self.variation
        scale, friction, stiffness = vary.size.sample(rng), vary.friction.sample(rng), vary.stiffness.sample(rng)
        return WorldObject(shape_index, scale, self.presentation.rest(rng), friction, stiffness)

    def place(self, thing: WorldObject, pose: int, rng: np.random.Generator) -> Placement:
        """Put an object in front of the pad, in a pose."""
        if not 0 <= pose < len(self.poses):
            raise ValueError(f"pose must be in [0, {len(self.poses)}), got {pose}")
        offset = self.variation.sample_offset(rng)
        shown = self.presentation.shown(thing.orientation, self.poses[self.pose_labels[pose]], rng)
        shape = self.shapes[self.shape_labels[thing.shape_index]]
        return Placement(shape, thing.scale, shown, offset, thing.friction, thing.stiffness)

    def contact(self, placement: Placement, rng: np.random.Generator) -> Contact:
        """Press what is placed, with a random force.

        Raises:
            UnstablePress: the simulation diverged.
        """
        return self.press_model.press(self.stage, placement, self.variation.force.sample(rng))

    def settled_contact(
        self, thing: WorldObject, pose: int, rng: np.random.Generator
    ) -> tuple[Placement, Contact, int]:
        """Press an object in a pose, again with other nuisances where a press does not settle (decision 0020).

        Returns:
            Where the object was, the contact, and how many presses before did not settle.

        Raises:
            UnstablePress: again and again it did not settle.
        """
        for again in range(_MOST_PRESSES):
            placement = self.place(thing, pose, rng)
            try:
                return placement, self.contact(placement, rng), again
            except UnstablePress as error:
                last = error
        raise UnstablePress(f"none of {_MOST_PRESSES} presses for one touch settled; the last one: {last}") from last

    def press(self, thing: WorldObject, pose: int, rng: np.random.Generator) -> tuple[Contact, NDArray[np.uint8]]:
        """Press an object in a pose: the contact, and the sensor's image of it, ``(n, n)`` or ``(n, n, 3)``.

        Raises:
            UnstablePress: the simulation diverged.
        """
        contact = self.contact(self.place(thing, pose, rng), rng)
        return contact, read_out(self.image(contact), self.faults, rng)
