"""Meshes that are the same body, mirror images, or the same body in another size.

Volume, largest radius and moments of the surface up to order five decide: area, principal second moments, and lengths
of vectors of odd order. They do not depend on where the body is, how it is turned or how it is divided into triangles.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
import scipy  # whose parts load at first use

from activetouch.errors import MeshWarning
from activetouch.solids.mesh import Mesh
from activetouch.solids.solid import Floats, Shape
from activetouch.solids.triangles import areas, tetrahedra

_ALIKE = 1e-5  # largest difference between moments of two bodies of unit size, or between their corners
_SAME_SIZE = 1e-4
_HANDED, _DISTINCT = 1e-3, 1e-3  # skewness and relative difference of second moments beyond which axes are clear
_MOST_PAIRS = 20  # to say
# Nodes and weights of the quadrature of order five on a triangle (Radon).
_A, _B = (6 - np.sqrt(15)) / 21, (6 + np.sqrt(15)) / 21
_NODES = np.array([[1 / 3] * 3, *(np.roll([1 - 2 * q, q, q], k) for q in (_A, _B) for k in range(3))])
_WEIGHTS = np.array([9 / 40, *[(155 - np.sqrt(15)) / 1200] * 3, *[(155 + np.sqrt(15)) / 1200] * 3])


@dataclass(frozen=True)
class Twins:
    """Two meshes that differ at most by their size, place, orientation and handedness.

    Attributes:
        first: label.
        second: label.
        factor: size of the second relative to the first.
        mirrored: whether they are mirror images of each other; None if the moments do not tell.
    """

    first: str
    second: str
    factor: float
    mirrored: bool | None

    def __str__(self) -> str:
        """What it means for touch."""
        how = {True: "mirror images", False: "the same body", None: "the same body or mirror images"}[self.mirrored]
        if abs(self.factor - 1.0) > _SAME_SIZE:
            how = f"{how} in two sizes"
            meaning = f"{self.second} is {self.factor:.3g} × as large, and sizes vary by as much"
        else:
            meaning = {
                True: "only touches that show their handedness tell them apart",
                False: "no touch tells them apart",
                None: "touches hardly tell them apart",
            }[self.mirrored]
        return f"{self.first} and {self.second} are {how}: {meaning}"


def find_twins(shapes: Mapping[str, Shape], largest_factor: float = np.inf) -> list[Twins]:
    """All pairs of meshes that are twins; other solids are left out.

    Args:
        shapes: by label.
        largest_factor: ratio of sizes, at least 1, above which two sizes of one body do not count.

    >>> from activetouch.shapes import Mesh
    >>> corners, faces = np.eye(4, 3) * 0.02, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    >>> first, second = Mesh("a", corners, faces), Mesh("b", corners * 1.1, faces)
    >>> [str(twins) for twins in find_twins({"a": first, "b": second})]
    ['a and b are the same body in two sizes: b is 1.1 × as large, and sizes vary by as much']
    """
    meshes = {label: shape for label, shape in shapes.items() if isinstance(shape, Mesh)}
    if len(meshes) < 2:
        return []
    labels = list(meshes)
    sizes, moments, hands = map(np.array, zip(*map(_moments, meshes.values()), strict=True))
    found = []
    for i, j in sorted(scipy.spatial.cKDTree(moments).query_pairs(_ALIKE)):
        factor = float(sizes[j] / sizes[i])
        if max(factor, 1 / factor) <= largest_factor * (1 + _SAME_SIZE):
            mirrored = bool(hands[i] * hands[j] < 0.0) if min(abs(hands[i]), abs(hands[j])) > _HANDED else None
            one, other = (meshes[labels[k]].vertices / sizes[k] for k in (i, j))
            if mirrored is None and one.shape == other.shape and np.allclose(one, other, rtol=0.0, atol=_ALIKE):
                mirrored = False
            found.append(Twins(labels[i], labels[j], factor, mirrored))
    return found


_KNOWN: WeakKeyDictionary[Mesh, tuple[float, Floats, float]] = WeakKeyDictionary()


def _moments(mesh: Mesh) -> tuple[float, Floats, float]:
    """Those of :func:`_computed`, once for each mesh."""
    if (found := _KNOWN.get(mesh)) is None:
        found = _KNOWN[mesh] = _computed(mesh)
    return found


def _computed(mesh: Mesh) -> tuple[float, Floats, float]:
    """The size, moments that no rotation, scale or reflection changes, and one whose sign a reflection changes.

    Size is the root of the area. The last one is zero for a body whose moments single out fewer than three directions,
    such as one that is its own mirror image.
    """
    weights = np.outer(areas(mesh.vertices, mesh.faces), _WEIGHTS).ravel()
    size = float(np.sqrt(weights.sum()))
    points = (_NODES @ mesh.vertices[mesh.faces]).reshape(-1, 3)
    centre = weights @ points / weights.sum()
    points = (points - centre) / size
    weights /= weights.sum()
    square = np.einsum("ni,ni->n", points, points)
    second = (points * weights[:, None]).T @ points
    third = (weights * square) @ points
    fifth = (weights * square**2) @ points
    lengths = np.linalg.norm([third, fifth, second @ third], axis=1)
    spread, axes = np.linalg.eigh(second)
    skewness = weights @ (points @ axes) ** 3 / spread**1.5
    hand = np.sign(skewness.prod() * np.linalg.det(axes)) * np.abs(skewness).min()  # the signs of the axes cancel
    is_clear = np.diff(spread).min() > _DISTINCT * spread[-1]
    corners = (mesh.vertices - centre) / size
    others = weights @ square**2, tetrahedra(corners, mesh.faces).sum(), np.linalg.norm(corners, axis=1).max()
    return size, np.concatenate([spread, lengths, others]), float(hand) if is_clear else 0.0


def text_of_twins(shapes: Mapping[str, Shape], sizes: tuple[float, float]) -> str:
    """The twins among shapes as one text, empty if there are none.

    Args:
        shapes: by label.
        sizes: smallest and largest size of an object, relative to its shape.
    """
    texts = [str(twins) for twins in find_twins(shapes, sizes[1] / sizes[0] if sizes[0] > 0.0 else np.inf)]
    more = f"; and {len(texts) - _MOST_PAIRS} more pairs" if len(texts) > _MOST_PAIRS else ""
    return "; ".join(texts[:_MOST_PAIRS]) + more


def warn_of_twins(shapes: Mapping[str, Shape], sizes: tuple[float, float]) -> None:
    """Warn the caller of a class in whose construction this is called; the same text only once a process.

    Args:
        shapes: by label.
        sizes: see :func:`text_of_twins`.

    Warns:
        MeshWarning: some of them are twins.
    """
    if text := text_of_twins(shapes, sizes):
        _warn_once(text)


@lru_cache(maxsize=256)  # holds nothing if the warning is an error, which is then raised again
def _warn_once(text: str) -> None:
    warnings.warn(text, MeshWarning, stacklevel=5)
