"""A search as an animated picture: the press, its image, the belief after it, and what becomes of each object."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from activetouch import TactileSensor
from activetouch.view import Bodies, coloured, press_picture
from belief.files import atomic_path
from belief.naming import shape_name
from belief.problem import SearchProblem
from experiments.parallel import progress_bar
from experiments.search.play import APPROACH, Moment, moments, shown_shapes
from planners import Episode

_SIZE, _DPI = (8.6, 3.9), 100
_SHAPES = 4  # whose bodies are drawn, and objects that have room for words


@dataclass(frozen=True)
class Theme:
    """The colours of a film."""

    paper: str
    sky: str
    ink: str
    faint: str
    good: str
    bad: str


LIGHT = Theme("#ffffff", "#eef1f6", "#1f2328", "#7d8590", "#1a7f5a", "#c0540a")
DARK = Theme("#0d1117", "#414b58", "#e6edf3", "#8b949e", "#3fb98f", "#f0883e")


class Film:
    """Draws the moments of a search with a sensor in a theme."""

    def __init__(self, sensor: TactileSensor, problem: SearchProblem, target: int, theme: Theme) -> None:
        self.scene, self.theme, self.target, self.labels = sensor.scene, theme, target, problem.shape_labels
        self.bodies = Bodies.of(sensor, pixels=80, draws=48)

    def draw(self, moment: Moment) -> Image.Image:
        """One picture."""
        theme = self.theme
        with matplotlib.style.context(["default", {"text.color": theme.ink, "axes.titlecolor": theme.ink}]):
            figure = Figure(figsize=_SIZE, dpi=_DPI)
            figure.text(0.02, 0.915, f"Find the {self.labels[self.target]}, by touch alone", size=16, weight="bold")
            colour = self._colour(moment.states[moment.frame.step.object_index], theme.ink)
            figure.text(0.02, 0.835, moment.words, size=12, color=colour)
            if self.scene.hand is None:
                self._world(figure.add_axes((0.015, 0.05, 0.345, 0.73)), moment)
                self._image(figure.add_axes((0.385, 0.30, 0.15, 0.33)), moment)
            else:
                self._image(figure.add_axes((0.03, 0.30, 0.49, 0.33)), moment)
            if self.bodies is None:
                self._bars(figure.add_axes((0.66, 0.33, 0.32, 0.42)), moment)
            else:
                self._shapes(figure, self.bodies, moment)
            self._objects(figure.add_axes((0.575, 0.06, 0.41, 0.17)), moment)
            buffer = io.BytesIO()
            figure.savefig(buffer, format="png", facecolor=theme.paper)
        return Image.open(buffer).convert("RGB")

    def _colour(self, state: str, usual: str) -> str:
        """The colour of an object in a state."""
        return {"rejected": self.theme.bad, "wrong": self.theme.bad, "found": self.theme.good}.get(state, usual)

    def _world(self, axes: Axes, moment: Moment) -> None:
        """The object and the pad."""
        red, green, blue = (int(self.theme.sky[k : k + 2], 16) for k in (1, 3, 5))
        view = {"size": (340, 320), "sky": (red, green, blue)}
        around = self.scene.around(moment.placement.shape)
        axes.imshow(press_picture(self.scene.pad, moment.placement, moment.depth, around, **view))
        axes.set_axis_off()

    def _image(self, axes: Axes, moment: Moment) -> None:
        """The tactile image."""
        image = np.zeros((4, 4)) if moment.image is None else moment.image
        axes.imshow(image, cmap="magma", vmin=0, vmax=160, origin="lower")
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
        axes.set_title("touch image", size=10)

    def _bars(self, axes: Axes, moment: Moment) -> None:
        """The probability of each shape."""
        shown, theme = shown_shapes(moment.probs, self.target), self.theme
        colours = [theme.good if shape == self.target else theme.faint for shape in shown]
        axes.barh([self.labels[shape] for shape in shown], moment.probs[shown], color=colours)
        axes.set(xlim=(0, 1), xticks=[], facecolor=theme.paper)
        axes.tick_params(axis="y", labelcolor=theme.ink, length=0)
        axes.spines[:].set_visible(False)
        axes.invert_yaxis()

    def _shapes(self, figure: Figure, bodies: Bodies, moment: Moment) -> None:
        """The likeliest shapes, averaged over what is still possible, with their probabilities."""
        theme, true = self.theme, shape_name(self.labels, moment.frame.shape)
        likeliest = bodies.likeliest(moment.evidence, moment.probs, _SHAPES)
        likeliest.sort(key=lambda shown: self.labels.index(shown[0]))
        for place, (label, prob, picture) in enumerate(likeliest):
            is_target = label == self.labels[self.target]
            axes = figure.add_axes((0.565 + 0.107 * place, 0.40, 0.105, 0.27))
            axes.imshow(coloured(picture, prob), origin="lower", alpha=0.2 + 0.8 * min(1.0, 2.0 * prob))
            if label == true:
                outline = bodies.outline(label, moment.frame.body)
                axes.contour(outline, levels=[0.5], colors=theme.faint, linewidths=1.0)
            axes.set_axis_off()
            axes.set_title(label, size=10, weight="bold" if is_target else "normal")
            bar = figure.add_axes((0.572 + 0.107 * place, 0.365, 0.091, 0.025))
            bar.barh(0, 1.0, color=theme.faint, alpha=0.3)
            bar.barh(0, prob, color=theme.good if is_target else theme.faint)
            bar.set(xlim=(0, 1))
            bar.set_axis_off()

    def _objects(self, axes: Axes, moment: Moment) -> None:
        """The objects in their order, and what has become of them."""
        theme, now, is_narrow = self.theme, moment.frame.step.object_index, len(moment.states) > _SHAPES
        for place, state in enumerate(moment.states):
            colour = self._colour(state, theme.ink if place == now else theme.faint)
            axes.add_patch(Rectangle((place + 0.05, 0.35), 0.9, 0.6, fill=False, edgecolor=colour, linewidth=1.6))
            label = f"{place + 1}" if is_narrow else f"object {place + 1}"
            axes.text(place + 0.5, 0.65, label, ha="center", va="center", size=10, color=colour)
            if not is_narrow:
                words = state or ("here" if place == now else "waiting")
                axes.text(place + 0.5, 0.1, words, ha="center", va="center", size=9, color=colour)
        axes.set(xlim=(0, len(moment.states)), ylim=(0, 1))
        axes.set_axis_off()


def write_film(
    sensor: TactileSensor, problem: SearchProblem, episode: Episode, path: Path, theme: Theme = LIGHT
) -> None:
    """Write a search as an animated picture, in a file that ends in .webp or .gif."""
    shown, film = moments(sensor, problem, episode, APPROACH), Film(sensor, problem, episode.target, theme)
    with progress_bar() as progress:
        first, *rest = progress.track(map(film.draw, shown), len(shown), description=f"drawing → {path}")
    durations = [moment.milliseconds for moment in shown]
    with atomic_path(path) as temporary:
        first.save(temporary, save_all=True, append_images=rest, duration=durations, loop=0, quality=82, method=6)
