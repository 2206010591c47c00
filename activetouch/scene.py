"""A scene: which shapes, poses and pad there are, how a press is made, and what is left to chance.

A :class:`Scene` is a complete, frozen description; ``scene.press(object, pose, rng)`` is one touch of it.
The default is the leanest world in which the search makes sense: a pad and one object.

    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> scene = Scene(press_model=Quasistatic())
    >>> obj = scene.sample_object("cone", rng)        # a cone, unknown size and orientation
    >>> pressed = scene.press(obj, "front", rng)
    >>> pressed.image.shape, pressed.image.dtype, round(pressed.contact.force, 1)
    ((128, 128), dtype('uint8'), 2.6)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from activetouch.distributions import Bodies, Variation, member_shares, sizes
from activetouch.errors import BadMesh, UnstablePress, WrongScene
from activetouch.orientations import Moves, Presentation, Tumbled
from activetouch.poses import (
    POSE_SETS,
    POSES,
    Placement,
    Quaternion,
    WorldObject,
    checked_aims,
    multiply,
    require_unit,
    to_matrix,
)
from activetouch.pressing.contact import Contact, Pad, Press, PressedObject, Quasistatic, missed
from activetouch.pressing.dynamic import Dynamic, SteppedPress
from activetouch.rendering import Fault, Gain, Noise, PressureRenderer, TactileRenderer, read_out
from activetouch.rendering.faults import require_faults
from activetouch.rendering.renderer import require_image, require_renderer
from activetouch.shapes import SHAPES, is_own_mirror_image
from activetouch.solids.family import Family
from activetouch.solids.solid import Shape, require_hash, require_size
from belief.errors import InvalidArgument, UnknownName
from belief.naming import Name, few, index_of, one_line
from belief.validation import require_count

if TYPE_CHECKING:
    from activetouch.hand import Hand
    from activetouch.pressing.surroundings import Surroundings

__all__ = ["Dynamic", "PressedObject", "Quasistatic", "Scene", "Symmetry", "Variation", "WorldObject"]

MOST_ATTEMPTS = 10
"""Presses for one touch, where presses do not settle."""


class Symmetry(StrEnum):
    """Which changes of an image leave it exactly as likely, for every shape."""

    NONE = "none"
    ROTATIONS = "rotations"
    ROTATIONS_AND_MIRROR = "rotations and mirror"


@dataclass(frozen=True)
class Scene:
    """Everything that decides what touches look like.

    Attributes:
        shapes: the shapes an object may have, by label; their order is the shape index. A path, or text such as
            ``"mug.obj@0.001"``, stands for the solid in that mesh file (:mod:`activetouch.mesh_source`). Objects
            whose shape is a :class:`activetouch.shapes.Family` differ in their proportions.
        poses: the exploration poses, by label; their order is the pose index. A name stands for a set of
            :data:`activetouch.poses.POSE_SETS`: ``"mix"`` or ``"directions26"``.
        pad: the tactile pad.
        press_model: how a press comes to its force (:mod:`activetouch.pressing.contact`).
        renderer: from contact to ideal image, by the rule of :class:`activetouch.rendering.TactileRenderer`.
        faults: from ideal image to sensor reading, in turn.
        variation: nuisances of objects and presses.
        presentation: how objects lie before a pose turns them.
        aims: where a pose brings the object's centre, from the approach axis along y and z [m], by label of the pose;
            to the axis where nothing is said. The offset of the variation is added. :func:`activetouch.poses.aimed`
            makes poses and aims.
        hand: whose pads close on the object in each pose, quasistatically or by ``Closing``; None for the pad alone.
        moves: how objects move between touches; None for objects that stay. Where fingers close on an object that is
            free to turn, it lies as a grasp leaves it, and this is what the belief expects.
    """

    shapes: Mapping[str, Shape | Family | Path | str] = field(default_factory=lambda: SHAPES)
    poses: Mapping[str, Quaternion] | str = field(default_factory=lambda: POSES)
    pad: Pad = field(default_factory=Pad)
    press_model: Press = field(default_factory=Dynamic)
    renderer: TactileRenderer = field(default_factory=PressureRenderer)
    faults: tuple[Fault, ...] = (Gain(0.10), Noise(0.02))
    variation: Variation = field(default_factory=Variation)
    presentation: Presentation = field(default_factory=Tumbled)
    aims: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    hand: Hand | None = None
    moves: Moves | None = None

    def __post_init__(self) -> None:
        if not self.shapes or not self.poses:
            raise ValueError("a scene needs at least one shape and one pose")
        if isinstance(self.poses, str):
            if self.poses not in POSE_SETS:
                raise UnknownName("set of poses", self.poses, list(POSE_SETS))
            object.__setattr__(self, "poses", POSE_SETS[self.poses])
        object.__setattr__(self, "poses", dict(self.rotations))  # plain, so that a scene can be sent to another process
        for label, rotation in self.rotations.items():
            require_unit(f"the pose {label!r}", rotation)
        object.__setattr__(self, "aims", checked_aims(self.aims, self.rotations))
        solids = dict(self.shapes)
        if files := {label: file for label, file in solids.items() if isinstance(file, Path | str)}:
            from activetouch.mesh_source import MeshSource

            solids |= {label: MeshSource.parse(file).read() for label, file in files.items()}
        object.__setattr__(self, "shapes", solids)
        for label, solid in self.solids.items():
            members = ("bounding_radius", "geom", "surface")  # of the class, so that no property is computed
            if missing := [m for m in members if not (hasattr(type(solid), m) or hasattr(solid, m))]:
                raise BadMesh(
                    f"the shape {label!r} is {solid!r}, without {', '.join(missing)}; a shape is a solid such as "
                    "Sphere(0.02), or the path of a mesh file; 'mug.stl@0.001' is the text for one in "
                    "millimetres"
                )
        require_renderer(self.renderer)
        require_faults(self.faults)
        for name, kind in (("pad", Pad), ("variation", Variation)):
            if not isinstance(getattr(self, name), kind):
                raise InvalidArgument(f"{name} must be a {kind.__name__}, got {getattr(self, name)!r}")
        for name, method, works in (("press_model", "press", "Dynamic()"), ("presentation", "shown", "Tumbled()")):
            given = getattr(self, name)
            if isinstance(given, type) or not callable(getattr(given, method, None)):
                raise InvalidArgument(f"{name} must be an object such as {works}, got {given!r}")
        if self.hand is not None:
            from activetouch.hand import hand_named

            object.__setattr__(self, "hand", hand_named(self.hand))
            if not self.press_model.closes:
                raise InvalidArgument(f"a hand closes by Quasistatic() or Closing(), not by {self.press_model!r}")
        is_held = self.hand is not None and not self.press_model.lets_turn(len(self.hand))
        if self.moves is not None and (is_held or not isinstance(self.moves, Moves)):
            raise InvalidArgument(
                "moves must be Moves(), and a hand must close by Closing(), in which objects turn, one finger by "
                f"Closing(grip=0.01); got {self.moves!r} and {self.press_model!r}"
            )
        if self.pad.layout is not None and getattr(self.press_model, "moves", False):
            raise InvalidArgument(f"a pad with a layout is pressed by Quasistatic(), not by {self.press_model!r:.80}")
        if getattr(self.press_model, "moves", False):  # in a MuJoCo model, which is kept by its shape
            for label, solid in self.solids.items():
                require_hash(label, solid)

    def __eq__(self, other: object) -> bool:
        """Whether all parts are equal, with shapes and poses in the same order."""
        return self._parts() == other._parts() if isinstance(other, Scene) else NotImplemented

    def _parts(self) -> list[Any]:
        poses = [(label, np.asarray(rotation).tolist()) for label, rotation in self.rotations.items()]
        others = [getattr(self, part.name) for part in fields(self) if part.name not in ("shapes", "poses")]
        return [list(self.shapes.items()), poses, *others]

    @property
    def solids(self) -> Mapping[str, Shape]:
        """The shapes by label, all of them solids: those of mesh files, and the nominal solids of families."""
        solids = {label: shape.nominal if isinstance(shape, Family) else shape for label, shape in self.shapes.items()}
        return cast(Mapping[str, Shape], solids)

    @property
    def families(self) -> Mapping[str, Family]:
        """The shapes whose proportions differ from object to object, by label."""
        return {label: shape for label, shape in self.shapes.items() if isinstance(shape, Family)}

    @property
    def rotations(self) -> Mapping[str, Quaternion]:
        """The poses by label, all of them rotations: a named set was looked up at construction."""
        return cast(Mapping[str, Quaternion], self.poses)

    @property
    def aim_offsets(self) -> NDArray[np.float64]:
        """Where each pose brings the object's centre, from the approach axis along y and z [m], ``(P, 2)``."""
        return np.array([self.aims.get(label, (0.0, 0.0)) for label in self.rotations])

    @property
    def reach(self) -> float:
        """Distance from an aim at which no object of the scene meets the pad [m]."""
        size = self.variation.size.support[1]
        return 2.0 * self.pad.half_width + size * max(solid.bounding_radius for solid in self.solids.values())

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """Names of the shapes, in index order."""
        return tuple(self.shapes)

    @property
    def pose_labels(self) -> tuple[str, ...]:
        """Names of the poses, in index order."""
        return tuple(self.rotations)

    @property
    def image_shape(self) -> tuple[int, ...]:
        """Of one image, ``(H, W)`` or ``(H, W, 3)``; of a grasp as :meth:`activetouch.hand.Hand.joined` makes it."""
        height, width, *channels = self.image(missed(self.pad)).shape
        if self.hand is not None:
            width = len(self.hand) * (width + (self.hand.travel is not None))
        return height, width, *channels

    @property
    def fingers(self) -> tuple[Scene, ...]:
        """Of each finger of the hand, the scene of its pad alone, in whose poses it meets the same; or this scene."""
        each = [] if self.hand is None else self.hand.single(self.rotations, self.aims)
        return tuple(replace(self, hand=None, poses=poses, aims=aims) for poses, aims in each) or (self,)

    def around(self, shape: Shape) -> Surroundings | None:
        """What a press of a shape simulates besides pad and object."""
        found = getattr(self.press_model, "surroundings", None)
        return None if found is None else found.beside(shape)

    def with_surroundings(self, full: bool = True, menagerie: Path | None = None) -> Scene:
        """The scene in the paper's world, whose touches are the same to the last bit (decision 0013).

        Args:
            full: whether to simulate a finger behind the pad, and the other objects, parked on their guides.
            menagerie: copy of MuJoCo Menagerie, whose Panda arm then stands behind the pad with the Allegro hand.

        Raises:
            InvalidArgument: the scene has a hand, or its presses do not simulate motion.
        """
        from activetouch.pressing.surroundings import Surroundings  # loads MuJoCo

        if self.hand is not None or not isinstance(self.press_model, SteppedPress):
            raise InvalidArgument("--full and --robot need --fidelity dynamic or guarded_move, and no --hand")
        around = Surroundings(tuple(self.solids.values()) if full else (), menagerie)
        return replace(self, press_model=replace(self.press_model, surroundings=around))  # type: ignore[type-var]

    def with_hand(self, hand: Hand | str, press_model: Press | None = None) -> Scene:
        """The scene with a hand, or one of :data:`activetouch.hand.HANDS` by name, closed quasistatically by default.

        Raises:
            UnknownName: there is no hand of this name.
        """
        from activetouch.hand import hand_named

        return replace(self, hand=hand_named(hand), press_model=press_model or Quasistatic())

    def image(self, contact: Contact) -> NDArray[np.floating]:
        """The ideal image of a contact.

        Raises:
            WrongRenderer: the renderer gave something that is no image.
        """
        return require_image(self.renderer(contact), self.renderer)

    @property
    def symmetry(self) -> Symmetry:
        """How its images may be turned by quarters and mirrored without becoming less likely.

        Nothing may be turned where up and down differ (objects stand upright, or the variation or an aim presses them
        beside the middle) or the sensor has a direction (coloured lights, broken taxels); nothing mirrored that may not
        be its own mirror image, as a user's mesh.
        """
        parts: tuple[Presentation | TactileRenderer | Fault, ...] = (self.presentation, self.renderer, *self.faults)
        if self.hand is not None or not all(part.isotropic for part in parts):
            return Symmetry.NONE
        low, high = self.variation.offset.support
        if low != -high or self.aims:
            return Symmetry.NONE
        if not all(map(is_own_mirror_image, self.solids.values())):
            return Symmetry.ROTATIONS
        return Symmetry.ROTATIONS_AND_MIRROR

    def __repr__(self) -> str:
        parts = (self.press_model, self.renderer, self.presentation)
        names = (getattr(part, "__name__", type(part).__name__) for part in parts)
        return one_line(Scene, few(self.shape_labels), f"{len(self.poses)} poses", *names)

    def sample_object(self, shape: Name, rng: np.random.Generator) -> WorldObject:
        """An object with random size, surface and orientation, and random proportions if its shape is a family.

        Args:
            shape: its label or index.
            rng: of its size, surface and orientation, then of its proportions, and of its position if a hand keeps it.

        Raises:
            UnknownName: the scene has no shape of that name.
            InvalidArgument: its size is one in another unit.
        """
        shape_index = index_of("shape", self.shape_labels, shape)
        label, vary = self.shape_labels[shape_index], self.variation
        require_size(label, self.solids[label].bounding_radius)
        scale, friction, stiffness = vary.size.sample(rng), vary.friction.sample(rng), vary.stiffness.sample(rng)
        rest, family = self.presentation.rest(rng), self.families.get(label)
        member = family.sample(rng) if family else None
        is_kept = self.hand is not None and self.hand.offset == "kept"
        offset = np.array([vary.offset.sample(rng) for _ in range(3)]) if is_kept else None
        return WorldObject(shape_index, scale, rest, friction, stiffness, member, offset)

    def bodies(self, shape: Name, shares: NDArray[np.float64]) -> tuple[tuple[Shape, ...], NDArray[np.int64]]:
        """The solids of hypotheses of a shape, and which of them each hypothesis has.

        Hypotheses of a family share at most 64 members, so that geometry need not be computed for each hypothesis. Any
        other shape has one solid.

        Args:
            shape: label or index.
            shares: where each hypothesis is in a family, ``(N,)``, of :func:`activetouch.distributions.member_shares`.
                It is the same for all shapes; a part of it gives a part of the hypotheses.

        Returns:
            The M different solids at nominal size, and for each hypothesis the index of one, ``(N,)``.

        Raises:
            UnknownName: the scene has no shape of that name.
            InvalidArgument: the shares are not in [0, 1).
        """
        if not ((shares >= 0.0) & (shares < 1.0)).all():  # False for NaN
            raise InvalidArgument(
                f"shares must be in [0, 1), from activetouch.distributions.member_shares; got {shares!r:.80}"
            )
        label = self.shape_labels[index_of("shape", self.shape_labels, shape)]
        if label in self.families:
            return self.families[label].bodies(shares)
        return (self.solids[label],), np.zeros(len(shares), np.int64)

    def hypotheses(self, num: int) -> Bodies:
        """Hypotheses about an object, as many as asked for, the same for all shapes.

        They cover the orientations and sizes of objects evenly.
        """
        return Bodies(self.presentation.rests(num), sizes(self.variation.size, num), member_shares(num))

    def with_pose(self, quaternion: ArrayLike, aim: ArrayLike) -> Scene:
        """The scene with one more pose, the last: a quaternion (w, x, y, z), and an aim along y and z [m]."""
        label = "elsewhere"
        while label in self.poses:
            label += "_"
        poses = {**self.rotations, label: np.asarray(quaternion, float)}
        return replace(self, poses=poses, aims={**self.aims, label: tuple(np.asarray(aim, float).tolist())})

    def place(self, obj: WorldObject, pose: Name, rng: np.random.Generator) -> Placement:
        """Put an object in front of the pad, in a pose, by its label or index."""
        label = self.pose_labels[index_of("pose", self.pose_labels, pose)]
        offset = self.variation.sample_offset(rng)
        if label in self.aims:
            offset += self.aims[label]
        if obj.offset is not None and self.hand is None:
            offset += (to_matrix(self.rotations[label]) @ obj.offset)[1:]
        shown = self.presentation.shown(obj.orientation, self.rotations[label], rng)
        solid = self.solids[self.shape_labels[obj.shape_index]] if obj.member is None else obj.member
        return Placement(solid, obj.scale, shown, offset, obj.friction, obj.stiffness)

    def contact(self, placement: Placement, rng: np.random.Generator) -> Contact:
        """Press what is placed, with a random force.

        Raises:
            UnstablePress: the simulation diverged.
        """
        return self.press_model.press(self.pad, placement, self.variation.force.sample(rng))

    def press(
        self,
        obj: WorldObject,
        pose: Name,
        rng: np.random.Generator,
        force_rng: np.random.Generator | None = None,
        attempts: int = MOST_ATTEMPTS,
    ) -> PressedObject:
        """Press an object in a pose: place it, press it, render the contact, and read the image out.

        A press that does not settle is repeated with another offset and force from the same generators (decision 0003).

        Args:
            obj: the object.
            pose: label or index of the pose.
            rng: of the offset, the shown orientation and the sensor's faults, and of the force unless it has its own.
            force_rng: of the force.
            attempts: presses at most, at least 1.

        Raises:
            UnstablePress: no press settled.
            InvalidArgument: ``attempts`` is no integer ≥ 1.
        """
        require_count("attempts", attempts)
        force_rng = rng if force_rng is None else force_rng
        for num_unsettled in range(attempts):
            try:
                if self.hand is not None:
                    return self._grasp(self.hand, obj, pose, rng, force_rng)._replace(num_unsettled=num_unsettled)
                placement = self.place(obj, pose, rng)
                contact = self.contact(placement, force_rng)
            except UnstablePress as error:
                last = error
                continue
            ideal = self.image(contact)
            image = read_out(ideal, self.faults, rng)
            return PressedObject(contact, image, num_unsettled, placement, ideal, (contact,))
        if attempts == 1:
            raise last
        raise UnstablePress(f"none of {attempts} presses for one touch settled; the last one: {last}") from last

    def _grasp(
        self, hand: Hand, obj: WorldObject, pose: Name, rng: np.random.Generator, force_rng: np.random.Generator
    ) -> PressedObject:
        """Close all fingers on a body in the palm: their images, side by side."""
        in_palm, depth = self.place_in_palm(obj, pose, rng)
        met, centre = hand.placements(in_palm, depth), np.array([depth, *in_palm.offset])
        forces = (hand.forces * self.variation.force.sample(force_rng)).tolist()
        found = self.press_model.close(self.pad, met, hand.rotations, centre, forces)
        ideals = [self.image(contact) for contact in found.contacts]
        images = [read_out(ideal, self.faults, rng) for ideal in ideals]
        stops = np.zeros(len(hand)) if hand.travel is None else rng.normal(np.nan_to_num(found.stops), hand.travel)
        image, ideal = hand.joined(images, stops), np.concatenate(ideals, axis=1)
        held, undone = np.array(hand.fingers[0]), np.array([1.0, -1.0, -1.0, -1.0])
        turned = multiply(multiply(held, found.met[0].orientation), multiply(held, met[0].orientation) * undone)
        rotation = self.rotations[self.pose_labels[index_of("pose", self.pose_labels, pose)]]
        left = multiply(rotation * undone, multiply(turned, multiply(rotation, obj.orientation)))
        return PressedObject(found.contacts[0], image, 0, in_palm, ideal, found.contacts, left)

    def place_in_palm(self, obj: WorldObject, pose: Name, rng: np.random.Generator) -> tuple[Placement, float]:
        """An object in the palm, in front of a finger that is not turned, and its depth along the palm's x axis [m]."""
        in_palm, hand = self.place(obj, pose, rng), self.hand
        depth = self.variation.offset.sample(rng) if hand and (len(hand) > 1 or hand.travel is not None) else 0.0
        if obj.offset is not None:
            index = index_of("pose", self.pose_labels, pose)
            depth, *across = to_matrix(self.rotations[self.pose_labels[index]]) @ obj.offset
            in_palm = replace(in_palm, offset=self.aim_offsets[index] + across)
        return in_palm, depth


def require_no_hand(hand: Hand | None, what: str) -> None:
    """Check that there is no hand."""
    if hand is not None:
        raise WrongScene(f"{what} takes single touches, and the scene has a hand of {len(hand)}; leave it out")
