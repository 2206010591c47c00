"""How an object lies: the sensor's belief, and registration of contact points by small-gicp, from the same touches.

    python -m benchmarks.registration FOLDER --objects 100 --touches 4 8

FOLDER holds the meshes, and the true file is known. Each object lies at random and is pressed in random poses. The
belief reads the images. Registration is given more: the true heights of the pressed taxels, without noise, as points
of the body in the frame of the robot. It starts from the centres of the 108 coarsest cells of orientations (or of those
of ``--level``), each refined by GICP on points of the surface, and the one whose points lie closest is its answer.
Needs ``pip install small-gicp``. Prints errors less what the symmetry of the body hides [deg].
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from activetouch import TactileSensor
from activetouch.poses import to_matrices, to_matrix
from activetouch.pressing.contact import PressedObject, first_touch
from activetouch.rotation_cells import centres
from activetouch.solids.solid import Shape
from activetouch.symmetry import symmetry_of

Floats = NDArray[np.float64]
_MM = 1e3
_PRESSED = 0.05  # of the largest pressure
_POINTS = 6000  # of a surface
_REACH = 15.0  # mm within which points correspond
_TRIMMED = 0.9  # share of the points that count in the choice of the best start


def surface_points(solid: Shape, rng: np.random.Generator) -> Floats:
    """Points on the surface of a solid at nominal size, evenly by area, ``(_POINTS, 3)`` [mm]."""
    triangles = solid.surface.vertices.T[solid.surface.faces.T]
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(across, axis=1)
    chosen = triangles[rng.choice(len(triangles), _POINTS, p=areas / areas.sum())]
    weights = rng.dirichlet(np.ones(3), _POINTS)
    return _MM * np.einsum("nc,ncx->nx", weights, chosen)


def contact_points(pressed: PressedObject, rotation: Floats) -> Floats:
    """Pressed points of the body, in the frame in which it lies, ``(n, 3)`` [mm], as if nothing were off the axis."""
    contact = pressed.contact
    _, touching = first_touch(contact.pad, pressed.placement)
    is_pressed = (contact.pressure > _PRESSED * contact.pressure.max()).ravel()
    depth = (touching - contact.gap).ravel()[is_pressed]
    points = np.column_stack([-depth, *contact.pad.taxel_centres[1:, is_pressed]])
    return _MM * points @ to_matrix(rotation)


class Registration:
    """Finds how a solid lies from points of it."""

    def __init__(self, solid: Shape, level: int, rng: np.random.Generator) -> None:
        import small_gicp

        self._points = surface_points(solid, rng)
        self._target, self._tree = small_gicp.preprocess_points(self._points, downsampling_resolution=1.0)
        self._near, self._align = cKDTree(self._points), small_gicp.align
        self._prepared = small_gicp.preprocess_points
        self._starts = to_matrices(centres(level))

    def found(self, points: Floats) -> Floats:
        """The orientation ``wxyz`` of the best fit."""
        source, _ = self._prepared(points, downsampling_resolution=1.0)
        best, least = np.eye(3), np.inf
        for start in self._starts:
            guess = np.eye(4)
            guess[:3, :3] = start.T
            found = self._align(self._target, source, self._tree, guess, max_correspondence_distance=_REACH)
            turn, shift = found.T_target_source[:3, :3], found.T_target_source[:3, 3]
            away = np.sort(self._near.query(points @ turn.T + shift)[0])
            score = float(away[: int(_TRIMMED * len(away))].mean())
            if score < least:
                best, least = turn, score
        return Rotation.from_matrix(best.T).as_quat(scalar_first=True)


def row(name: str, errors: list[float]) -> str:
    """A line of the table."""
    middle, worst = np.quantile(errors, [0.5, 0.9])
    return f"{name:<28} {len(errors):4d} {middle:8.1f} {worst:10.1f}"


def main() -> None:
    """Press the objects, find how they lie in both ways, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--objects", type=int, default=100)
    parser.add_argument("--touches", type=int, nargs="+", default=[4, 8])
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--level", type=int, default=0)
    given = parser.parse_args()
    sensor = TactileSensor.shipped("gel").with_objects(given.folder)
    scene, labels = sensor.scene, list(sensor.shape_labels)
    errors: dict[tuple[str, int], list[float]] = {}
    fits: dict[str, Registration] = {}
    for number in track(range(given.objects), "objects"):
        rng = np.random.default_rng([given.seed, number])
        label = labels[number % len(labels)]
        lying, symmetry = scene.sample_object(label, rng), symmetry_of(scene.solids[label])
        poses = rng.integers(len(scene.poses), size=max(given.touches))
        presses = [scene.press(lying, int(pose), rng) for pose in poses]
        turns = [scene.rotations[scene.pose_labels[pose]] for pose in poses]
        points = [contact_points(one, turn) for one, turn in zip(presses, turns, strict=True)]
        fit = fits.setdefault(label, Registration(scene.solids[label], given.level, np.random.default_rng(0)))
        for num in given.touches:
            images = np.stack([one.image for one in presses[:num]])
            belief = sensor.pose(label, images, poses[:num].tolist())
            registered = fit.found(np.concatenate(points[:num]))
            off = float(np.rad2deg(symmetry.angles(np.asarray(lying.orientation), registered[None])[0]))
            errors.setdefault(("belief", num), []).append(belief.error(lying.orientation))
            errors.setdefault(("small-gicp", num), []).append(off)
    print(f"{'error [deg]':<28} {'n':>4} {'median':>8} {'worst 10 %':>10}")
    for (name, num), each in sorted(errors.items()):
        print(row(f"{name}, {num} touches", each))


if __name__ == "__main__":
    main()
