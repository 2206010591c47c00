"""The observation model of bodies that move between touches, and of poses that are missed, as a scene says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy  # whose parts load at first use

from activetouch.distributions import Bodies
from activetouch.errors import WrongScene
from activetouch.orientations import Inexact, Tumbled
from activetouch.perception.contacts.hypotheses import cell_of
from activetouch.scene import Scene
from belief.cell_kernel import CellKernel
from belief.observation_model.model import ArrayModel
from belief.observation_model.moving_body import MovingBodyModel
from belief.observation_model.rigid_body import RigidBodyModel
from belief.validation import Floats

_LARGER = 1.1  # a pose error by its cell, from which cells do not express it
_SIZES = 0.15  # deviation of sizes, and of places in a family, that count as equal, relative to their range
_FARTHEST = 3.0  # deviations


def missed_by(scene: Scene, num_hypotheses: int) -> float:
    """Deviation about each axis [rad] by which poses are missed, beyond the cells of so many hypotheses; 0 for none.

    >>> from activetouch import SCENES
    >>> gel = SCENES["gel"].scene
    >>> [round(missed_by(replace(gel, presentation=Inexact(error)), 2048), 3) for error in (0.09, 0.35)]
    [0.0, 0.336]
    """
    if not isinstance(scene.presentation, Inexact):
        return 0.0
    cell, error = cell_of(num_hypotheses), scene.presentation.error
    return float(np.sqrt(error**2 - cell**2)) if error > _LARGER * cell else 0.0


def in_exact_poses(scene: Scene, num_hypotheses: int) -> Scene:
    """The scene in which a model is fitted: with exact poses where :func:`moving_model` knows how they are missed."""
    return replace(scene, presentation=Tumbled()) if missed_by(scene, num_hypotheses) else scene


def moving_model(model: ArrayModel, scene: Scene) -> ArrayModel:
    """A model for the moves and the pose errors of a scene; the model itself where there are none.

    Raises:
        WrongScene: objects move, and the belief is not about one rigid body of unknown orientation.
    """
    if not isinstance(model, RigidBodyModel):
        if scene.moves is not None:
            raise WrongScene(
                f"only a belief about one rigid body knows of objects that move, not {type(model).__name__}: leave out "
                "moves, or the state of the sensor that is to be inferred"
            )
        return model
    number, moves = model.num_hypotheses, scene.moves
    error = missed_by(scene, number)
    if not (error or moves):
        return model
    bodies = scene.hypotheses(number)
    miss = kernel_of(scene, bodies, error) if error else None
    if moves is None:
        return MovingBodyModel.of(model, error=miss)
    wide = float(np.hypot(moves.angle, np.sqrt(2.0) * cell_of(number)))  # from anywhere in a cell to anywhere in one
    return MovingBodyModel.of(model, moves.prob, kernel_of(scene, bodies, wide), miss)


def kernel_of(scene: Scene, bodies: Bodies, deviation: float) -> CellKernel:
    """Turns between N hypotheses with a deviation about each axis [rad], which keep the size and the proportions."""
    low, high = scene.variation.size.support
    parts = [(bodies.sizes - low) / (high - low)] if high > low else []
    parts += [bodies.shares] if scene.families else []
    return rotation_kernel(bodies.rests, deviation, np.full(len(bodies.rests), 1.0), parts)


def rotation_kernel(
    orientations: Floats, deviation: float, shares: Floats, others: list[Floats] | None = None
) -> CellKernel:
    """Random turns between cells of ``orientations (N, 4)``, with a deviation about each axis [rad].

    ``shares (N,)`` are prior probabilities of the cells. ``others`` are numbers in [0, 1] of each cell, ``(N,)``, that
    turns keep, as far as the cells allow.
    """
    number, half = len(orientations), deviation / 2.0
    both = np.concatenate([orientations, -orientations])
    cosine = 1.0 / np.hypot(1.0, _FARTHEST * half)  # of half the largest angle
    tree, other = scipy.spatial.cKDTree(orientations), scipy.spatial.cKDTree(both)
    pairs = tree.sparse_distance_matrix(other, np.sqrt(2.0 - 2.0 * cosine), output_type="coo_matrix")
    rows, columns = pairs.row, pairs.col % number
    squared = 1.0 / np.square(1.0 - np.square(pairs.data) / 2.0) - 1.0  # tangent of half the angle
    logs = 2.0 * np.log1p(squared) - squared / (2.0 * half**2)
    for each in others or []:
        apart = np.abs(each[rows] - each[columns]) / _SIZES
        logs = np.where(apart < _FARTHEST, logs - np.square(apart) / 2.0, -np.inf)
    near = np.isfinite(logs)
    closeness = scipy.sparse.coo_array((np.exp(logs[near]), (rows[near], columns[near])), shape=(number, number))
    return CellKernel.of(closeness, shares)
