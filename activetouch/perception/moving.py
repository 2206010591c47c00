"""The observation model of bodies that move between touches, and of poses that are missed, as a scene says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.distributions import Bodies, quaternions
from activetouch.errors import WrongScene
from activetouch.orientations import ANEW, Inexact, Tumbled
from activetouch.perception.contacts.hypotheses import cell_of
from activetouch.rotation_cells import LEVELS, centres, nearest
from activetouch.scene import Scene
from belief.cell_kernel import CellKernel
from belief.observation_model.model import ArrayModel
from belief.observation_model.moving_body import MovingBodyModel
from belief.observation_model.nested_bodies import NestedBodyModel
from belief.observation_model.rigid_body import RigidBodyModel
from belief.validation import Floats

_LARGER = 1.1  # a pose error by its cell, from which cells do not express it
_SIZES = 0.15  # deviation of sizes, and of places in a family, that count as equal, relative to their range
_FARTHEST = 3.0  # deviations
_HALVINGS = 10  # of the range in which a deviation is found
_BINS = 8  # of sizes, and of places in a family
_WIDE = 0.6  # width of the cells that share their turns, relative to the deviation of a turn


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
    """The scene in which a model is fitted: objects stay, in exact poses, where :func:`moving_model` knows better."""
    is_told = missed_by(scene, num_hypotheses) or isinstance(scene.presentation, ANEW)
    return replace(scene, presentation=Tumbled()) if is_told else scene


def moving_model(model: ArrayModel, scene: Scene) -> ArrayModel:
    """A model for the moves and the pose errors of a scene; the model itself where there are none.

    Where objects lie anew in each touch, touches tell of the same shape and size, and of no common orientation.

    Raises:
        WrongScene: objects move, and the belief is not about one rigid body of unknown orientation.
    """
    if isinstance(model, NestedBodyModel) and scene.moves is not None:
        return replace(model, moves=(_nested_kernel(model, scene.moves.angle), scene.moves.prob), strangers=None)
    if not isinstance(model, RigidBodyModel):
        if scene.moves is not None:
            raise WrongScene(
                f"only a belief about one rigid body knows of objects that move, not {type(model).__name__}: leave out "
                "moves, or the state of the sensor that is to be inferred"
            )
        return model
    number, moves = model.num_hypotheses, scene.moves
    if isinstance(scene.presentation, ANEW):
        return MovingBodyModel.of(model, 1.0, anew_kernel(scene, scene.hypotheses(number)))
    error = missed_by(scene, number)
    if not (error or moves):
        return model
    bodies = scene.hypotheses(number)
    miss = missing_kernel(scene, bodies, error) if error else None
    if moves is None:
        return MovingBodyModel.of(model, error=miss)
    return MovingBodyModel.of(model, moves.prob, turning_kernel(bodies.rests, moves.angle), miss)


def anew_kernel(scene: Scene, bodies: Bodies) -> CellKernel:
    """From any of N hypotheses to any other of about its size and proportions."""
    bins = np.zeros(len(bodies.rests), np.int64)
    for each in _kept(scene, bodies):
        bins = _BINS * bins + np.minimum(each * _BINS, _BINS - 1).astype(np.int64)
    used, wide = np.unique(bins, return_inverse=True)
    return CellKernel.of(np.eye(len(used)), np.ones(len(wide)), wide)


def missing_kernel(scene: Scene, bodies: Bodies, deviation: float) -> CellKernel:
    """Turns between N hypotheses with a deviation about each axis [rad], which keep the size and the proportions."""
    return turns(bodies.rests, deviation, deviation, np.ones(len(bodies.rests)), kept=_kept(scene, bodies))


def _kept(scene: Scene, bodies: Bodies) -> list[Floats]:
    """What a turn keeps of N hypotheses, numbers in [0, 1], ``(N,)`` each: sizes and places in a family that differ."""
    low, high = scene.variation.size.support
    sizes = [(bodies.sizes - low) / (high - low)] if high > low else []
    return sizes + ([bodies.shares] if scene.families else [])


def turning_kernel(rests: Floats, deviation: float, shares: Floats | None = None) -> CellKernel:
    """Turns with a deviation about each axis [rad], from anywhere in a cell to anywhere in another.

    The cells have the middles ``rests (N, 4)`` and prior probabilities ``shares (N,)``, equal ones by default. Those in
    a wide cell share their turns, as far as these are wide; the size is forgotten.
    """
    number, shares = len(rests), np.ones(len(rests)) if shares is None else shares
    whole = float(np.hypot(deviation, np.sqrt(2.0) * cell_of(number)))
    for fewer in (number // 2**power for power in range(6, 0, -1)):
        if fewer and cell_of(fewer) <= _WIDE * deviation:
            spread = quaternions(fewer)
            used, wide = np.unique(nearest(rests, spread), return_inverse=True)
            middles = spread[used]
            within = np.square(_angles(rests, middles[wide])).mean() / 3.0  # about each axis, before and after
            return turns(middles, np.sqrt(whole**2 - 2.0 * within), whole, shares, wide)
    return turns(rests, whole, whole, shares)


def _nested_kernel(model: NestedBodyModel, deviation: float) -> CellKernel:
    """Turns between the coarsest cells, within which what has moved is anywhere."""
    middles = next(found for level in range(LEVELS) if len(found := centres(level)) == len(model.cells.shares[0]))
    own = np.sqrt(max(deviation**2 - 2.0 * cell_of(len(middles)) ** 2, deviation**2 / 4.0))
    return turns(middles, own, deviation, model.cells.shares[0])


def turns(
    middles: Floats,
    deviation: float,
    widest: float,
    shares: Floats,
    wide: NDArray[np.int64] | None = None,
    kept: Sequence[Floats] = (),
) -> CellKernel:
    """Random turns between M wide cells with middles ``middles (M, 4)``, with a deviation about each axis [rad].

    They are no farther than some deviations of ``widest`` [rad]. Where cells are wider than the deviation, the density
    at their middles would be too narrow; it is widened until the turns are right. ``shares`` and ``wide`` are those of
    :meth:`CellKernel.of`. ``kept`` are numbers in [0, 1] of each cell, ``(M,)``, that turns keep as far as cells allow.
    """
    number = len(middles)
    cosine = 1.0 / np.hypot(1.0, _FARTHEST * widest / 2.0)  # of half the largest angle
    tree, other = (scipy.spatial.cKDTree(each) for each in (middles, np.concatenate([middles, -middles])))
    pairs = tree.sparse_distance_matrix(other, np.sqrt(2.0 - 2.0 * cosine), output_type="coo_matrix")
    rows, columns = pairs.row, pairs.col % number
    squared = 1.0 / np.square(1.0 - np.square(pairs.data) / 2.0) - 1.0  # tangent of half the angle
    alike, near = np.zeros(len(rows)), np.ones(len(rows), np.bool_)
    for each in kept:
        apart = np.abs(each[rows] - each[columns]) / _SIZES
        alike, near = alike - np.square(apart) / 2.0, near & (apart < _FARTHEST)
    rows, columns, squared, alike = rows[near], columns[near], squared[near], alike[near]
    low, high = deviation / 4.0, deviation * 4.0
    for _ in range(_HALVINGS):
        tried = np.sqrt(low * high)
        density = np.exp(alike + 2.0 * np.log1p(squared) - squared / (2.0 * (tried / 2.0) ** 2))
        found = CellKernel.of(scipy.sparse.coo_array((density, (rows, columns)), shape=(number, number)), shares, wide)
        apart = _angles(np.repeat(middles, np.diff(found.starts), axis=0), middles[found.columns])
        low, high = (tried, high) if found.joint @ np.square(apart) / 3.0 < deviation**2 else (low, tried)
    return found


def _angles(one: Floats, other: Floats) -> Floats:
    """Between unit quaternions ``(n, 4)`` [rad], ``(n,)``."""
    return np.asarray(2.0 * np.arccos(np.minimum(np.abs(np.einsum("ni,ni->n", one, other)), 1.0)))
