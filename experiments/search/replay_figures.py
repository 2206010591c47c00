"""Pictures of one search: all touches side by side, and what a joint belief knows about the bodies.

The picture of a shape is the mean over its orientations and sizes, which is sharper after each touch. Orientations that
look alike by symmetry give the same picture, so symmetric shapes become as sharp as others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from numpy.typing import NDArray

from activetouch import TactileSensor
from activetouch.pose_belief import PoseBelief
from activetouch.poses import WorldObject
from activetouch.rotation_cells import centres
from activetouch.solids.solid import Shape
from activetouch.view.portrait import portraits
from belief.naming import shape_name
from belief.observation_model.nested_bodies import NestedEvidence
from belief.observation_model.rigid_body import joint_model
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence
from belief.problem import SearchProblem
from experiments.report import INK, PALETTE, figure
from experiments.search.play import Frame, action_words, body_words, shown_shapes
from planners import Episode, Outcome
from planners.episode import moved_before

Floats = NDArray[np.float64]
BodyEvidence: TypeAlias = RigidBodyEvidence | NestedEvidence


@dataclass(frozen=True, eq=False)
class Bodies:
    """Hypotheses of the objects' orientations and sizes, and the shapes (nominal solids) that they may have.

    ``rests (N, 4)`` are orientations at rest, unit quaternions ``wxyz``, of each level of cells, or of one table of
    hypotheses; ``sizes (N,)`` are factors. A picture, of ``pixels`` in width and height, is the mean of ``draws``
    bodies.
    """

    shapes: Mapping[str, Shape]
    rests: Sequence[Floats]
    sizes: Floats
    pixels: int = 96
    draws: int = 64

    @classmethod
    def of(cls, sensor: TactileSensor, pixels: int = 96, draws: int = 64) -> Bodies | None:
        """Bodies of a sensor's joint belief; None for a sensor with any other observation model."""
        if (model := joint_model(sensor.model)) is not None:
            rests, sizes, _ = sensor.scene.hypotheses(model.num_hypotheses)
            return cls(sensor.scene.solids, [rests], sizes, pixels, draws)
        if (levels := getattr(getattr(sensor.model, "bodies", None), "levels", None)) is not None:
            return cls(sensor.scene.solids, list(map(centres, levels)), np.ones(1), pixels, draws)
        return None

    def likeliest(self, evidence: BodyEvidence, probs: Floats, number: int) -> list[tuple[str, float, Floats]]:
        """Label, probability and mean picture of likely shapes, ``(H, W, 2)``: shade times coverage, and coverage."""
        labels = list(self.shapes)
        found = []
        for shape in np.argsort(-probs, kind="stable")[:number].tolist():
            picture = self._mean(labels[shape], *self._hypotheses(evidence, shape))
            found.append((labels[shape], float(probs[shape]), picture))
        return found

    def lying(self, belief: PoseBelief) -> Floats:
        """Mean picture of a body that lies as is believed, ``(H, W, 2)``: shade times coverage, and coverage."""
        with np.errstate(divide="ignore"):
            return self._mean(belief.shape, belief.orientations, belief.sizes, np.log(belief.probs))

    def _mean(self, label: str, rests: Floats, sizes: Floats, log_weights: Floats) -> Floats:
        rows, counts = _draws(log_weights, self.draws)
        each = portraits(self.shapes[label], rests[rows], self._radius, self.pixels, sizes[rows])
        picture = np.stack([np.nan_to_num(each), np.isfinite(each)], axis=3)
        return np.average(picture, axis=0, weights=counts)

    def _hypotheses(self, evidence: BodyEvidence, shape: int) -> tuple[Floats, Floats, Floats]:
        """Orientations, sizes and log weights of the hypotheses of a shape."""
        if isinstance(evidence, RigidBodyEvidence):
            return self.rests[0], self.sizes, evidence.log_weights[shape]
        level, _, cell, log_weights = evidence.belief.leaves_of(np.array([shape]))
        rests = np.array([self.rests[at][one] for at, one in zip(level.tolist(), cell.tolist(), strict=True)])
        return rests, np.ones(len(rests)), log_weights

    def outline(self, label: str, body: WorldObject) -> Floats:
        """Whether the true body, whose shape has this label, covers each pixel, ``(H, W)``."""
        solid = self.shapes[label] if body.member is None else body.member
        picture = portraits(solid, body.orientation[None], self._radius, self.pixels, body.scale)[0]
        return np.isfinite(picture).astype(float)

    @property
    def _radius(self) -> float:
        """Half of a picture's width [m]."""
        return max(solid.bounding_radius for solid in self.shapes.values()) * float(self.sizes.max())


