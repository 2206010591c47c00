"""Draw the moving picture at the top of README.md: one search in the scene "coarse", in a light and a dark version.

Run: python docs/generate/lead.py        (writes docs/lead/search.webp and docs/lead/search_dark.webp, about a minute)
"""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from PIL import Image

from activetouch import TactileSensor
from activetouch.poses import Placement
from activetouch.view.picture import press_picture
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence, joint_evidence
from belief.problem import Probe, Reject
from belief.seeding import touch_rng
from experiments.search.play import Frame, replay
from experiments.search.replay_figures import Bodies, coloured

FOLDER = Path(__file__).parent.parent / "lead"
TARGET, SEED = "cone", 9
_APPROACH = (-0.016, -0.009, -0.003)
"""Depths of an object on its way to the pad [m]."""
_MOVING, _TOUCHED, _DECIDED, _ENDED = 120, 1500, 1700, 5000
"""How long pictures of each kind are shown [ms]."""
_SIZE, _DPI = (8.6, 3.9), 100


@dataclass(frozen=True)
class Theme:
    """Name of a file, and the colours in it."""

    name: str
    paper: str
    sky: str
    ink: str
    faint: str
    good: str
    bad: str


THEMES = (
    Theme("search", "#ffffff", "#eef1f6", "#1f2328", "#7d8590", "#1a7f5a", "#c0540a"),
    Theme("search_dark", "#0d1117", "#414b58", "#e6edf3", "#8b949e", "#3fb98f", "#f0883e"),
)


@dataclass(frozen=True, eq=False)
class Moment:
    """One picture of the film.

    Attributes:
        placement: the object in front of the pad.
        depth: of the object in the pad [m]; negative on its way there.
        frame: the step of the search.
        image: tactile image of the last touch of this object; None before the first.
        evidence: from its touches.
        probs: belief about its shape.
        states: what has become of each object: "", "rejected" or "found".
        words: what happens.
        milliseconds: how long the picture is shown.
    """

    placement: Placement
    depth: float
    frame: Frame
    image: NDArray[np.uint8] | None
    evidence: RigidBodyEvidence
    probs: NDArray[np.float64]
    states: tuple[str, ...]
    words: str
    milliseconds: int


def moments(sensor: TactileSensor) -> Iterator[Moment]:
    """The pictures of one search, in order."""
    problem = sensor.problem()
    episode = sensor.search(TARGET, decider="information_gain", seed=SEED)
    start = joint_evidence(sensor.model.start())
    assert start is not None, "the sensor of this scene has a joint model"
    uses: Counter[tuple[int, int]] = Counter()
    states = [""] * problem.num_objects
    image, evidence, pressed = None, start, None
    for frame in replay(sensor, problem, episode):
        index, action, before = frame.step.object_index, frame.step.decision.action, frame.step.belief.probs
        name, number, milliseconds, words = f"Object {index + 1}", sum(uses.values()), _DECIDED, ""
        if isinstance(action, Probe):
            assert frame.evidence is not None, "it is touched"
            rng = touch_rng(episode.seed, index, action.pose, uses[index, action.pose])
            uses[index, action.pose] += 1
            pressed = sensor.scene.press(frame.body, action.pose, rng)
            words = f"{name}, touch {number + 1}"
            for depth in _APPROACH:
                where = pressed.placement
                yield Moment(where, depth, frame, image, evidence, before, tuple(states), words, _MOVING)
            image, evidence, before, milliseconds = frame.image, frame.evidence, frame.posterior, _TOUCHED
        elif isinstance(action, Reject):
            states[index], words = "rejected", f"{name} is no {TARGET}: rejected"
        else:
            states[index], milliseconds = "found", _ENDED
            share = before[problem.shape_labels.index(TARGET)]
            words = f"{name} is the {TARGET} (probability {share:.3f}): found with {number} touches"
        assert pressed is not None, "an object is touched before it is judged"
        where, depth = pressed.placement, pressed.contact.depth
        yield Moment(where, depth, frame, image, evidence, before, tuple(states), words, milliseconds)
        if isinstance(action, Reject):
            image, evidence = None, start


