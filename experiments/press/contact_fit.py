"""Presses of a body that look like given images of contacts, by Levenberg and Marquardt's method.

A small motion of a body changes its height map by the normal component of the motion, so that one map gives the
derivatives of the image by orientation, size and offset. Many objects are fitted at once.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from activetouch.poses import Quaternion, hamilton_product, to_matrices, turned
from activetouch.pressing.height_maps import Window, predicted_contacts
from activetouch.pressing.pad import Pad
from activetouch.scene import Scene
from activetouch.shapes import Shape

Floats = NDArray[np.float64]

_TAXELS, _PIXELS = 12, 36  # along an edge: of an image at most, of a height map at least
_TOLERANCE = 0.005  # of full scale: a difference that no reader uses, as it does not know its sensor better
_STEEPEST = 4.0  # slope of a surface that a derivative follows
_LONGEST_TURN = 0.3  # in one step [rad]
_CHUNK = 2400  # objects at once, divided by the square of the number of presses of each
_NEWTON_STEPS = 30


@dataclass(frozen=True)
class Feeler:
    """The images that are compared: pressure in units of the noise, at one force.

    Attributes:
        pad: the pad.
        load: sum of the indentations of all pixels that carries the force [m].
        num_pixels: of a height map, along the edge of the pad.
        binning: pixels along the edge of one taxel of the image.
        noise: standard deviation of a taxel, relative to full scale.
    """

    pad: Pad
    load: float
    num_pixels: int
    binning: int
    noise: float

    @classmethod
    def of(cls, scene: Scene) -> Feeler:
        """For a scene: finer images are averaged, and their noise with them; the force is the middle one."""
        pad, edge = scene.pad, scene.image_shape[0]
        taxels = min(edge, _TAXELS)
        binning = -(-_PIXELS // taxels)
        noise = max((getattr(fault, "std", 0.0) for fault in scene.faults), default=0.0) * taxels / edge
        force, stiffness = (sum(vary.support) / 2 for vary in (scene.variation.force, scene.variation.stiffness))
        load = force / (pad.stiffness * stiffness * (2 * pad.half_width / (taxels * binning)) ** 2)
        return cls(pad, load, taxels * binning, binning, float(np.hypot(noise, _TOLERANCE)))

    @cached_property
    def window(self) -> Window:
        """The face of the pad."""
        return Window(2 * self.pad.half_width, self.num_pixels)

    def images(self, heights: Floats) -> tuple[Floats, NDArray[np.bool_], Floats]:
        """Images of height maps ``(n, N, N)``.

        Returns:
            The images ``(n, e, e)``, the pixels that are loaded, and the weights with which the heights of the pixels
            determine the depth, both ``(n, N, N)``.
        """
        top = heights.max(axis=(1, 2), keepdims=True)
        gap = np.where(np.isfinite(top), top - heights, np.inf)
        depth = np.full(top.shape, self.pad.max_depth)
        for _ in range(_NEWTON_STEPS):  # see Pad.indentation
            loaded = gap < depth
            total = np.where(loaded, gap, 0.0).sum(axis=(1, 2), keepdims=True)
            lower = (self.load + total) / np.maximum(loaded.sum(axis=(1, 2), keepdims=True), 1)
            is_converged = bool((lower > depth - 1e-9).all())
            depth = np.minimum(lower, depth)
            if is_converged:
                break
        loaded = gap < depth
        anchor = np.where(depth < self.pad.max_depth, loaded, gap == 0.0)
        weights = anchor / np.maximum(anchor.sum(axis=(1, 2), keepdims=True), 1)
        return self._binned(np.maximum(depth - gap, 0.0)), loaded, weights

    def _binned(self, indentations: Floats) -> Floats:
        """Indentations ``(..., N, N)`` [m] as an image ``(..., e, e)``."""
        edge, width = self.num_pixels // self.binning, self.binning
        blocks = indentations.reshape(*indentations.shape[:-2], edge, width, edge, width)
        return blocks.mean(axis=(-3, -1)) / (self.pad.max_depth * self.noise)

    def changes(self, heights: Floats, loaded: NDArray[np.bool_], weights: Floats, offsets: Floats) -> Floats:
        """Derivatives of images by a rotation vector [1/rad], the logarithm of the size, and y and z [1/m].

        Args:
            heights: the maps ``(n, N, N)`` [m].
            loaded: from :meth:`images`.
            weights: from :meth:`images`.
            offsets: of the body's centre [m], ``(n, 2)``.

        Returns:
            ``(n, 6, e·e)``.
        """
        z, y = np.meshgrid(self.window.centres, self.window.centres, indexing="ij")
        y, z = y - offsets[:, 0, None, None], z - offsets[:, 1, None, None]
        with np.errstate(invalid="ignore"):
            slopes = np.stack(np.gradient(heights, self.window.edge / self.num_pixels, axis=(2, 1)))
        h_y, h_z = np.clip(np.nan_to_num(slopes), -_STEEPEST, _STEEPEST)
        h = np.where(np.isfinite(heights), heights, 0.0)
        # The surface is at x = -h. A point p that moves by v = ω × p + σ p + t changes h by -v_x - h_y v_y - h_z v_z.
        change = np.stack([h_y * z - h_z * y, -z - h_z * h, y + h_y * h, h - h_y * y - h_z * z, -h_y, -h_z], axis=1)
        depth = np.einsum("nkij,nij->nk", change, weights)  # so that the force stays
        return self._binned(np.where(loaded[:, None], change - depth[:, :, None, None], 0.0)).reshape(*depth.shape, -1)


@dataclass(frozen=True)
class Presses:
    """Presses of m objects, in P poses each.

    Attributes:
        turns: orientations of the objects, ``(m, 4)``.
        sizes: of the objects, ``(m,)``.
        offsets: of each press [m], ``(m, P, 2)``.
    """

    turns: Floats
    sizes: Floats
    offsets: Floats

    def __getitem__(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Presses:
        return Presses(self.turns[rows], self.sizes[rows], self.offsets[rows])

    def or_else(self, others: Presses, where: NDArray[np.bool_]) -> Presses:
        """The presses, with those of others in their place where it is said."""
        pairs = ((getattr(self, part.name), getattr(others, part.name)) for part in fields(self))
        return Presses(*(np.where(where.reshape(-1, *[1] * (a.ndim - 1)), b, a) for a, b in pairs))

    def heights(self, body: Shape, poses: Floats, window: Window) -> Floats:
        """Height maps ``(m·P, N, N)`` in the poses ``(P, 4)``."""
        shown = np.stack([turned(pose, self.turns) for pose in poses], axis=1).reshape(-1, 4)
        sizes = np.repeat(self.sizes, len(poses))
        return np.asarray(predicted_contacts(body, shown, self.offsets.reshape(-1, 2), window, sizes), float)


@dataclass(frozen=True)
class Limits:
    """Ranges of the sizes and of the offsets [m]."""

    sizes: tuple[float, float]
    offsets: tuple[float, float]

    def moved(self, presses: Presses, step: Floats) -> Presses:
        """Presses after a step ``(m, 4 + 2·P)``: a rotation vector, a relative size, and offsets."""
        angle = np.linalg.norm(step[:, :3], axis=1, keepdims=True)
        small = step[:, :3] * np.minimum(1.0, _LONGEST_TURN / np.maximum(angle, 1e-12)) / 2
        turn: Quaternion = np.hstack([np.ones((len(step), 1)), small])
        turns = np.array(hamilton_product(turn.T, presses.turns.T)).T
        offsets = presses.offsets + step[:, 4:].reshape(presses.offsets.shape)
        return Presses(
            turns / np.linalg.norm(turns, axis=1, keepdims=True),
            np.clip(presses.sizes * (1.0 + np.clip(step[:, 3], -0.5, 0.5)), *self.sizes),
            np.clip(offsets, *self.offsets),
        )


def fit(
    feeler: Feeler, body: Shape, images: Floats, start: Presses, poses: Floats, limits: Limits, num_steps: int
) -> tuple[Presses, Floats]:
    """Presses of a body that look like images, by least squares from a start.

    Args:
        feeler: makes images.
        body: whose presses are sought.
        images: of m objects in P poses, ``(m, P, e, e)``.
        start: the presses to start from.
        poses: rotations ``(P, 4)``.
        limits: of size and offsets.
        num_steps: of the method.

    Returns:
        The presses, and the squared distances of their images, ``(m,)``.
    """
    chunk = max(1, _CHUNK // len(poses) ** 2)
    if len(images) > chunk:
        rows = np.array_split(np.arange(len(images)), -(-len(images) // chunk))
        parts = [fit(feeler, body, images[some], start[some], poses, limits, num_steps) for some in rows]
        merged = (np.concatenate([getattr(part, f.name) for part, _ in parts]) for f in fields(Presses))
        return Presses(*merged), np.concatenate([cost for _, cost in parts])
    best = start
    residual, slopes = _linearised(feeler, body, images, start, poses)
    damping = np.full(len(images), 1e-2)
    for _ in range(num_steps):
        normal, gradient = slopes @ slopes.mT, slopes @ residual[:, :, None]
        scale = np.einsum("mii->mi", normal) + 1e-9
        lifted = normal + (damping[:, None] * scale)[:, :, None] * np.eye(slopes.shape[1])
        trial = limits.moved(best, np.linalg.solve(lifted, gradient)[..., 0])
        new_residual, new_slopes = _linearised(feeler, body, images, trial, poses)
        is_better = np.square(new_residual).sum(axis=1) < np.square(residual).sum(axis=1)
        best = best.or_else(trial, is_better)
        residual = np.where(is_better[:, None], new_residual, residual)
        slopes = np.where(is_better[:, None, None], new_slopes, slopes)
        damping *= np.where(is_better, 0.2, 8.0)
    return best, np.square(residual).sum(axis=1)


def _linearised(
    feeler: Feeler, body: Shape, images: Floats, presses: Presses, poses: Floats
) -> tuple[Floats, Floats]:
    """Residuals ``(m, P·e·e)`` and the derivatives of the images by a step ``(m, 4 + 2·P, P·e·e)``."""
    num_objects, num_poses = images.shape[:2]
    heights = presses.heights(body, poses, feeler.window)
    found, loaded, weights = feeler.images(heights)
    by_press = feeler.changes(heights, loaded, weights, presses.offsets.reshape(-1, 2))
    by_press = by_press.reshape(num_objects, num_poses, 6, -1)
    slopes = np.zeros((num_objects, 4 + 2 * num_poses, num_poses, by_press.shape[-1]))
    slopes[:, :3] = np.einsum("mpie,pij->mjpe", by_press[:, :, :3], to_matrices(poses))
    slopes[:, 3] = by_press[:, :, 3]
    for pose in range(num_poses):
        slopes[:, 4 + 2 * pose : 6 + 2 * pose, pose] = by_press[:, pose, 4:]
    return (images - found.reshape(images.shape)).reshape(num_objects, -1), slopes.reshape(*slopes.shape[:2], -1)
