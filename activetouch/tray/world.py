"""A tray in which objects lie at places that nobody knows, and a pad that comes down on a place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from activetouch.pressing.contact import elastic_contact
from activetouch.rendering import read_out
from activetouch.scene import Scene
from activetouch.solids.solid import Floats, Shape
from activetouch.tray.resting import Rests, about_vertical, heights_above_floor, rests
from belief.constraints import Checked, Count, Probability, Within
from belief.errors import InvalidArgument

_ATTEMPTS = 10_000  # at placing the objects of a tray
_OUTLINE = 36  # directions in which outlines are compared
_Edge: TypeAlias = Annotated[float, Within(0.01, 3.0, unit=" m")]
_Factor: TypeAlias = Annotated[float, Within(0.01, 100.0)]
_Length: TypeAlias = Annotated[float, Within(0.0, 0.1, unit=" m")]


@dataclass(frozen=True)
class Tray(Checked):
    """A tray and what lies in it.

    Attributes:
        size: along x and y [m].
        num_objects: in it; their shapes differ.
        present: probability that one of them has the target's shape.
        gap: smallest distance of two objects, and of an object from the walls [m].
        height_noise: standard deviation of the measured height of a contact [m].
        unlisted: probability of each object but the target that it has none of the shapes.
        push: largest distance along x and y by which a touch moves the object that it meets [m], at most 5 mm.
        sizes: smallest and largest factor of an object's size.
    """

    size: tuple[_Edge, _Edge] = (0.4, 0.3)
    num_objects: Count = 6
    present: Probability = 0.8
    gap: _Length = 0.004
    height_noise: _Length = 0.0003
    unlisted: Probability = 0.0
    push: Annotated[float, Within(0.0, 0.005)] = 0.0
    sizes: tuple[_Factor, _Factor] = (0.97, 1.03)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sizes[0] > self.sizes[1]:
            raise InvalidArgument(f"the smallest of the sizes must not exceed the largest, got {self.sizes}")


class Lying(NamedTuple):
    """One object in a tray: index of its shape, size factor, rotation to the tray's frame, and place (x, y, z) [m]."""

    shape: int
    scale: float
    rotation: Floats
    place: Floats


class Poke(NamedTuple):
    """What a pad meets that comes down on a place: height above the floor [m], and image; neither for a miss.

    ``met`` is the number of the object, which only a simulation knows; None for a miss.
    """

    height: float
    image: NDArray[np.uint8] | None
    met: int | None


