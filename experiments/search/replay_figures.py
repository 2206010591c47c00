"""A picture of one search: all touches side by side, with what a joint belief knows about the bodies."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from activetouch.pressing.contact import PressedObject
from activetouch.scene import Scene
from activetouch.view import Bodies, coloured, press_picture
from belief.naming import shape_name
from belief.problem import SearchProblem
from experiments.report import INK, PALETTE, figure
from experiments.search.play import Frame, action_words, body_words, shown_shapes
from planners import Episode, Outcome
from planners.episode import moved_before

_SHOWN = 2  # shapes whose orientation is drawn
_MOVED = 0.5  # probability of a move that is told


def draw_search(
    episode: Episode,
    frames: list[Frame],
    problem: SearchProblem,
    path: Path,
    bodies: Bodies | None = None,
    scene: Scene | None = None,
) -> None:
    """Write a picture of a search, a column for each touch.

    It shows the object at the pad where ``scene`` is given and has no hand, what was felt, with ``bodies`` what is
    believed of the likeliest ones, and the belief after the touch.
    """
    touched = [number for number, frame in enumerate(frames) if frame.image is not None]
    labels = problem.shape_labels
    shown = _SHOWN if bodies is not None else 0
    world = int(scene is not None and scene.hand is None)
    with figure((1.75 * max(len(touched), 3) + 0.9, 4.2 + 1.75 * (shown + world)), path) as drawn:
        ratios = (*[1.25] * (1 + world + shown), 1)
        grid = drawn.subplots(2 + world + shown, max(len(touched), 1), squeeze=False, height_ratios=ratios)
        for column, number in enumerate(touched):
            frame, following = frames[number], frames[number + 1]  # a touch is always followed by a decision
            assert frame.step.touch is not None, "it has an image"
            assert frame.pressed is not None, "it was felt"
            pose = problem.pose_labels[frame.step.touch.pose]
            top, bottom = grid[0, column], grid[-1, column]
            if scene is not None and world:
                _press(top, scene, frame.pressed)
            felt = grid[world, column]
            felt.imshow(frame.pressed.image, cmap="magma", vmin=0, vmax=255, origin="lower")
            felt.set(xticks=[], yticks=[])
            prob = moved_before(following.step) if following.step.object_index == frame.step.object_index else 0.0
            moved = f"\nhas moved: {prob:.2f}" if prob >= _MOVED else ""
            title = f"object {frame.step.object_index + 1} ({body_words(labels, frame.shape)})\npose {pose}{moved}"
            top.set_title(title)
            _bars(bottom, frame, episode, problem)
            if column:
                bottom.set_yticks([])
            bottom.set_xlabel(f"→ {action_words(following.step.decision.action, problem)}", fontweight="bold")
            if bodies is not None:
                _bodies(list(grid[1 + world : -1, column]), frame, bodies, shape_name(labels, frame.shape))
        if not touched:
            for axes in grid[:, 0]:
                axes.set_axis_off()
            grid[0, 0].set_title("no touch")
        for axes, words in zip(grid[1 + world : -1, 0], ("likeliest", "next"), strict=False):
            axes.set_ylabel(f"{words} body,\nas believed")
        if shown:
            drawn.supxlabel(
                "Bodies: mean picture over the posterior of orientation and size. Line: the true body.", size=9
            )
        drawn.suptitle(_title(episode, problem))


def _press(axes: Axes, scene: Scene, pressed: PressedObject) -> None:
    """Draw the object at the pad."""
    placement, depth = pressed.placement, pressed.contact.depth
    view: dict[str, Any] = {"size": (300, 300), "sky": (238, 241, 246)}
    axes.imshow(press_picture(scene.pad, placement, depth, scene.around(placement.shape), **view))
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


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


def _title(episode: Episode, problem: SearchProblem) -> str:
    ended = "found" if episode.success else "unsure" if episode.outcome is Outcome.UNSURE else "failed"
    return f"Searching for a {problem.shape_labels[episode.target]}: {ended} after {episode.num_touches} touches"
