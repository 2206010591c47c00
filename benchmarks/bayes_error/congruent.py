r"""Lower bound on the loss of any reader of several touches, where shapes have flat faces.

The contact of one flat-faced body is often congruent to that of another: a corner of a cube is a corner of a cuboid,
elsewhere on the body. Then only the place of the contact tells them apart, and the offset of the press blurs it.

The bound is an information relaxation. Its reader is told the image without noise, force and gain, and whether the
shape is one of the flat-faced shapes. While all touches together show one direction of faces only, it is also told the
orientation up to the 24 rotations of a cube. A reader who is told more has no larger expected loss. Two directions of
faces leave finitely many orientations R of each shape k. Bayes' rule is then a sum over these and the sizes s,

    p(k | images) ∝ Σ_R ∫ p(s) ∏_t w_t(k, R, s) ds

where w_t is the measure of the offsets at which the body (k, R, s) gives the image of touch t. An image depends on the
few faces that it shows. An offset gives the same image if these faces lie in the same planes, up to a shift along the
approach axis, and all others stay away from the touched surface. Three faces leave one offset, two a line, one an area.
The faces shown have the same normals under all hypotheses, so that their densities differ by these measures only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from activetouch.distributions import Distribution, Uniform
from activetouch.orientations import Tumbled
from activetouch.poses import to_matrices, to_matrix
from activetouch.pressing.pad import Pad
from activetouch.scene import Scene
from activetouch.solids.straight import FlatFaced, crossings
from benchmarks.bayes_error.noise import UnknownLikelihood

Floats = NDArray[np.float64]

_SIZES = 64  # on a grid over their range
_OFFSETS = 24  # along each edge of a grid over theirs
_SAME = 1e-9  # difference of lengths [m] and of unit vectors below which they are equal
_DISTINCT = 1e-6  # sine of the angle between directions that are not parallel
_TURNS = np.rint(Rotation.create_group("O").as_matrix())  # of a cube onto itself


class Faces(NamedTuple):
    """The planes of a convex body's faces: outward unit normals ``(m, 3)`` and distances from the origin ``(m,)``."""

    normals: Floats
    distances: Floats

    def select(self, rows: Sequence[int] | NDArray[np.bool_]) -> Faces:
        """Some of them."""
        return Faces(self.normals[rows], self.distances[rows])


class SeenFaces(NamedTuple):
    """What the image of a touch shows without noise.

    Attributes:
        faces: those that the image depends on, in the pad's frame.
        surface: points of the body that touch the pad, ``(3, n)`` [m]; none for a miss.
        offset: of the body, which the reader does not know [m], ``(2,)``.
    """

    faces: Faces
    surface: Floats
    offset: Floats


