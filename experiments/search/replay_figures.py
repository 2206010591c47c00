"""Figures of one search: all touches side by side, or an animation with one picture per step."""

from __future__ import annotations

import io
from pathlib import Path

from matplotlib.axes import Axes
from PIL import Image

from belief import SearchProblem
from experiments.reporting.style import PALETTE, figure
from experiments.search.frames import Frame, action_words
from planners import Episode

_MILLISECONDS, _LAST_MILLISECONDS = 1200, 3500


def draw_search(episode: Episode, frames: list[Frame], problem: SearchProblem, path: Path) -> None:
    """Write a picture with every touch image of a search and the belief after it.

    Args:
        episode: search to draw.
        frames: frames of this search.
        problem: rules of the search.
        path: file to write; the ending decides the format.

    Raises:
        CannotWrite: The disk is full, or the folder is not writable.
    """
    touched = [number for number, frame in enumerate(frames) if frame.image is not None]
    labels = problem.shape_labels
    with figure((1.75 * max(len(touched), 3) + 0.9, 4.2), path) as drawn:
        grid = drawn.subplots(2, max(len(touched), 1), squeeze=False, height_ratios=(1.25, 1))
        for column, number in enumerate(touched):
            frame, following = frames[number], frames[number + 1]  # a touch is always followed by a decision
            assert frame.step.touch is not None, "it has an image"
            pose = problem.pose_labels[frame.step.touch.pose]
            top, bottom = grid[0, column], grid[1, column]
            top.imshow(frame.image, cmap="magma", vmin=0, vmax=255, origin="lower")
            top.set(xticks=[], yticks=[])
            top.set_title(f"object {frame.step.object_index + 1} (a {labels[frame.shape]})\npose {pose}")
            _bars(bottom, frame, episode, problem)
            if column:
                bottom.set_yticks([])
            bottom.set_xlabel(f"→ {action_words(following.step.decision.action, problem)}", fontweight="bold")
        drawn.suptitle(_title(episode, problem))


def animate_search(episode: Episode, frames: list[Frame], problem: SearchProblem, path: Path) -> None:
    """Write a search as an animated GIF or WebP, one picture per step; arguments as :func:`draw_search`."""
    pictures, touched = [], None
    for number, frame in enumerate(frames):
        if frame.image is not None:
            touched = frame
        elif touched is not None and touched.step.object_index != frame.step.object_index:
            touched = None
        with figure((6.4, 3.4)) as drawn:
            left, right = drawn.subplots(1, 2, width_ratios=(1, 1.1))
            if touched is None:
                left.text(0.5, 0.5, "not touched yet", ha="center", va="center", transform=left.transAxes)
            else:
                left.imshow(touched.image, cmap="magma", vmin=0, vmax=255, origin="lower")
            left.set(xticks=[], yticks=[])
            left.set_title(f"object {frame.step.object_index + 1} of {problem.num_objects}")
            _bars(right, frame, episode, problem)
            right.set_title(action_words(frame.step.decision.action, problem), fontweight="bold")
            drawn.suptitle(_title(episode, problem) if number == len(frames) - 1 else _sought(episode, problem))
            buffer = io.BytesIO()
            drawn.savefig(buffer, format="png", dpi=100)
        pictures.append(Image.open(buffer).convert("RGB"))
    times = [_MILLISECONDS] * (len(pictures) - 1) + [_LAST_MILLISECONDS]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=times, loop=0)


def _bars(axes: Axes, frame: Frame, episode: Episode, problem: SearchProblem) -> None:
    """Draw the belief after a step; the target has another colour."""
    labels = problem.shape_labels
    colours = [PALETTE[1] if k == episode.target else "#9aa5b1" for k in range(len(labels))]
    axes.barh(labels, frame.posterior, color=colours)
    axes.set(xlim=(0, 1), xticks=(0, 0.5, 1))
    axes.invert_yaxis()


def _sought(episode: Episode, problem: SearchProblem) -> str:
    return f"Searching for a {problem.shape_labels[episode.target]}"


def _title(episode: Episode, problem: SearchProblem) -> str:
    return (
        f"{_sought(episode, problem)}: {'found' if episode.success else 'failed'} after {episode.num_touches} touches"
    )
