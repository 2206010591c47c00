"""Pictures of the bodies that are still possible after each touch."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from matplotlib.axes import Axes

from activetouch.view.portrait import portraits
from belief.validation import Floats
from experiments.meshes.naming import Naming
from experiments.meshes.setting import MeshSetting
from experiments.reporting.page import Section
from experiments.reporting.style import Picture

_MOST_OBJECTS = 6  # with pictures


def possible_pictures(setting: MeshSetting, namings: Sequence[Naming], most: int = _MOST_OBJECTS) -> list[Section]:
    """One section for each of the first objects: its touches, and the bodies that were possible after each."""
    labels, sections = setting.bodies.labels, []
    for number, naming in enumerate(namings[:most], 1):
        words = [f"side {setting.scene.pose_labels[pose]}" for pose in naming.poses]
        pictures = touch_pictures(setting, f"object{number}", words, naming.possible)
        end = f"named {labels[naming.named]} with probability {naming.stated:.3f}"
        right = "rightly" if naming.named == naming.truth else f"wrongly: it is {labels[naming.truth]}"
        sentence = f"After {len(naming.poses)} touches {end}, {right}."
        sections.append(Section(f"Object {number}", [sentence], [], pictures))
    return sections


def touch_pictures(
    setting: MeshSetting,
    name: str,
    touches: Sequence[str],
    possible: Sequence[Sequence[tuple[int, float, Floats]]],
) -> list[Picture]:
    """The bodies that are possible after each touch, as they lie most probably; none where no body stands out.

    Args:
        setting: bodies and sensor.
        name: stem of the figures' names.
        touches: what is said of each touch.
        possible: bodies after each, see :class:`Naming`.
    """
    labels, solids = setting.bodies.labels, list(setting.scene.solids.values())
    reach = max(solids[body].bounding_radius for each in possible for body, *_ in each) if any(possible) else 0.0
    return [
        Picture(
            f"{name}-touch{number}",
            f"After touch {number}: {said}.",
            [
                partial(
                    _draw,
                    picture=portraits(solids[body], rest[None], reach)[0],
                    title=f"{labels[body][-18:]}\n{prob:.2f}",
                )
                for body, prob, rest in bodies
            ],
            size=(1.3, 1.5),
        )
        for number, (said, bodies) in enumerate(zip(touches, possible, strict=True), 1)
        if bodies
    ]


def _draw(axes: Axes, picture: Floats, title: str) -> None:
    axes.imshow(picture, cmap="bone", origin="lower", vmin=0.0, vmax=1.1)
    axes.set_title(title, fontsize=7)
    axes.set_axis_off()