@dataclass(frozen=True, eq=False)
class CongruentContacts:
    """Bayes' rule for a reader who is told more than any reader can know.

    Args:
        scene: tumbled objects with uniform sizes and offsets, and a rigid press.

    Raises:
        UnknownLikelihood: for another scene, or one with fewer than two flat-faced shapes.
    """

    scene: Scene

    def __post_init__(self) -> None:
        scene, vary = self.scene, self.scene.variation
        if scene.families:
            raise UnknownLikelihood(
                f"this bound is about solids, but the proportions of {', '.join(scene.families)} vary"
            )
        if len(self.shapes) < 2:
            raise UnknownLikelihood(f"this bound is about shapes with flat faces, and {scene!r} has {len(self.shapes)}")
        if not isinstance(scene.presentation, Tumbled) or scene.aims:
            raise UnknownLikelihood(f"this bound needs tumbled objects and presses in the middle, not {scene!r}")
        for name, chance in (("size", vary.size), ("offset", vary.offset)):
            if not isinstance(chance, Uniform) or np.ptp(chance.support) == 0.0:
                raise UnknownLikelihood(f"this bound needs a uniform {name}, not {chance}")
        if np.ptp(vary.stiffness.support) > 0.0:
            raise UnknownLikelihood(f"this bound needs one stiffness, not {vary.stiffness}")

    @cached_property
    def shapes(self) -> dict[int, Faces]:
        """The flat-faced shapes by index; the loss of all others is at least 0."""
        solids = enumerate(self.scene.solids.values())
        return {index: Faces(*solid.planes) for index, solid in solids if isinstance(solid, FlatFaced)}

    @cached_property
    def _poses(self) -> Floats:
        return to_matrices(np.array(list(self.scene.rotations.values())))

    def log_posteriors(
        self, shape: int, rest: Floats, size: float, poses: NDArray[np.int64], offsets: Floats, forces: Floats
    ) -> Floats:
        """Log posterior of each of :attr:`shapes` after 1 to T touches of an object, ``(T, F)``.

        Args:
            shape: index of the true shape, one of :attr:`shapes`.
            rest: orientation of the object at rest, unit quaternion ``wxyz``.
            size: factor on its nominal size.
            poses: of the touches, ``(T,)``.
            offsets: of these, ``(T, 2)`` [m].
            forces: of these ``(T,)`` [N].
        """
        pad, stiffness = self.scene.pad, self.scene.variation.stiffness.support[0]
        orientations = self._poses[poses] @ to_matrix(rest)
        normals, distances = self.shapes[shape]
        seen = [
            see(pad, Faces(normals @ turned.T, size * distances), offset, force / stiffness)
            for turned, offset, force in zip(orientations, offsets, forces, strict=True)
        ]
        sizes, turns = _through(size, self.scene.variation.size, _SIZES), self._poses[poses]
        normals_at_rest = [touch.faces.normals @ turn for touch, turn in zip(seen, turns, strict=True)]
        pairs = [two_directions(np.vstack(normals_at_rest[: n + 1])) for n in range(len(seen))]
        undetermined = sum(
            pair is None for pair in pairs
        )  # the first touches, which show one direction of faces at most
        evidence = np.empty((len(seen), len(self.shapes)))
        few = slice(0, undetermined)
        for column, faces in enumerate(self.shapes.values()):
            told = to_matrix(rest) @ _TURNS
            evidence[few, column] = self._evidence(faces, sizes, told, turns[few], seen[few])
            if (pair := pairs[-1]) is not None:
                found = self._evidence(faces, sizes, alignments(pair, faces.normals), turns, seen)
                evidence[undetermined:, column] = found[undetermined:]
        with np.errstate(divide="ignore"):  # of a shape that could not give these images
            return np.log(evidence / evidence.sum(axis=1, keepdims=True))

    def _evidence(
        self, faces: Faces, sizes: Floats, rests: Sequence[Floats] | Floats, turns: Floats, seen: Sequence[SeenFaces]
    ) -> Floats:
        """Sum over orientations at rest and sizes of the products of the first 1 to T measures, ``(T,)``."""
        total = np.zeros(len(seen))
        for rest in rests if seen else ():
            measures = [
                self._measure(Faces(faces.normals @ (turn @ rest).T, faces.distances), sizes, touch)
                for turn, touch in zip(turns, seen, strict=True)
            ]
            total += np.cumprod(measures, axis=0).sum(axis=1)
        return total

    def _measure(self, faces: Faces, sizes: Floats, seen: SeenFaces) -> Floats:
        """Measure of the offsets at which a body of each size gives the image, ``(S,)``; 1 for a miss."""
        shown = seen.faces.normals
        if not len(shown):
            return np.ones(len(sizes))
        alike = shown @ faces.normals.T > 1.0 - _SAME
        if not alike.any(axis=1).all():
            return np.zeros(len(sizes))  # a face that the image shows is missing
        others, same = ~alike.any(axis=0), alike.argmax(axis=1)
        # Centres c of the body fulfil shown @ c = wanted and borders @ c >= least.
        low, high = self.scene.variation.offset.support
        wanted = seen.faces.distances - sizes[:, None] * faces.distances[same]
        reach = (faces.normals[others] @ seen.surface).max(axis=1)
        beyond = reach - sizes[:, None] * faces.distances[others]
        borders = np.concatenate([faces.normals[others], [[0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, -1]]])
        least = np.hstack([beyond, np.tile([low, low, -high, -high], (len(sizes), 1))])
        centres = wanted @ np.linalg.pinv(shown).T
        fits = np.abs(centres @ shown.T - wanted).max(axis=1) < _SAME
        rank = np.linalg.matrix_rank(shown, tol=1e-6)
        if rank == 3:
            measure = _inside(centres, borders, least).astype(float)
        elif rank == 2:
            measure = _length(centres, np.linalg.svd(shown)[2][2], borders, least)
        else:
            offsets = [_through(each, self.scene.variation.offset, _OFFSETS) for each in seen.offset]
            y, z = (axis.ravel() for axis in np.meshgrid(*offsets))
            x = (wanted[:, :1] - shown[0, 1] * y - shown[0, 2] * z) / shown[0, 0]
            grid = np.stack([x, np.broadcast_to(y, x.shape), np.broadcast_to(z, x.shape)], axis=2)
            measure = _inside(grid, borders, least[:, None]).mean(axis=1)
        return np.where(fits, measure, 0.0)