class Film:
    """Draws the moments of a search of a sensor in a theme."""

    def __init__(self, sensor: TactileSensor, theme: Theme) -> None:
        self.scene, self.theme = sensor.scene, theme
        bodies = Bodies.of(sensor, pixels=80, draws=48)
        assert bodies is not None, "the sensor of this scene has a joint model"
        self.bodies = bodies

    def draw(self, moment: Moment) -> Image.Image:
        """One picture."""
        theme = self.theme
        with matplotlib.style.context(["default", {"text.color": theme.ink, "axes.titlecolor": theme.ink}]):
            figure = Figure(figsize=_SIZE, dpi=_DPI)
            figure.text(0.02, 0.915, f"Find the {TARGET}, by touch alone", size=16, weight="bold")
            colour = {"rejected": theme.bad, "found": theme.good}.get(moment.states[moment.frame.step.object_index])
            figure.text(0.02, 0.835, moment.words, size=12, color=colour or theme.ink)
            self._world(figure.add_axes((0.015, 0.05, 0.345, 0.73)), moment)
            self._image(figure.add_axes((0.385, 0.30, 0.15, 0.33)), moment)
            self._shapes(figure, moment)
            self._objects(figure.add_axes((0.575, 0.06, 0.41, 0.17)), moment)
            buffer = io.BytesIO()
            figure.savefig(buffer, format="png", facecolor=theme.paper)
        return Image.open(buffer).convert("RGB")

    def _world(self, axes: Axes, moment: Moment) -> None:
        """The object and the pad."""
        red, green, blue = (int(self.theme.sky[k : k + 2], 16) for k in (1, 3, 5))
        view = {"size": (340, 320), "sky": (red, green, blue)}
        axes.imshow(press_picture(self.scene.pad, moment.placement, moment.depth, **view))
        axes.set_axis_off()

    def _image(self, axes: Axes, moment: Moment) -> None:
        """The tactile image."""
        image = np.zeros((4, 4)) if moment.image is None else moment.image
        axes.imshow(image, cmap="magma", vmin=0, vmax=160, origin="lower")
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
        axes.set_title("touch image", size=10)

    def _shapes(self, figure: Figure, moment: Moment) -> None:
        """Each shape, averaged over what is still possible, with its probability."""
        labels, theme = self.scene.shape_labels, self.theme
        outline = self.bodies.outline(labels[moment.frame.shape], moment.frame.body)
        for label, prob, picture in self.bodies.likeliest(moment.evidence, moment.probs, len(labels)):
            place = labels.index(label)
            axes = figure.add_axes((0.565 + 0.107 * place, 0.40, 0.105, 0.27))
            axes.imshow(coloured(picture, prob), origin="lower", alpha=0.2 + 0.8 * min(1.0, 2.0 * prob))
            if place == moment.frame.shape:
                axes.contour(outline, levels=[0.5], colors=theme.faint, linewidths=1.0)
            axes.set_axis_off()
            axes.set_title(label, size=10, weight="bold" if label == TARGET else "normal")
            bar = figure.add_axes((0.572 + 0.107 * place, 0.365, 0.091, 0.025))
            bar.barh(0, 1.0, color=theme.faint, alpha=0.3)
            bar.barh(0, prob, color=theme.good if label == TARGET else theme.faint)
            bar.set(xlim=(0, 1))
            bar.set_axis_off()

    def _objects(self, axes: Axes, moment: Moment) -> None:
        """The objects in their order, and what has become of them."""
        theme, now = self.theme, moment.frame.step.object_index
        for place, state in enumerate(moment.states):
            colour = {"rejected": theme.bad, "found": theme.good}.get(state, theme.ink if place == now else theme.faint)
            axes.add_patch(Rectangle((place + 0.05, 0.35), 0.9, 0.6, fill=False, edgecolor=colour, linewidth=1.6))
            words = state or ("here" if place == now else "waiting")
            axes.text(place + 0.5, 0.65, f"object {place + 1}", ha="center", va="center", size=10, color=colour)
            axes.text(place + 0.5, 0.1, words, ha="center", va="center", size=9, color=colour)
        axes.set(xlim=(0, len(moment.states)), ylim=(0, 1))
        axes.set_axis_off()


def main() -> None:
    """Write both versions."""
    sensor = TactileSensor.shipped("coarse")
    shown = list(moments(sensor))
    FOLDER.mkdir(exist_ok=True)
    for theme in THEMES:
        film = Film(sensor, theme)
        first, *rest = [film.draw(moment) for moment in shown]
        path = FOLDER / f"{theme.name}.webp"
        durations = [moment.milliseconds for moment in shown]
        first.save(path, save_all=True, append_images=rest, duration=durations, loop=0, quality=82, method=6)
        print(f"{path}: {len(shown)} pictures, {sum(durations) / 1000:.0f} s, {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