def _draws(log_weights: Floats, number: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of some hypotheses, and how many of so many even quantiles of the weights fall on each."""
    weights = np.exp(log_weights - log_weights.max())
    order = np.random.default_rng(0).permutation(len(weights))  # neighbours in the sequence have similar orientations
    above = weights[order].cumsum()
    drawn = np.searchsorted(above, (np.arange(number) + 0.5) / number * above[-1])
    rows, counts = np.unique(order[np.minimum(drawn, len(order) - 1)], return_counts=True)
    return rows, counts


_SHOWN = 2  # shapes whose orientation is drawn
_MOVED = 0.5  # probability of a move that is told
_SURFACE = LinearSegmentedColormap.from_list("surface", ["#0b1d33", "#3f6f9f", "#dbe7f2"])


def draw_search(
    episode: Episode, frames: list[Frame], problem: SearchProblem, path: Path, bodies: Bodies | None = None
) -> None:
    """Write a picture of a search: each touch image, the belief after it and, with ``bodies``, about orientation."""
    touched = [number for number, frame in enumerate(frames) if frame.image is not None]
    labels = problem.shape_labels
    shown = _SHOWN if bodies is not None else 0
    with figure((1.75 * max(len(touched), 3) + 0.9, 4.2 + 1.75 * shown), path) as drawn:
        ratios = (1.25, *[1.25] * shown, 1)
        grid = drawn.subplots(2 + shown, max(len(touched), 1), squeeze=False, height_ratios=ratios)
        for column, number in enumerate(touched):
            frame, following = frames[number], frames[number + 1]  # a touch is always followed by a decision
            assert frame.step.touch is not None, "it has an image"
            pose = problem.pose_labels[frame.step.touch.pose]
            top, bottom = grid[0, column], grid[-1, column]
            top.imshow(frame.image, cmap="magma", vmin=0, vmax=255, origin="lower")
            top.set(xticks=[], yticks=[])
            prob = moved_before(following.step) if following.step.object_index == frame.step.object_index else 0.0
            moved = f"\nhas moved: {prob:.2f}" if prob >= _MOVED else ""
            title = f"object {frame.step.object_index + 1} ({body_words(labels, frame.shape)})\npose {pose}{moved}"
            top.set_title(title)
            _bars(bottom, frame, episode, problem)
            if column:
                bottom.set_yticks([])
            bottom.set_xlabel(f"→ {action_words(following.step.decision.action, problem)}", fontweight="bold")
            if bodies is not None:
                _bodies(list(grid[1:-1, column]), frame, bodies, shape_name(labels, frame.shape))
        if not touched:
            for axes in grid[:, 0]:
                axes.set_axis_off()
            grid[0, 0].set_title("no touch")
        for axes, words in zip(grid[1:-1, 0], ("likeliest", "next"), strict=False):
            axes.set_ylabel(f"{words} body,\nas believed")
        if shown:
            drawn.supxlabel(
                "Bodies: mean picture over the posterior of orientation and size. Line: the true body.", size=9
            )
        drawn.suptitle(_title(episode, problem))


def _bars(axes: Axes, frame: Frame, episode: Episode, problem: SearchProblem) -> None:
    """Draw the belief after a step; the target has another colour."""
    shown = shown_shapes(frame.posterior, episode.target)
    colours = [PALETTE[1] if k == episode.target else "#9aa5b1" for k in shown]
    axes.barh([problem.shape_labels[k] for k in shown], frame.posterior[shown], color=colours)
    axes.set(xlim=(0, 1), xticks=(0, 0.5, 1))
    axes.invert_yaxis()


def _bodies(places: Sequence[Axes], frame: Frame, bodies: Bodies, true_label: str) -> None:
    """Draw the most probable shapes on one axis each, fainter if less probable; a line is the true outline."""
    assert frame.evidence is not None, "the model is a joint one"
    shown = bodies.likeliest(frame.evidence, frame.posterior, len(places))
    for axes, (label, prob, picture) in zip(places, shown, strict=True):
        axes.imshow(coloured(picture, prob), origin="lower")
        if label == true_label:
            outline = bodies.outline(label, frame.body)
            axes.contour(outline, levels=[0.5], colors=PALETTE[2], linewidths=1.3)
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
        axes.set_title(f"{label} {prob:.2f}", fontsize=9, color=INK, pad=2)


def coloured(picture: NDArray[np.float64], prob: float) -> NDArray[np.float64]:
    """Colours and opacity of a picture of :class:`Bodies`, ``(H, W, 4)``, fainter if the shape is less probable."""
    shade, coverage = np.moveaxis(picture, 2, 0)
    with np.errstate(invalid="ignore"):
        colours = np.asarray(_SURFACE(np.nan_to_num(shade / coverage)))
    colours[..., 3] = coverage * (0.25 + 0.75 * prob)
    return colours


def _title(episode: Episode, problem: SearchProblem) -> str:
    ended = "found" if episode.success else "unsure" if episode.outcome is Outcome.UNSURE else "failed"
    return f"Searching for a {problem.shape_labels[episode.target]}: {ended} after {episode.num_touches} touches"
