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

    @property
    def edge(self) -> int:
        """Taxels along the edge of an image."""
        return self.num_pixels // self.binning

    @cached_property
    def window(self) -> Window:
        """The face of the pad."""
        return Window(2 * self.pad.half_width, self.num_pixels)

    def touched(self, heights: Floats) -> Touched:
        """What is pressed in height maps ``(n, N, N)`` [m]."""
        num, deepest = len(heights), self.pad.max_depth
        flat = heights.reshape(num, -1)
        top = flat.max(axis=1)
        pixels = np.flatnonzero(flat > (top - deepest)[:, None])
        maps = pixels // flat.shape[1]
        gap = top[maps] - flat.ravel()[pixels]
        depth = np.full(num, deepest)
        for _ in range(_NEWTON_STEPS):  # see Pad.indentation
            loaded = gap < depth[maps]
            count = np.bincount(maps, loaded, num)
            lower = (self.load + np.bincount(maps, gap * loaded, num)) / np.maximum(count, 1.0)
            is_converged = bool((lower > depth - 1e-9).all())
            depth = np.minimum(lower, depth)
            if is_converged:
                break
        loaded = gap < depth[maps]
        pixels, maps, gap = pixels[loaded], maps[loaded], gap[loaded]
        anchor = np.where(depth[maps] < deepest, 1.0, gap == 0.0)
        weights = anchor / np.bincount(maps, anchor, num)[maps]
        return Touched(num, maps, pixels % flat.shape[1], depth[maps] - gap, weights)

    def images(self, heights: Floats) -> Floats:
        """Images ``(n, e, e)`` of height maps ``(n, N, N)`` [m]."""
        touched = self.touched(heights)
        return self.on_taxels(touched, touched.indentations[None])[:, 0].reshape(touched.num_maps, *2 * [self.edge])

    def on_taxels(self, touched: Touched, values: Floats) -> Floats:
        """Several values ``(k, l)`` [m] of the loaded pixels as images ``(n, k, e·e)``."""
        row, column = np.divmod(touched.pixels, self.num_pixels)
        taxels = row // self.binning * self.edge + column // self.binning
        places, size = touched.maps * self.edge**2 + taxels, touched.num_maps * self.edge**2
        sums = [np.bincount(places, some, size).reshape(touched.num_maps, -1) for some in values]
        return np.stack(sums, axis=1) / (self.binning**2 * self.pad.max_depth * self.noise)

    def changes(self, heights: Floats, touched: Touched, offsets: Floats) -> Floats:
        """Derivatives of images by a rotation vector [1/rad], the logarithm of the size, and y and z [1/m].

        Args:
            heights: the maps ``(n, N, N)`` [m].
            touched: what is pressed in them.
            offsets: of the body's centre [m], ``(n, 2)``.

        Returns:
            ``(n, 6, e·e)``.
        """
        maps, num = touched.maps, self.num_pixels
        row, column = np.divmod(touched.pixels, num)
        y, z = (self.window.centres[place] - offsets[maps, axis] for axis, place in enumerate((column, row)))
        h = heights[maps, row, column]
        slopes = []
        for down, right in ((0, 1), (1, 0)):  # along y, along z
            ahead = np.minimum(row + down, num - 1), np.minimum(column + right, num - 1)
            behind = np.maximum(row - down, 0), np.maximum(column - right, 0)
            steps = (ahead[0] - behind[0]) + (ahead[1] - behind[1])
            high, low = heights[maps, *ahead], heights[maps, *behind]
            with np.errstate(invalid="ignore"):  # beside the body
                slope = (high - low) * num / (steps * self.window.edge)
            slopes.append(np.clip(np.nan_to_num(slope), -_STEEPEST, _STEEPEST))
        h_y, h_z = slopes
        # The surface is at x = -h. A point p that moves by v = ω × p + σ p + t changes h by -v_x - h_y v_y - h_z v_z.
        change = np.stack([h_y * z - h_z * y, -z - h_z * h, y + h_y * h, h - h_y * y - h_z * z, -h_y, -h_z])
        depth = [np.bincount(maps, some * touched.weights, touched.num_maps)[maps] for some in change]
        return self.on_taxels(touched, change - depth)  # at a constant force


@dataclass(frozen=True)
class Touched:
    """The loaded pixels of several height maps.

    Attributes:
        num_maps: number of the maps.
        maps: in which each pixel is, ``(l,)``.
        pixels: place in the map, ``(l,)``.
        indentations: of the pad [m], ``(l,)``.
        weights: with which the height of a pixel determines the depth, ``(l,)``.
    """

    num_maps: int
    maps: NDArray[np.intp]
    pixels: NDArray[np.intp]
    indentations: Floats
    weights: Floats


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

    def of(self, num_poses: int) -> Presses:
        """The presses in the first poses."""
        return Presses(self.turns, self.sizes, self.offsets[:, :num_poses])

    def put(self, rows: NDArray[np.intp], others: Presses) -> Presses:
        """The presses, with others in place of those of some objects."""
        copies = [getattr(self, part.name).copy() for part in fields(self)]
        for copy, part in zip(copies, fields(self), strict=True):
            copy[rows] = getattr(others, part.name)
        return Presses(*copies)

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
    touched = feeler.touched(heights)
    found = feeler.on_taxels(touched, touched.indentations[None])
    by_press = feeler.changes(heights, touched, presses.offsets.reshape(-1, 2))
    by_press = by_press.reshape(num_objects, num_poses, 6, -1)
    slopes = np.zeros((num_objects, 4 + 2 * num_poses, num_poses, by_press.shape[-1]))
    slopes[:, :3] = np.einsum("mpie,pij->mjpe", by_press[:, :, :3], to_matrices(poses))
    slopes[:, 3] = by_press[:, :, 3]
    for pose in range(num_poses):
        slopes[:, 4 + 2 * pose : 6 + 2 * pose, pose] = by_press[:, pose, 4:]
    return (images - found.reshape(images.shape)).reshape(num_objects, -1), slopes.reshape(*slopes.shape[:2], -1)
