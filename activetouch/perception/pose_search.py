"""How an object of one shape lies, from the images of its touches: finer than the cells that shapes are told apart by.

Bodies are pressed as they might lie, without a simulation of physics (as :mod:`activetouch.perception.pressed_beliefs`
does), and the images are compared with those that were felt. Orientations and sizes are drawn near the likeliest cells,
then near what fits better and better, and weighed by how well they fit and how densely they were drawn (adaptive
importance sampling).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from activetouch.perception.contacts.close_look import CloseContacts
from activetouch.perception.contacts.hypotheses import cell_of
from activetouch.perception.imaging import Floats32, Imaging, SensorState, imaging_of, sensor_state
from activetouch.perception.pressed_beliefs import binned, blurred, compared, pressures
from activetouch.pose_belief import PoseBelief, turned_slightly
from activetouch.poses import turned
from activetouch.pressing.height_maps import Window, predicted_contacts
from activetouch.rendering import PressureRenderer
from activetouch.rotation_cells import centres
from activetouch.scene import Scene
from activetouch.solids.solid import Shape
from activetouch.symmetry import symmetry_of
from belief.errors import InvalidArgument
from belief.observation_model.nested_bodies import NestedEvidence
from belief.observation_model.rigid_body_evidence import joint_evidence
from belief.validation import Floats

_CELLS = 48  # of a body, among which the beginnings are
_WAYS = 6  # cells to begin with
_DRAWN, _ROUNDS, _AT_LAST = 32, (4, 10), 96
"""Orientations near each way to lie in every round, the least and largest number of rounds, and those at last."""
_EFFECTIVE = 6.0  # of a round, that the next is drawn by
_PARTS = "orientations", "log_sizes"
_BEHIND = 12.0  # log likelihood behind the best, at which a way to lie is given up
_WIDER = 1.5  # of the covariance that is drawn from
_LEAST = np.deg2rad(0.3), 0.002  # deviations that are drawn at least: of orientations [rad], of log sizes
_ERROR, _TRUST, _DRIFT = 0.05, 0.026, 0.3
"""Deviation of a pixel from its prediction, relative to full scale; the share of independent pixels in one touch, and
how that falls with the number of touches, as errors about one body come again."""
_LARGEST = 5.0  # residual of a pixel, in deviations
_PIXELS = 32  # along an edge, whose number the share is of
_TINY = 1e-12
_CELL = np.deg2rad(6.0)  # width of a cell of level 2


class Starts(NamedTuple):
    """Cells of orientations and sizes: their centres ``(s, 4)`` and ``(s,)``, log posteriors and width [rad]."""

    orientations: Floats
    sizes: Floats
    log_probs: Floats
    width: float


class _Draws(NamedTuple):
    """Small rotations and changes of the log size ``(n, 4)``, what they make of a way to lie, and their log density."""

    changes: Floats
    orientations: Floats
    log_sizes: Floats
    log_density: Floats


class _Proposal(NamedTuple):
    """A normal distribution of small rotations [rad] and changes of the log size about a way to lie."""

    orientation: Floats
    log_size: float
    covariance: Floats

    def draws(self, number: int, rng: np.random.Generator) -> _Draws:
        values, axes = np.linalg.eigh(self.covariance)
        deviations = np.sqrt(np.maximum(values, 0.0))
        free = deviations > 0.0
        drawn = rng.normal(size=(number, 4)) * free
        changes = (drawn * deviations) @ axes.T
        density = -0.5 * np.square(drawn).sum(axis=1) - np.log(deviations[free]).sum()
        orientations = turned_slightly(self.orientation, changes[:, :3])
        return _Draws(changes, orientations, self.log_size + changes[:, 3], density)

    def moved(self, draws: _Draws, log_weights: Floats) -> _Proposal:
        """About the mean of weighed draws; flatter weights are taken until enough draws count."""
        for flatter in 0.5 ** np.arange(8):
            weights = np.exp(flatter * (log_weights - log_weights.max()))
            weights /= weights.sum()
            if 1.0 / np.square(weights).sum() >= _EFFECTIVE:
                break
        mean = weights @ draws.changes
        about = draws.changes - mean
        least = np.where(np.diag(self.covariance) > 0.0, np.square([*[_LEAST[0]] * 3, _LEAST[1]]), 0.0)
        covariance = _WIDER * (about.T * weights) @ about + np.diag(least)
        return _Proposal(turned_slightly(self.orientation, mean[None, :3])[0], self.log_size + mean[3], covariance)


@dataclass(frozen=True, eq=False)
class PoseSearch:
    """Finds how objects of a scene lie.

    Attributes:
        scene: has the solids and the poses.
        imaging: of the sensor.
        state: of the sensor, arrays ``(1, ...)``.
    """

    scene: Scene
    imaging: Imaging
    state: SensorState

    @classmethod
    def of(cls, scene: Scene) -> PoseSearch:
        """For the sensor of a scene; raises WrongScene where its images cannot be predicted."""
        imaging = imaging_of(scene)
        return cls(scene, imaging, sensor_state(imaging, scene))

    def found(
        self, shape: str, poses: Sequence[int], images: Sequence[NDArray[np.uint8]], starts: Starts
    ) -> PoseBelief:
        """How an object lies, by the image felt in each of some poses; the same arguments give the same answer."""
        solid, rng = self.scene.solids[shape], np.random.default_rng(0)
        symmetry = symmetry_of(solid)
        felt, means = compared(np.stack(images), self._edge), list[tuple[Floats, float]]()
        for row in np.argsort(-starts.log_probs):
            q = starts.orientations[row]
            if all(symmetry.angles(q, other[None])[0] > starts.width for other, _ in means):
                means.append((q, float(np.log(starts.sizes[row]))))
            if len(means) == _WAYS:
                break
        wide = np.diag(np.square([*[starts.width] * 3, self._size_spread]))
        ways = [_Proposal(*mean, wide) for mean in means]
        least, most = _ROUNDS
        effective = 0.0
        for number in range(1, most + 1):
            is_last = number == most or (number >= least and effective >= _EFFECTIVE)
            draws = [way.draws(_AT_LAST if is_last else _DRAWN, rng) for way in ways]
            every, log_sizes = (np.concatenate([getattr(one, name) for one in draws]) for name in _PARTS)
            logs = self.log_likelihoods(solid, every, np.exp(log_sizes), poses, felt) + self._log_prior(log_sizes)
            scores = np.split(logs, len(ways))
            weights = [each - one.log_density for each, one in zip(scores, draws, strict=True)]
            kept = [row for row, each in enumerate(scores) if each.max() > logs.max() - _BEHIND]
            log_weights = np.concatenate([weights[row] for row in kept])
            probs = np.exp(log_weights - logsumexp(log_weights))
            if is_last:
                break
            effective = 1.0 / float(np.square(probs).sum())
            ways = [ways[row].moved(draws[row], weights[row]) for row in kept]
        every, log_sizes = (np.concatenate([getattr(draws[row], name) for row in kept]) for name in _PARTS)
        return PoseBelief(shape, every, np.exp(log_sizes), probs / probs.sum(), symmetry)

    def log_likelihoods(
        self, solid: Shape, orientations: Floats, sizes: Floats, poses: Sequence[int], felt: Floats32
    ) -> Floats:
        """Log likelihood of the images felt in some poses if the solid lies so, ``(n,)``, up to a constant.

        ``felt (m, e, e)`` are the images as :func:`~activetouch.perception.pressed_beliefs.compared` has them.
        Where the body was, off the approach axis, is unknown in each touch; its force is taken to be the mean.
        """
        total, trust = np.zeros(len(orientations)), _TRUST / (1.0 + _DRIFT * (len(felt) - 1))
        for pose, image in zip(poses, felt, strict=True):
            turns = turned(self.scene.rotations[self.scene.pose_labels[pose]], orientations)
            aim = self.scene.aim_offsets[pose]
            maps = predicted_contacts(solid, turns, aim, self._window, sizes, np.float32)
            logs, samples = [], self.imaging.samples
            for row, column in self._shifts:
                part = np.ascontiguousarray(maps[:, row : row + samples, column : column + samples])
                logs.append(self._log_fit(part, image))
            total += logsumexp(trust * np.array(logs), axis=0)
        return total

    def _log_fit(self, reached: Floats32, felt: Floats32) -> Floats:
        force = np.full(len(reached), sum(self.imaging.force) / 2.0)
        seen = pressures(self.imaging, reached, force, self.state)
        shown = binned(blurred(seen, self.state), self._edge)
        squared = np.square(np.clip((shown - felt) / _ERROR, -_LARGEST, _LARGEST)).sum(axis=(1, 2))
        return np.asarray(-0.5 * (_PIXELS / self._edge) ** 2 * squared, np.float64)

    @cached_property
    def _edge(self) -> int:
        return min(self.imaging.taxels, self.imaging.samples)

    @cached_property
    def _window(self) -> Window:
        return Window.of(self.imaging.pad, self.imaging.offset, self.imaging.samples)

    @cached_property
    def _shifts(self) -> list[tuple[int, int]]:
        """Corners of the pad in the window, for displacements of the body up to the largest."""
        most = (self._window.num_pixels - self.imaging.samples) // 2
        steps = sorted({round(part * most) for part in (-1.0, -0.5, 0.0, 0.5, 1.0)})
        return [(most + row, most + column) for row in steps for column in steps if row**2 + column**2 <= most**2 + 1]

    @cached_property
    def _size_range(self) -> tuple[float, float]:
        low, high = self.scene.variation.size.support
        return float(np.log(low)), float(np.log(high))

    @property
    def _size_spread(self) -> float:
        return (self._size_range[1] - self._size_range[0]) / np.sqrt(12.0)

    def _log_prior(self, log_sizes: Floats) -> Floats:
        low, high = self._size_range
        return np.where((log_sizes < low - _TINY) | (log_sizes > high + _TINY), -1e3, 0.0)


def cells_of(evidence: Any, scene: Scene, shape: int) -> Starts:
    """The cells of a shape by which an evidence tells shapes apart, or the likeliest of them.

    Raises:
        InvalidArgument: the observation model knows no orientations.
    """
    if isinstance(evidence, NestedEvidence) and evidence.model.moves is not None:
        leaves, levels = evidence.belief.leaves_of(np.array([shape])), evidence.model.bodies.levels  # type: ignore[attr-defined]
        each = zip(leaves.level.tolist(), leaves.cell.tolist(), strict=True)
        rests = np.stack([centres(levels[level])[cell] for level, cell in each])
        return Starts(rests, np.ones(len(rests)), leaves.log_weight, _CELL)
    if isinstance(evidence, NestedEvidence) and isinstance(bodies := evidence.model.bodies, CloseContacts):
        cells, logs = bodies.likely(shape, evidence.belief.touches, _CELLS)
        return Starts(centres(2)[cells], np.ones(len(cells)), evidence.belief.scale * logs, _CELL)
    if (joint := joint_evidence(evidence)) is None:
        raise InvalidArgument(
            f"{type(evidence).__name__} knows nothing of how objects lie; use the belief about one rigid body, the "
            "usual one of the scenes gel, coarse, hard and many"
        )
    number = joint.log_weights.shape[1]
    lying = scene.hypotheses(number)
    return Starts(lying.rests, lying.sizes, joint.log_weights[shape], cell_of(number))


def pose_of(
    scene: Scene, evidence: Any, shape: int, poses: Sequence[int], images: Sequence[NDArray[np.uint8]]
) -> PoseBelief:
    """How an object of a shape lies after the touches of an evidence, by the images felt in some of the poses.

    Without images, or where they cannot be predicted or the object may have moved between them, the cells of the
    evidence are the answer.
    """
    label, starts = scene.shape_labels[shape], cells_of(evidence, scene, shape)
    is_predicted = isinstance(scene.renderer, PressureRenderer) and scene.hand is None and label not in scene.families
    if len(images) and is_predicted and scene.moves is None:
        return PoseSearch.of(scene).found(label, poses, images, starts)
    probs = np.exp(starts.log_probs - logsumexp(starts.log_probs))
    symmetry = symmetry_of(scene.solids[label])
    return PoseBelief(label, starts.orientations, starts.sizes, probs / probs.sum(), symmetry)