def see(pad: Pad, faces: Faces, offset: Floats, force: float) -> SeenFaces:
    """The faces that the image of a press depends on: without one of them, the image would be another.

    Args:
        pad: the pad.
        faces: of the body, turned and of its size, about its centre.
        offset: of the centre [m], ``(2,)``.
        force: of the press, for a body as hard as the pad's own layer [N].
    """
    centre = np.array([0.0, *offset])
    placed = Faces(faces.normals, faces.distances + faces.normals @ centre)
    surface = _heights(pad, placed)
    if not np.isfinite(surface.min()):
        return SeenFaces(placed.select([]), np.empty((3, 0)), offset)
    top = surface.min() + pad.indentation(surface - surface.min(), force)
    image, rows = np.maximum(top - surface, 0.0), np.arange(len(faces.distances))
    matters = [
        np.abs(np.maximum(top - _heights(pad, placed.select(rows != row)), 0.0) - image).max() > _SAME * pad.max_depth
        for row in rows
    ]
    touched = surface < top
    points = np.vstack([surface[touched], pad.taxel_centres[1:, touched]])
    return SeenFaces(placed.select(np.array(matters)), points, offset)


def two_directions(normals: Floats) -> Floats | None:
    """Two of some unit normals ``(m, 3)`` that are not parallel, ``(2, 3)``; None if there are none."""
    for normal in normals:
        apart = np.linalg.norm(np.cross(normals[0], normal))
        if apart > _DISTINCT:
            return np.stack([normals[0], normal])
    return None


def alignments(pair: Floats, normals: Floats) -> list[Floats]:
    """All rotations, ``(3, 3)`` each, that turn two of a body's face normals into two given directions.

    Args:
        pair: the directions, not parallel, ``(2, 3)``.
        normals: of the faces, ``(m, 3)``.
    """
    angle, wanted = float(pair[0] @ pair[1]), _frame(*pair)
    alike = np.abs(normals @ normals.T - angle) < _SAME
    return [wanted @ _frame(normals[one], normals[other]).T for one, other in np.argwhere(alike)]


def _frame(first: Floats, second: Floats) -> Floats:
    """The orthonormal frame, in columns, of the first direction and the plane of both."""
    across = np.cross(first, second)
    across /= np.linalg.norm(across)
    return np.stack([first, np.cross(across, first), across], axis=1)


def _heights(pad: Pad, faces: Faces) -> Floats:
    """Position along the approach axis at which the body begins above every taxel [m]; ``inf`` beside it."""
    enter, leave = crossings(*faces, pad.taxel_centres, np.array([1.0, 0.0, 0.0]))
    return np.where(enter <= leave, enter, np.inf)


def _inside(points: Floats, borders: Floats, least: Floats) -> NDArray[np.bool_]:
    """Whether points ``(..., 3)`` fulfil ``borders @ point >= least``, ``(...)``."""
    return np.asarray((points @ borders.T >= least - _SAME).all(axis=-1))


def _length(points: Floats, direction: Floats, borders: Floats, least: Floats) -> Floats:
    """Length across the approach axis of the part of a line through each point that is inside, ``(S,)`` [m]."""
    slopes, room = borders @ direction, points @ borders.T - least
    slopes = np.where(np.abs(slopes) < _SAME, 0.0, slopes)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = -room / slopes
    first = np.where(slopes > 0.0, crossings, -np.inf).max(axis=1)
    last = np.where(slopes < 0.0, crossings, np.inf).min(axis=1)
    is_open = ((slopes != 0.0) | (room >= -_SAME)).all(axis=1)
    return np.where(is_open, np.maximum(last - first, 0.0), 0.0) * float(np.hypot(*direction[1:]))


def _through(value: float, chance: Distribution, number: int) -> Floats:
    """Evenly spaced values over a uniform distribution, one of which is ``value``, ``(number,)``."""
    low, high = chance.support
    return low + (value - low + (high - low) * np.arange(number) / number) % (high - low)
