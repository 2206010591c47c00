"""The rotations that map a solid onto itself, found from its surface: a can may be turned about its axis unseen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy  # whose parts load at first use

from activetouch.poses import Quaternion, hamilton_product, to_matrices
from activetouch.rotation_cells import centres
from activetouch.solids.solid import Shape
from activetouch.solids.triangles import Floats, Ints, areas
from belief.frozen import FrozenArrays

_ALIKE = 0.02  # root mean square distance of the turned surface from itself [radii]
_NEAR = 0.08  # the same, of a turn that is improved
_FEW, _POINTS, _DENSE = 50, 200, 20_000  # on the surface
_EQUAL = 0.03  # difference of moments that count as equal, relative to the largest
_ANGLES = 72  # turns that are tried about an axis
_STEPS, _MERGED = 24, 4  # steps of improvement, and after how many the best of near turns alone goes on
_SAME = np.deg2rad(15.0)  # between two rotations


@dataclass(frozen=True, eq=False)
class RotationalSymmetry(FrozenArrays):
    """The rotations of a solid that nobody can see.

    Attributes:
        rotations: that map the solid onto itself, unit quaternions ``wxyz``, ``(m, 4)``, the identity first; where it
            may be turned freely, one of each kind.
        axis: about which it may be turned freely, a unit vector ``(3,)``; None for no such axis.
        is_ball: whether it may be turned about every axis.
    """

    rotations: Floats
    axis: Floats | None = None
    is_ball: bool = False

    def __post_init__(self) -> None:
        self.freeze()

    def angles(self, orientation: Quaternion, others: Floats) -> Floats:
        """Smallest angles [rad] from an orientation to ``others (n, 4)`` by which the solids differ, ``(n,)``.

        >>> can = RotationalSymmetry(np.array([[1.0, 0.0, 0.0, 0.0]]), np.array([0.0, 0.0, 1.0]))
        >>> rolled, tilted = np.array([[np.cos(0.4), 0, 0, np.sin(0.4)], [np.cos(0.4), np.sin(0.4), 0, 0]])
        >>> can.angles(np.array([1.0, 0.0, 0.0, 0.0]), np.stack([rolled, tilted])).round(3).tolist()
        [0.0, 0.8]
        """
        if self.is_ball:
            return np.zeros(len(others))
        cosine = np.square(self._between(orientation, others)[1]).sum(axis=0)
        return np.asarray(2.0 * np.arccos(np.sqrt(np.clip(cosine, 0.0, 1.0)).max(axis=0)))

    def nearest(self, orientation: Quaternion, others: Floats) -> Floats:
        """For each of ``others (n, 4)``, the orientation nearest to a given one that looks the same, ``(n, 4)``."""
        if self.is_ball:
            return np.tile(np.asarray(orientation, float), (len(others), 1))
        every, parts = self._between(orientation, others)
        best = np.square(parts).sum(axis=0).argmax(axis=0)
        rows = np.arange(len(best))
        found = every[:, best, rows]
        if self.axis is not None:  # without the roll about the axis, which comes first
            w, along = parts[:, best, rows]
            size = np.maximum(np.hypot(w, along), np.finfo(float).tiny)
            back = np.vstack([w / size, -self.axis[:, None] * (along / size)])
            found = np.stack(hamilton_product(found, back))
        found = np.stack(hamilton_product(np.asarray(orientation, float), found))
        return np.asarray((found * np.where(np.asarray(orientation, float) @ found < 0.0, -1.0, 1.0)).T)

    def _between(self, orientation: Quaternion, others: Floats) -> tuple[Floats, Floats]:
        """From an orientation to every one that looks like each other ``(4, m, n)``; the parts that a roll leaves.

        The parts ``(p, m, n)``: the real one and, with a free axis, the imaginary one along it.
        """
        inverse = np.asarray(orientation, float) * [1.0, -1.0, -1.0, -1.0]
        between = np.stack(hamilton_product(inverse, np.asarray(others, float).T))
        every = np.stack(hamilton_product(between[:, None], self.rotations.T[:, :, None]))
        along = [] if self.axis is None else [np.einsum("i,imn->mn", self.axis, every[1:])]
        return every, np.stack([every[0], *along])

    def __str__(self) -> str:
        if self.is_ball:
            return "turned anyhow, it is the same"
        number = len(self.rotations)
        free = "" if self.axis is None else f"rolls about {np.round(self.axis, 2).tolist()} are free"
        others = f"{number} orientations are the same" if number > 1 else ""
        return "; ".join(part for part in (free, others) if part) or "no other orientation is the same"


@lru_cache(maxsize=256)
def symmetry_of(solid: Shape) -> RotationalSymmetry:
    """The rotations about its origin that map the surface of a solid onto itself, to 2 % of its radius.

    They keep the principal axes of the surface: where all three are distinct, half turns about them are tried, where
    two are alike, all turns about the third and half turns across it, and otherwise all rotations.
    """
    rng = np.random.default_rng(0)
    vertices, faces = solid.surface.vertices.T, solid.surface.faces.T
    tree = scipy.spatial.cKDTree(_on_surface(vertices, faces, _DENSE, rng))
    points, radius = _on_surface(vertices, faces, _POINTS, rng), np.linalg.norm(vertices, axis=1).max()

    def misfit(rotations: Floats, number: int = _POINTS) -> Floats:
        """Of rotations ``(n, 3, 3)``, ``(n,)``, in squared radii."""
        distances = tree.query(points[:number] @ rotations.swapaxes(1, 2))[0]
        return np.asarray(np.square(distances).mean(axis=1) / radius**2)

    most = misfit(np.eye(3)[None])[0] + _ALIKE**2
    moments, axes = np.linalg.eigh(_second_moments(vertices, faces))
    alike = np.diff(moments) < _EQUAL * moments[2]
    identity = np.array([[1.0, 0.0, 0.0, 0.0]])
    if alike.all():
        if (misfit(to_matrices(centres(0))) < most).all():
            return RotationalSymmetry(identity, is_ball=True)
        tried = to_matrices(centres(2))
    elif not alike.any():
        tried = _about(axes, np.array([np.pi]))
    else:
        axis = axes[:, 2 if alike[0] else 0]
        across = np.linalg.svd(axis[None])[2][1:]
        angles = np.linspace(0.0, 2.0 * np.pi, _ANGLES, endpoint=False)[1:]
        about, halves = _about(axis[:, None], angles), np.concatenate([[0.0], angles]) / 2.0
        flips = _about(np.cos(halves) * across[0][:, None] + np.sin(halves) * across[1][:, None], np.array([np.pi]))
        if (misfit(about) < most).all():
            flipped = misfit(flips[:1])[0] < most
            return RotationalSymmetry(np.vstack([identity, _quaternions(flips[:1])]) if flipped else identity, axis)
        tried = np.concatenate([about, flips])
    tried = tried[misfit(tried, _FEW) < _NEAR**2]
    for step in range(_STEPS if len(tried) else 0):  # to the nearest points of the surface, by the best rotation of all
        if step % _MERGED == 0:
            tried = _apart(tried, misfit(tried, _FEW))
        turned_points = points @ tried.swapaxes(1, 2)
        nearest = tree.data[tree.query(turned_points)[1]]
        left, _, right = np.linalg.svd(nearest.swapaxes(1, 2) @ turned_points)
        proper = np.ones((len(tried), 1, 3))
        proper[:, 0, 2] = np.sign(np.linalg.det(left @ right))
        tried = (left * proper) @ right @ tried
    misfits = misfit(tried)
    fits = misfits < most
    apart = _apart(np.concatenate([np.eye(3)[None], tried[fits]]), np.append(0.0, misfits[fits]))
    return RotationalSymmetry(_quaternions(apart))


def _apart(rotations: Floats, misfits: Floats) -> Floats:
    """Rotations that are not near one that fits better, ``(m, 3, 3)`` of ``(n, 3, 3)``, best first."""
    kept = np.empty((0, 3, 3))
    for one in rotations[np.argsort(misfits)]:
        if (np.einsum("kij,ij->k", kept, one) < 1.0 + 2.0 * np.cos(_SAME)).all():
            kept = np.concatenate([kept, one[None]])
    return kept


def _quaternions(rotations: Floats) -> Floats:
    """Unit quaternions ``wxyz`` of matrices ``(n, 3, 3)``, ``(n, 4)``."""
    if not len(rotations):
        return np.zeros((0, 4))
    return np.roll(scipy.spatial.transform.Rotation.from_matrix(rotations).as_quat(), 1, axis=1)


def _second_moments(vertices: Floats, faces: Ints) -> Floats:
    """Mean of x xᵀ over the surface, ``(3, 3)``."""
    corners = vertices[faces]
    total = corners.sum(axis=1)
    each = np.einsum("fci,fcj->fij", corners, corners) + total[:, :, None] * total[:, None]
    return np.asarray(np.average(each, axis=0, weights=areas(vertices, faces)) / 12.0)


def _about(axes: Floats, angles: Floats) -> Floats:
    """Rotations about each of the axes ``(3, n)`` by each of the angles ``(m,)``, ``(n m, 3, 3)``."""
    vectors = axes.T[:, None] * angles[:, None]
    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix())


def _on_surface(vertices: Floats, faces: Ints, number: int, rng: np.random.Generator) -> Floats:
    """Points that are evenly distributed over triangles, ``(number, 3)``."""
    shares = areas(vertices, faces)
    chosen = vertices[faces[rng.choice(len(faces), number, p=shares / shares.sum())]]
    low, high = np.sort(rng.random((number, 2)), axis=1).T[:, :, None]
    return np.asarray(chosen[:, 0] * low + chosen[:, 1] * (high - low) + chosen[:, 2] * (1.0 - high))
