"""Presses of a body that look like given images of contacts, by Levenberg and Marquardt's method.

A small motion of a body changes its height map by the normal component of the motion, so that one map gives the
derivatives of the image by orientation, size and offset. Many objects are fitted at once.

The presses of m objects in P poses are one array ``(m, 5 + 3·P)``: the object's orientation ``wxyz``, its size, and for
each press the offset along y and z and how much deeper it is than the force says [m]. The latter stands for what hides
the depth of a real press, and for the sampling of the highest point.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from activetouch.poses import hamilton_product, to_matrices, turned
from activetouch.pressing.height_maps import Window, predicted_contacts
from activetouch.pressing.pad import Pad
from activetouch.scene import Scene
from activetouch.shapes import Shape

Floats = NDArray[np.float64]

_TAXELS, _PIXELS = 12, 24  # along an edge: of an image at most, of a height map at least
_TOLERANCE = 0.01  # of full scale: a difference that no reader uses, as it does not know its sensor better
_STEEPEST = 4.0  # slope of a surface that a derivative follows
_LONGEST_TURN = 0.3  # in one step [rad]
_CHUNK = 2400  # objects at once, divided by the square of the number of their presses
_NEWTON_STEPS = 30
_DEEPER = 0.0005  # than the force says, at most [m]


@dataclass(frozen=True)
class ContactFit:
    """The images that are compared, pressures in units of the noise at one force, and the presses that may be.

    Attributes:
        pad: the pad.
        load: sum of the indentations of all pixels that carries the force [m].
        edge: taxels along the edge of an image.
        binning: pixels of a height map along the edge of a taxel.
        noise: standard deviation of a taxel, relative to full scale.
        sizes: smallest and largest size.
        offsets: smallest and largest offset [m].
    """

    pad: Pad
    load: float
    edge: int
    binning: int
    noise: float
    sizes: tuple[float, float]
    offsets: tuple[float, float]

    @classmethod
    def of(cls, scene: Scene) -> ContactFit:
        """For a scene: finer images are averaged, and their noise with them; the force is the middle one."""
        vary, finest = scene.variation, scene.image_shape[0]
        edge = min(finest, _TAXELS)
        binning = -(-_PIXELS // edge)
        noise = max((getattr(fault, "std", 0.0) for fault in scene.faults), default=0.0) * edge / finest
        pixel = 2 * scene.pad.half_width / (edge * binning)
        load = sum(vary.force.support) / sum(vary.stiffness.support) / (scene.pad.stiffness * pixel**2)
        noise = float(np.hypot(noise, _TOLERANCE))
        return cls(scene.pad, load, edge, binning, noise, vary.size.support, vary.offset.support)

    @cached_property
    def window(self) -> Window:
        """The face of the pad."""
        return Window(2 * self.pad.half_width, self.edge * self.binning)

    def heights(self, body: Shape, presses: Floats, poses: Floats) -> Floats:
        """Height maps of presses in the poses ``(P, 4)``, ``(m·P, N, N)`` [m]."""
        shown = np.stack([turned(pose, presses[:, :4]) for pose in poses], axis=1).reshape(-1, 4)
        sizes = np.repeat(presses[:, 4], len(poses))
        return predicted_contacts(body, shown, presses[:, 5:].reshape(-1, 3)[:, :2], self.window, sizes).astype(float)

    def images(self, heights: Floats) -> Floats:
        """Images ``(n, e, e)`` of height maps ``(n, N, N)`` [m]."""
        return self._felt(heights, np.zeros((len(heights), 3)), False)[0].reshape(-1, self.edge, self.edge)

    def _felt(self, heights: Floats, offsets: Floats, with_changes: bool = True) -> tuple[Floats, Floats]:
        """Images, and their derivatives by a rotation vector, the logarithm of the size, and offset and depth.

        Args:
            heights: maps ``(n, N, N)`` [m].
            offsets: of the body's centre along y and z, and the further depth [m], ``(n, 3)``.
            with_changes: whether to compute derivatives.

        Returns:
            ``(n, e·e)`` and ``(n, 7, e·e)``.
        """
        num, pixels, deepest = len(heights), self.window.num_pixels, self.pad.max_depth
        flat = heights.reshape(num, -1)
        top = flat.max(axis=1)
        maps, places = np.divmod(np.flatnonzero(flat > (top - deepest - _DEEPER)[:, None]), pixels**2)
        gap, depth = top[maps] - flat[maps, places], np.full(num, deepest)
        for _ in range(_NEWTON_STEPS):  # see Pad.indentation
            loaded = gap < depth[maps]
            total = self.load + np.bincount(maps, gap * loaded, num)
            lower = total / np.maximum(np.bincount(maps, loaded, num), 1.0)
            if (lower > depth - 1e-9).all():
                break
            depth = np.minimum(lower, depth)
        depth += offsets[:, 2]
        loaded = gap < depth[maps]
        maps, gap, (row, column) = maps[loaded], gap[loaded], np.divmod(places[loaded], pixels)
        taxels = maps * self.edge**2 + row // self.binning * self.edge + column // self.binning
        scale = self.binning**2 * deepest * self.noise

        def binned(values: Floats) -> Floats:
            return np.bincount(taxels, values, num * self.edge**2).reshape(num, -1) / scale

        image = binned(depth[maps] - gap)
        if not with_changes:
            return image, np.empty(0)
        y, z = self.window.centres[column] - offsets[maps, 0], self.window.centres[row] - offsets[maps, 1]
        h, slopes = heights[maps, row, column], []
        for down, right in ((0, 1), (1, 0)):  # along y, along z
            ahead = np.minimum(row + down, pixels - 1), np.minimum(column + right, pixels - 1)
            behind = np.maximum(row - down, 0), np.maximum(column - right, 0)
            with np.errstate(invalid="ignore"):  # beside the body
                rise = heights[maps, *ahead] - heights[maps, *behind]
            run = (ahead[0] - behind[0] + ahead[1] - behind[1]) * self.window.edge / pixels
            slopes.append(np.clip(np.nan_to_num(rise, posinf=1.0, neginf=-1.0) / run, -_STEEPEST, _STEEPEST))
        h_y, h_z = slopes
        # The surface is at x = -h. A point p that moves by v = ω × p + σ p + t changes h by -v_x - h_y v_y - h_z v_z.
        changes = (h_y * z - h_z * y, -z - h_z * h, y + h_y * h, h - h_y * y - h_z * z, -h_y, -h_z)
        count = np.maximum(np.bincount(maps, minlength=num), 1)
        relative = [change - (np.bincount(maps, change, num) / count)[maps] for change in changes]  # at the same force
        return image, np.stack([binned(change) for change in (*relative, np.ones_like(h))], axis=1)

    def fit(self, body: Shape, images: Floats, start: Floats, poses: Floats, num_steps: int) -> tuple[Floats, Floats]:
        """Presses of a body that look like images, by least squares from a start.

        Args:
            body: whose presses are sought.
            images: of m objects in P poses, ``(m, P, e, e)``.
            start: presses to start from, ``(m, 5 + 3·P)``.
            poses: rotations ``(P, 4)``.
            num_steps: of the method.

        Returns:
            The presses, and the squared distances of their images, ``(m,)``.
        """
        chunk = max(1, _CHUNK // len(poses) ** 2)
        if len(images) > chunk:
            rows = np.array_split(np.arange(len(images)), -(-len(images) // chunk))
            parts = [self.fit(body, images[part], start[part], poses, num_steps) for part in rows]
            return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
        best, damping = start, np.full(len(images), 1e-2)
        residual, slopes = self._linearised(body, images, start, poses)
        for _ in range(num_steps):
            normal, gradient = slopes @ slopes.mT, slopes @ residual[:, :, None]
            scale = np.einsum("mii->mi", normal) + 1e-9
            lifted = normal + (damping[:, None] * scale)[:, :, None] * np.eye(slopes.shape[1])
            trial = self._moved(best, np.linalg.solve(lifted, gradient)[..., 0])
            new_residual, new_slopes = self._linearised(body, images, trial, poses)
            is_better = np.square(new_residual).sum(axis=1) < np.square(residual).sum(axis=1)
            best = np.where(is_better[:, None], trial, best)
            residual = np.where(is_better[:, None], new_residual, residual)
            slopes = np.where(is_better[:, None, None], new_slopes, slopes)
            damping *= np.where(is_better, 0.2, 8.0)
        return best, np.square(residual).sum(axis=1)

    def _linearised(self, body: Shape, images: Floats, presses: Floats, poses: Floats) -> tuple[Floats, Floats]:
        """Residuals ``(m, P·e·e)``, and derivatives of the images by a step ``(m, 4 + 3·P, P·e·e)``."""
        num_objects, num_poses = images.shape[:2]
        found, changes = self._felt(self.heights(body, presses, poses), presses[:, 5:].reshape(-1, 3))
        changes = changes.reshape(num_objects, num_poses, 7, -1)
        slopes = np.zeros((num_objects, 4 + 3 * num_poses, num_poses, changes.shape[-1]))
        slopes[:, :3] = np.einsum("mpie,pij->mjpe", changes[:, :, :3], to_matrices(poses))
        slopes[:, 3] = changes[:, :, 3]
        for pose in range(num_poses):
            slopes[:, 4 + 3 * pose : 7 + 3 * pose, pose] = changes[:, pose, 4:]
        return (images - found.reshape(images.shape)).reshape(num_objects, -1), slopes.reshape(*slopes.shape[:2], -1)

    def _moved(self, presses: Floats, step: Floats) -> Floats:
        """Presses after a step ``(m, 4 + 3·P)``: a rotation vector, a relative size, offsets and depths."""
        angle = np.linalg.norm(step[:, :3], axis=1, keepdims=True)
        small = step[:, :3] * np.minimum(1.0, _LONGEST_TURN / np.maximum(angle, 1e-12)) / 2
        turns = np.array(hamilton_product(np.hstack([np.ones_like(angle), small]).T, presses[:, :4].T)).T
        sizes = np.clip(presses[:, 4] * (1.0 + np.clip(step[:, 3], -0.5, 0.5)), *self.sizes)
        places = (presses[:, 5:] + step[:, 4:]).reshape(len(step), -1, 3)
        low, high = (
            np.array([end, end, deeper]) for end, deeper in zip(self.offsets, (-_DEEPER, _DEEPER), strict=True)
        )
        offsets = np.clip(places, low, high).reshape(len(step), -1)
        return np.column_stack([turns / np.linalg.norm(turns, axis=1, keepdims=True), sizes, offsets])