@dataclass(eq=False)
class TrayWorld:
    """Objects in a tray, and the presses of a scene's pad on them.

    Attributes:
        scene: shapes, pad, forces, renderer and faults.
        tray: where they lie.
        objects: as they lie now; the index of a stranger's shape is K and more.
        strangers: shapes that are not of the scene.
    """

    scene: Scene
    tray: Tray
    objects: list[Lying] = field(default_factory=list)
    strangers: tuple[Shape, ...] = ()

    @classmethod
    def drawn(
        cls, scene: Scene, tray: Tray, target: int, rng: np.random.Generator, strangers: Sequence[Shape] = ()
    ) -> TrayWorld:
        """A tray with random objects: the target is there with the tray's probability, the others differ.

        Args:
            scene: with the shapes.
            tray: how many there are, and how they lie.
            target: index of the shape sought.
            rng: generator of shapes and places.
            strangers: other shapes, which objects have with the probability ``tray.unlisted``.

        Raises:
            InvalidArgument: there are fewer shapes than objects, or the objects do not fit in the tray.
        """
        others = np.delete(np.arange(len(scene.shapes)), target)
        is_there = rng.uniform() < tray.present
        if len(others) < tray.num_objects - is_there:
            raise InvalidArgument(f"{tray.num_objects} objects of different shapes need more than {len(others)} others")
        shapes = rng.permutation(others)[: tray.num_objects - is_there].tolist()
        if strangers and tray.unlisted:
            numbers = len(scene.shapes) + rng.permutation(max(len(strangers), len(shapes))) % len(strangers)
            is_strange = rng.uniform(size=len(shapes)) < tray.unlisted
            shapes = np.where(is_strange, numbers[: len(shapes)], shapes).tolist()
        world = cls(scene, tray, strangers=tuple(strangers))
        world.objects = _arranged(world.solids, tray, shapes + [target] * is_there, rng)
        return world

    @property
    def solids(self) -> tuple[Shape, ...]:
        """The shapes of the scene, then strangers."""
        return (*self.scene.solids.values(), *self.strangers)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of :attr:`solids`."""
        return (*self.scene.shape_labels, *(f"stranger {number + 1}" for number in range(len(self.strangers))))

    @property
    def lay(self) -> tuple[tuple[str, float, float], ...]:
        """Shape and place (x, y) of each object [m]."""
        return tuple((self.labels[one.shape], float(one.place[0]), float(one.place[1])) for one in self.objects)

    def press(self, x: float, y: float, rng: np.random.Generator) -> Poke:
        """Come down on a place of the tray until the pad carries the force or meets the floor."""
        scene, pad = self.scene, self.scene.pad
        force = float(scene.variation.force.sample(rng))
        seen = [self._seen(one, x, y) for one in self.objects]
        highest = np.array([-np.inf if one is None else one.max() for one in seen])
        if not len(seen) or highest.max() <= pad.max_depth * 0.1:
            return Poke(0.0, None, None)
        met = int(highest.argmax())
        top = np.maximum.reduce([one for one in seen if one is not None])
        contact = elastic_contact(pad, highest[met] - np.maximum(top, 0.0), force)
        image = read_out(scene.image(contact), scene.faults, rng)
        height = max(1e-6, highest[met] + self.tray.height_noise * float(rng.normal()))
        if self.tray.push:
            one = self.objects[met]
            moved = one.place + np.append(rng.uniform(-self.tray.push, self.tray.push, 2), 0.0)
            self.objects[met] = one._replace(place=moved)
        return Poke(float(height), image, met)

    def _seen(self, one: Lying, x: float, y: float) -> Floats | None:
        """Heights of an object above the floor over the taxels of a pad at a place; None out of reach."""
        pad, solid = self.scene.pad, self.solids[one.shape]
        along, across = one.place[0] - x, one.place[1] - y
        if max(abs(along), abs(across)) > solid.bounding_radius * one.scale + pad.half_width:
            return None
        pixel, place = 2.0 * pad.half_width / pad.num_taxels, np.array([[along, across]])
        turns = one.scale * one.rotation[None]
        return np.asarray(heights_above_floor(solid, turns, one.place[2:], place, pixel, pad.num_taxels)[0])


def _arranged(solids: Sequence[Shape], tray: Tray, shapes: list[int], rng: np.random.Generator) -> list[Lying]:
    """Objects of these shapes at random, without overlap."""
    angles = np.arange(_OUTLINE) * 2.0 * np.pi / _OUTLINE
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    found: list[Lying] = []
    outlines: list[Floats] = []
    for shape in shapes:
        solid, resting = solids[shape], rests_of(solids[shape])
        for _ in range(_ATTEMPTS):
            face = int(rng.choice(len(resting.probs), p=resting.probs))
            scale = float(rng.uniform(*tray.sizes))
            rotation = about_vertical(rng.uniform(0.0, 2.0 * np.pi, 1))[0] @ resting.rotations[face]
            support = scale * (directions @ (rotation[:2] @ solid.surface.vertices)).max(axis=1)
            margins = [
                (support[_OUTLINE * side // 4], support[_OUTLINE * side // 4 + _OUTLINE // 2]) for side in (0, 1)
            ]
            lows = np.array([margin[1] for margin in margins]) + tray.gap
            highs = np.array(tray.size) - [margin[0] for margin in margins] - tray.gap
            if (lows > highs).any():
                raise InvalidArgument(f"{solid!r:.80} does not fit in a tray of {tray.size} m")
            place = rng.uniform(lows, highs)
            if all(
                _apart(place, support, one.place[:2], other, directions) >= tray.gap
                for one, other in zip(found, outlines, strict=True)
            ):
                found.append(Lying(shape, scale, rotation, np.append(place, scale * resting.lifts[face])))
                outlines.append(support)
                break
        else:
            raise InvalidArgument(f"{tray.num_objects} objects do not fit in a tray of {tray.size} m without overlap")
    return found


def _apart(place: Floats, support: Floats, other: Floats, of_other: Floats, directions: Floats) -> float:
    """Distance of two outlines by their supports in the same directions [m]; negative if they overlap."""
    between = directions @ (other - place)
    return float((between - support - np.roll(of_other, _OUTLINE // 2)).max())


_RESTS: dict[Shape, Rests] = {}


def rests_of(solid: Shape) -> Rests:
    """:func:`rests`, which is computed once for each body."""
    if solid not in _RESTS:
        _RESTS[solid] = rests(solid)
    return _RESTS[solid]
